# SPDX-License-Identifier: Apache-2.0
"""In which order to eliminate the vertices of a sparse symmetric system, so that little fills in.

Approximate minimum degree (Amestoy, Davis, Duff, 1996) on a quotient graph: an eliminated vertex
lives on as an *element*, the clique of its neighbours, and elements that lie within a newer one are
absorbed by it. A variable stands for a group of vertices that have become indistinguishable.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

IntArray = NDArray[np.int64]


@kernel
def _unlink(i: int, degree: IntArray, head: IntArray, following: IntArray, before: IntArray) -> None:
    """Take variable i out of the list of its degree."""
    if before[i] >= 0:
        following[before[i]] = following[i]
    else:
        head[degree[i]] = following[i]
    if following[i] >= 0:
        before[following[i]] = before[i]


@kernel
def _link(i: int, degree: IntArray, head: IntArray, following: IntArray, before: IntArray) -> None:
    """Put variable i at the front of the list of its degree."""
    first = head[degree[i]]
    following[i] = first
    before[i] = -1
    if first >= 0:
        before[first] = i
    head[degree[i]] = i


@kernel
def _append_group(i: int, j: int, last_member: IntArray, next_member: IntArray) -> None:
    """Append the group of variable j to that of variable i."""
    next_member[last_member[i]] = j
    last_member[i] = last_member[j]


@kernel
def _same_neighbours(
    i: int, j: int, start: IntArray, length: IntArray, lists: IntArray, mark: IntArray, tag: int
) -> bool:
    """Return whether the lists of i and j hold the same, those of i being marked with `tag`."""
    if length[i] != length[j]:
        return False
    for k in range(start[j], start[j] + length[j]):
        if mark[lists[k]] != tag:
            return False
    return True


@kernel
def minimum_degree(begin: IntArray, neighbours: IntArray) -> tuple[IntArray, IntArray]:
    """Return an order of elimination, and where in it each group that goes at once begins.

    Parameters
    ----------
    begin : int64, shape (n + 1,).
    neighbours : int64, neighbours[begin[i]:begin[i + 1]] of vertex i, without itself, each once.

    Returns
    -------
    order : int64, shape (n,), the vertices in their order of elimination.
    group_begin : int64, shape (num_groups + 1,), ascending from 0 to n.
    """
    n = begin.size - 1
    lists = neighbours.copy()  # of each variable: its elements, then its variables
    start = begin[:n].copy()
    length = begin[1:] - begin[:n]
    num_elements = np.zeros(n, dtype=np.int64)
    weight = np.ones(n, dtype=np.int64)  # vertices a variable stands for, 0 once it is gone
    degree = length.copy()
    last_member = np.arange(n)
    next_member = np.full(n, -1, dtype=np.int64)
    pool = np.empty(neighbours.size + n, dtype=np.int64)  # the variables of each element
    pool_end = 0
    element_begin = np.zeros(n, dtype=np.int64)
    element_end = np.zeros(n, dtype=np.int64)
    element_weight = np.zeros(n, dtype=np.int64)  # -1 once it is absorbed
    outside = np.zeros(n, dtype=np.int64)  # weight of an element outside the newest one
    outside_tag = np.full(n, -1, dtype=np.int64)
    mark = np.full(n, -1, dtype=np.int64)
    tag = 0
    head = np.full(n + 1, -1, dtype=np.int64)
    following = np.full(n, -1, dtype=np.int64)
    before = np.full(n, -1, dtype=np.int64)
    bucket = np.full(n, -1, dtype=np.int64)
    bucket_next = np.full(n, -1, dtype=np.int64)
    hashes = np.zeros(n, dtype=np.int64)
    order = np.empty(n, dtype=np.int64)
    group_begin = np.zeros(n + 1, dtype=np.int64)
    num_groups = 0
    eliminated = 0
    for i in range(n - 1, -1, -1):
        _link(i, degree, head, following, before)
    least = 0
    while eliminated < n:
        while head[least] < 0:
            least += 1
        p = head[least]
        _unlink(p, degree, head, following, before)
        pivot_weight = weight[p]
        weight[p] = 0

        # the new element: all variables that p, or an element of p, is next to
        tag += 1
        room = length[p] - num_elements[p]
        for k in range(start[p], start[p] + num_elements[p]):
            room += element_end[lists[k]] - element_begin[lists[k]]
        if pool_end + room > pool.size:
            grown = np.empty(2 * pool.size + room, dtype=np.int64)
            grown[:pool_end] = pool[:pool_end]
            pool = grown
        element_begin[p] = pool_end
        size = 0
        for k in range(start[p], start[p] + length[p]):
            if k < start[p] + num_elements[p]:
                e = lists[k]
                element_weight[e] = -1
                for m in range(element_begin[e], element_end[e]):
                    i = pool[m]
                    if weight[i] > 0 and mark[i] != tag:
                        mark[i] = tag
                        pool[pool_end] = i
                        pool_end += 1
                        size += weight[i]
            else:
                i = lists[k]
                if weight[i] > 0 and mark[i] != tag:
                    mark[i] = tag
                    pool[pool_end] = i
                    pool_end += 1
                    size += weight[i]

        # how much of each neighbouring element lies outside the new one
        for m in range(element_begin[p], pool_end):
            i = pool[m]
            _unlink(i, degree, head, following, before)
            for k in range(start[i], start[i] + num_elements[i]):
                e = lists[k]
                if element_weight[e] < 0:
                    continue
                if outside_tag[e] != tag:
                    outside_tag[e] = tag
                    outside[e] = element_weight[e]
                outside[e] -= weight[i]

        # shorten the lists of the variables in it, and bound their degrees
        for m in range(element_begin[p], pool_end):
            i = pool[m]
            bound = 0
            write = start[i]
            hashed = 0
            for k in range(start[i], start[i] + num_elements[i]):
                e = lists[k]
                if element_weight[e] < 0:
                    continue
                if outside[e] == 0:
                    element_weight[e] = -1  # lies within p, though p was not in it
                    continue
                bound += outside[e]
                hashed += e
                lists[write] = e
                write += 1
            kept_elements = write - start[i]
            for k in range(start[i] + num_elements[i], start[i] + length[i]):
                j = lists[k]
                if weight[j] > 0 and mark[j] != tag:
                    bound += weight[j]
                    hashed += j
                    lists[write] = j
                    write += 1
            if write == start[i]:  # nothing but p is left: i goes together with p
                _append_group(p, i, last_member, next_member)
                pivot_weight += weight[i]
                size -= weight[i]
                weight[i] = 0
                continue
            # p takes the place of what it absorbed, at the end of the elements
            lists[write] = lists[start[i] + kept_elements]
            lists[start[i] + kept_elements] = p
            num_elements[i] = kept_elements + 1
            length[i] = write + 1 - start[i]
            degree[i] = min(degree[i], bound)
            hashes[i] = (hashed + p) % n

        # merge variables that have become indistinguishable
        for m in range(element_begin[p], pool_end):
            i = pool[m]
            if weight[i] == 0:
                continue
            bucket_next[i] = bucket[hashes[i]]
            bucket[hashes[i]] = i
        for m in range(element_begin[p], pool_end):
            i = bucket[hashes[pool[m]]]
            if weight[pool[m]] == 0 or i < 0:
                continue
            bucket[hashes[i]] = -1
            while i >= 0:
                if weight[i] > 0 and bucket_next[i] >= 0:
                    tag += 1
                    for k in range(start[i], start[i] + length[i]):
                        mark[lists[k]] = tag
                    j = bucket_next[i]
                    while j >= 0:
                        if weight[j] > 0 and _same_neighbours(
                            i, j, start, length, lists, mark, tag
                        ):
                            _append_group(i, j, last_member, next_member)
                            weight[i] += weight[j]
                            weight[j] = 0
                        j = bucket_next[j]
                i = bucket_next[i]

        # put the variables back at their new degrees, and the group of p into the order
        eliminated += pivot_weight
        write = element_begin[p]
        for m in range(element_begin[p], pool_end):
            i = pool[m]
            if weight[i] == 0:
                continue
            pool[write] = i
            write += 1
            degree[i] = min(degree[i] + size - weight[i], n - eliminated - weight[i])
            least = min(least, degree[i])
            _link(i, degree, head, following, before)
        pool_end = write
        element_end[p] = pool_end
        element_weight[p] = size
        place = group_begin[num_groups]
        member = p
        while member >= 0:
            order[place] = member
            place += 1
            member = next_member[member]
        num_groups += 1
        group_begin[num_groups] = place
    return order, group_begin[: num_groups + 1].copy()
