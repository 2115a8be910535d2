# SPDX-License-Identifier: Apache-2.0
"""In which order to eliminate the vertices of a sparse symmetric system, so that little fills in.

Approximate minimum degree (Amestoy, Davis, Duff, 1996) on a quotient graph. A *variable* stands for
one vertex, or for several that have become indistinguishable. A variable that is eliminated, the
pivot, lives on as an *element*: the clique of its neighbours. Elements that lie within a newer one
are absorbed by it. Each variable keeps a list of its elements, then of its neighbours that no
element accounts for; the lists only shrink.

What is known of vertex i is row i of the array `state`; elements have the number of their pivot.
"""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import IntArray
from cartoloop.kernels.sparse_cholesky.arrays import filled

# columns of `state`: of a variable
_WEIGHT = 0  # vertices that it stands for; 0 once it is eliminated or merged with another
_START = 1  # of its list
_LENGTH = 2  # of its list
_NUM_ELEMENTS = 3  # that its list begins with
_DEGREE = 4  # weight of its neighbours, or a bound on it
_MARK = 5  # tag of the last set it was put in
_NEXT = 6  # variable of the same degree, -1 for none
_PREVIOUS = 7
_NEXT_MEMBER = 8  # vertex that it stands for, too; -1 for none
_LAST_MEMBER = 9
_HASH = 10  # of its list
_NEXT_ALIKE = 11  # variable of the same hash; -1 for none
# of an element
_BEGIN = 12  # of its variables in the pool
_END = 13
_SIZE = 14  # weight of its variables, -1 once it is absorbed
_OUTSIDE = 15  # of that, weight outside the newest element
_OUTSIDE_TAG = 16  # newest element that this refers to
_NUM_COLUMNS = 17


@kernel
def _unlink(i: int, state: IntArray, head: IntArray) -> None:
    """Take variable i out of the list of its degree."""
    following, previous = state[i, _NEXT], state[i, _PREVIOUS]
    if previous >= 0:
        state[previous, _NEXT] = following
    else:
        head[state[i, _DEGREE]] = following
    if following >= 0:
        state[following, _PREVIOUS] = previous


@kernel
def _link(i: int, state: IntArray, head: IntArray) -> None:
    """Put variable i at the front of the list of its degree."""
    following = head[state[i, _DEGREE]]
    state[i, _NEXT] = following
    state[i, _PREVIOUS] = -1
    if following >= 0:
        state[following, _PREVIOUS] = i
    head[state[i, _DEGREE]] = i


@kernel
def _merge(i: int, j: int, state: IntArray) -> None:
    """Let variable i stand for the vertices of variable j, too."""
    state[state[i, _LAST_MEMBER], _NEXT_MEMBER] = j
    state[i, _LAST_MEMBER] = state[j, _LAST_MEMBER]
    state[j, _WEIGHT] = 0


@kernel
def _collect(
    variables: IntArray, first: int, last: int, tag: int, state: IntArray, pool: IntArray, end: int
) -> int:
    """Append variables[first:last], if alive and not yet marked, to the pool; return its end."""
    for k in range(first, last):
        i = variables[k]
        if state[i, _WEIGHT] > 0 and state[i, _MARK] != tag:
            state[i, _MARK] = tag
            pool[end] = i
            end += 1
    return end


@kernel
def _form_element(
    p: int, tag: int, lists: IntArray, state: IntArray, pool: IntArray, end: int
) -> int:
    """Put the neighbours of pivot p into the pool, absorb its elements, return the pool's end."""
    start, num_elements = state[p, _START], state[p, _NUM_ELEMENTS]
    state[p, _BEGIN] = end
    for k in range(start, start + num_elements):
        e = lists[k]
        state[e, _SIZE] = -1
        end = _collect(pool, state[e, _BEGIN], state[e, _END], tag, state, pool, end)
    return _collect(lists, start + num_elements, start + state[p, _LENGTH], tag, state, pool, end)


@kernel
def _measure_outside(i: int, tag: int, lists: IntArray, state: IntArray) -> None:
    """Take variable i of the newest element off what its other elements have outside that one."""
    for k in range(state[i, _START], state[i, _START] + state[i, _NUM_ELEMENTS]):
        e = lists[k]
        if state[e, _SIZE] < 0:
            continue
        if state[e, _OUTSIDE_TAG] != tag:
            state[e, _OUTSIDE_TAG] = tag
            state[e, _OUTSIDE] = state[e, _SIZE]
        state[e, _OUTSIDE] -= state[i, _WEIGHT]


@kernel
def _shorten_list(i: int, p: int, tag: int, lists: IntArray, state: IntArray) -> bool:
    """Replace by p, in the list of i, all that it accounts for; bound the degree by the rest.

    Returns
    -------
    alone : bool, whether p is all that is left: then i can be eliminated together with p.
    """
    start = state[i, _START]
    write = start
    bound = 0
    hashed = p
    for k in range(start, start + state[i, _NUM_ELEMENTS]):
        e = lists[k]
        if state[e, _SIZE] < 0:
            continue
        if state[e, _OUTSIDE] == 0:
            state[e, _SIZE] = -1  # it lies within p, though p was not in it
            continue
        bound += state[e, _OUTSIDE]
        hashed += e
        lists[write] = e
        write += 1
    elements_end = write
    for k in range(start + state[i, _NUM_ELEMENTS], start + state[i, _LENGTH]):
        j = lists[k]
        if state[j, _WEIGHT] > 0 and state[j, _MARK] != tag:
            bound += state[j, _WEIGHT]
            hashed += j
            lists[write] = j
            write += 1
    if write == start:
        return True
    # at least p itself, or an element of p, has made room
    lists[write] = lists[elements_end]
    lists[elements_end] = p
    state[i, _NUM_ELEMENTS] = elements_end + 1 - start
    state[i, _LENGTH] = write + 1 - start
    state[i, _DEGREE] = min(state[i, _DEGREE], bound)
    state[i, _HASH] = hashed % state.shape[0]
    return False


