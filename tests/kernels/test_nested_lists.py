# SPDX-License-Identifier: Apache-2.0
"""Lists in lists are found as one finds them by hand."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.nested_lists import find_lists

lists_of_words = st.lists(st.lists(st.integers(0, 2**32 - 1), max_size=4), max_size=8)


def find(words, start, num_lists):
    firsts, counts = np.zeros(num_lists, dtype=np.int64), np.zeros(num_lists, dtype=np.int64)
    end = find_lists(np.array(words, dtype=np.uint32), start, firsts, counts)
    return end, firsts.tolist(), counts.tolist()


@settings(deadline=None)
@given(lists_of_words, st.integers(0, 3), st.integers(0, 3))
def test_each_list_is_found(lists, before, after):
    words, where = [9] * before, []
    for items in lists:
        words.append(len(items))
        where.append(len(words))
        words += items
    end, firsts, counts = find(words + [9] * after, before, len(lists))
    assert end == len(words)
    assert firsts == where
    assert counts == [len(items) for items in lists]


@settings(deadline=None)
@given(lists_of_words.filter(bool))
def test_lists_longer_than_the_words_are_reported(lists):
    words = [word for items in lists for word in (len(items), *items)]
    assert find(words[:-1], 0, len(lists))[0] == -1


def test_a_length_beyond_all_words_is_reported():
    assert find([2**32 - 1, 0], 0, 2)[0] == -1
