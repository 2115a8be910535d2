# SPDX-License-Identifier: Apache-2.0
"""Types of NumPy arrays, named by their content; shapes and units are given where they are used."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]
"""Bytes: quantized values, pixels or enumerations."""

CellArray = NDArray[np.int32]
"""Indices of grid cells."""

RowArray = NDArray[np.int32]
"""Row numbers, and indices of nodes and submaps, in the record of closures."""

CodeArray = NDArray[np.int8]
"""Values of an enumeration with few members."""
