# SPDX-License-Identifier: Apache-2.0
"""Memory is used again, but never while anybody still looks at it."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cartoloop.runtime.reused_memory import ReusedMemory, drop_idle_memory


def address(array):
    return array.__array_interface__["data"][0]


def test_the_memory_of_a_freed_array_is_reused():
    memory = ReusedMemory(max_idle_bytes=5000)
    first = memory.array(1000)
    before = address(first)
    del first
    assert memory.idle_bytes == 1000
    assert address(memory.array(900)) == before


def test_memory_is_not_reused_while_a_view_exists():
    memory = ReusedMemory(max_idle_bytes=5000)
    array = memory.array(1000)
    view = array[10:20].reshape(2, 5)[1:]
    view[:] = 7
    del array
    assert memory.idle_bytes == 0
    memory.array(1000)[:] = 0
    assert (view == 7).all()
    del view
    assert memory.idle_bytes > 0


def test_blocks_of_unsuitable_size_are_not_reused():
    memory = ReusedMemory(max_idle_bytes=5000)
    memory.array(1000)
    for size in (1001, 499):
        array = memory.array(size)
        assert memory.idle_bytes == 1000
        assert array.shape == (size,)
        memory = ReusedMemory(max_idle_bytes=5000)
        memory.array(1000)


def test_idle_memory_is_limited():
    memory = ReusedMemory(max_idle_bytes=599)
    arrays = [memory.array(size) for size in (100, 200, 300)]
    while arrays:
        arrays.pop(0)
    assert memory.idle_bytes == 200 + 300


def test_idle_memory_can_be_dropped():
    memory = ReusedMemory(max_idle_bytes=1000)
    memory.array(300)
    assert memory.idle_bytes == 300
    drop_idle_memory()
    assert memory.idle_bytes == 0


def test_threads_never_share_memory():
    memory = ReusedMemory(max_idle_bytes=1000)

    def work(number):
        for size in range(1, 400):
            array = memory.array(size)
            array[:] = number
            if not (array == number).all():
                return False
        return True

    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(work, range(8)))


def test_an_array_can_be_written_and_is_contiguous():
    array = ReusedMemory(max_idle_bytes=64).array(64)
    array[:] = np.arange(64)
    assert array.flags.c_contiguous and array.flags.writeable
    assert array.sum() == 63 * 32