@kernel
def _same_list(i: int, j: int, tag: int, lists: IntArray, state: IntArray) -> bool:
    """Return whether j has the same list as i, all in the list of i being marked with `tag`."""
    if state[i, _LENGTH] != state[j, _LENGTH]:
        return False
    for k in range(state[j, _START], state[j, _START] + state[j, _LENGTH]):
        if state[lists[k], _MARK] != tag:
            return False
    return True


@kernel
def _merge_alike(
    p: int, end: int, tag: int, lists: IntArray, state: IntArray, pool: IntArray, bucket: IntArray
) -> int:
    """Merge the variables of element p that have the same lists; return the last tag used."""
    for m in range(state[p, _BEGIN], end):
        i = pool[m]
        if state[i, _WEIGHT] > 0:
            state[i, _NEXT_ALIKE] = bucket[state[i, _HASH]]
            bucket[state[i, _HASH]] = i
    for m in range(state[p, _BEGIN], end):
        if state[pool[m], _WEIGHT] == 0:
            continue
        i = bucket[state[pool[m], _HASH]]
        bucket[state[pool[m], _HASH]] = -1
        while i >= 0:
            if state[i, _WEIGHT] > 0 and state[i, _NEXT_ALIKE] >= 0:
                tag += 1
                for k in range(state[i, _START], state[i, _START] + state[i, _LENGTH]):
                    state[lists[k], _MARK] = tag
                j = state[i, _NEXT_ALIKE]
                while j >= 0:
                    if state[j, _WEIGHT] > 0 and _same_list(i, j, tag, lists, state):
                        state[i, _WEIGHT] += state[j, _WEIGHT]
                        _merge(i, j, state)
                    j = state[j, _NEXT_ALIKE]
            i = state[i, _NEXT_ALIKE]
    return tag


@kernel
def _begin_state(begin: IntArray, head: IntArray) -> IntArray:
    """Return the state in which every vertex is a variable, linked in `head` by its degree."""
    n = begin.size - 1
    state = np.zeros((n, _NUM_COLUMNS), dtype=np.int64)
    for i in range(n - 1, -1, -1):
        state[i, _WEIGHT] = 1
        state[i, _START] = begin[i]
        state[i, _LENGTH] = state[i, _DEGREE] = begin[i + 1] - begin[i]
        state[i, _MARK] = state[i, _OUTSIDE_TAG] = -1
        state[i, _NEXT_MEMBER] = state[i, _NEXT_ALIKE] = -1
        state[i, _LAST_MEMBER] = i
        _link(i, state, head)
    return state


@kernel
def _with_room(pool: IntArray, end: int, room: int) -> IntArray:
    """Return the pool, grown if need be, so that `room` numbers fit behind its end."""
    if end + room <= pool.size:
        return pool
    grown = np.empty(2 * pool.size + room, dtype=np.int64)
    for i in range(end):
        grown[i] = pool[i]
    return grown


@kernel
def minimum_degree(begin: IntArray, neighbours: IntArray) -> tuple[IntArray, IntArray, int]:
    """Return an order of elimination, and where in it each group that goes at once begins.

    Parameters
    ----------
    begin : int64, shape (n + 1,).
    neighbours : int64, neighbours[begin[i]:begin[i + 1]] of vertex i, without itself, each once.

    Returns
    -------
    order : int64, shape (n,), the vertices in their order of elimination.
    group_begin : int64, shape (n + 1,); the first num_groups + 1 are used, from 0 up to n.
    num_groups : int64.
    """
    n = begin.size - 1
    head = filled(n + 1, -1)
    bucket = filled(n, -1)
    state = _begin_state(begin, head)
    lists = neighbours.copy()
    pool = np.empty(neighbours.size + n, dtype=np.int64)
    end = tag = least = eliminated = num_groups = 0
    order = np.empty(n, dtype=np.int64)
    group_begin = np.zeros(n + 1, dtype=np.int64)
    while eliminated < n:
        while head[least] < 0:
            least += 1
        p = head[least]
        _unlink(p, state, head)
        pivot_weight = state[p, _WEIGHT]
        state[p, _WEIGHT] = 0
        tag += 1
        pool = _with_room(pool, end, n)
        end = _form_element(p, tag, lists, state, pool, end)
        size = 0
        for m in range(state[p, _BEGIN], end):
            _unlink(pool[m], state, head)
            _measure_outside(pool[m], tag, lists, state)
            size += state[pool[m], _WEIGHT]
        for m in range(state[p, _BEGIN], end):
            i = pool[m]
            if _shorten_list(i, p, tag, lists, state):
                pivot_weight += state[i, _WEIGHT]
                size -= state[i, _WEIGHT]
                _merge(p, i, state)
        tag = _merge_alike(p, end, tag, lists, state, pool, bucket)
        eliminated += pivot_weight
        write = state[p, _BEGIN]
        for m in range(state[p, _BEGIN], end):
            i = pool[m]
            weight = state[i, _WEIGHT]
            if weight == 0:
                continue
            pool[write] = i
            write += 1
            degree = min(state[i, _DEGREE] + size - weight, n - eliminated - weight)
            state[i, _DEGREE] = degree
            least = min(least, degree)
            _link(i, state, head)
        end = write
        state[p, _END] = end
        state[p, _SIZE] = size
        place = group_begin[num_groups]
        member = p
        while member >= 0:
            order[place] = member
            place += 1
            member = state[member, _NEXT_MEMBER]
        num_groups += 1
        group_begin[num_groups] = place
    return order, group_begin, num_groups
