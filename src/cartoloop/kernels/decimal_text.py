# SPDX-License-Identifier: Apache-2.0
"""Decimal numbers parsed from text: recordings hold hundreds of millions of characters of them."""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray

MAX_DIGITS = 15
"""Numbers of up to 15 digits, and powers of ten below, are exact in a float64."""

POWERS_OF_TEN = np.power(10.0, np.arange(MAX_DIGITS + 1), dtype=np.float64)


@kernel
def parse_decimals(text: bytes, powers_of_ten: FloatArray, out_values: FloatArray) -> int:
    """Write the numbers that a text begins with into `out_values`; return where the last ends.

    Parameters
    ----------
    text : ASCII, numbers separated by white space.
    powers_of_ten : `POWERS_OF_TEN`.
    out_values : float64, shape (n,): n numbers are parsed.

    Returns
    -------
    int : how far the text was read, -1 if one of the first n words is missing or is anything but
        an optional sign and up to 15 digits, a point among, before or after them.

    Notes
    -----
    An integer below 2^53 over a power of ten up to 10^22 is rounded once, and so the nearest number
    to what is written (W. D. Clinger, How to Read Floating Point Numbers Accurately, 1990).
    O(characters).
    """
    size = len(text)
    place = 0
    for k in range(len(out_values)):
        while place < size and (text[place] == 32 or 9 <= text[place] <= 13):
            place += 1
        negative = place < size and text[place] == 45
        if negative or (place < size and text[place] == 43):
            place += 1
        digits = np.int64(0)
        number_of_digits = 0
        number_of_decimals = 0
        point = 0
        while place < size:
            digit = np.int64(text[place]) - 48
            if 0 <= digit <= 9:
                digits = 10 * digits + digit
                number_of_digits += 1
                number_of_decimals += point
            elif digit == -2 and point == 0:
                point = 1
            else:
                break
            place += 1
        ends = place == size or text[place] == 32 or 9 <= text[place] <= 13
        if not ends or number_of_digits == 0 or number_of_digits > MAX_DIGITS:
            return -1
        value = digits / powers_of_ten[number_of_decimals]
        out_values[k] = -value if negative else value
    return place
