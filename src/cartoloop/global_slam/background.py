# SPDX-License-Identifier: Apache-2.0
"""Global SLAM in a thread of its own, so that no pose ever waits for the graph."""

from __future__ import annotations

from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread

from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.runtime.thread_priority import lower_thread_priority
from cartoloop.submaps.node import Node

Task = Callable[[], None]


class BackgroundGlobalSlam:
    """Hands nodes to global SLAM one after another, in a thread that alone touches the graph.

    Parameters
    ----------
    slam : from now on, only `call` may look at it.

    Attributes
    ----------
    failure : what ended the thread, if anything did.
    """

    def __init__(self, slam: GlobalSlam) -> None:
        self._slam = slam
        self._tasks: SimpleQueue[Task | None] = SimpleQueue()
        self.failure: Exception | None = None
        self._thread = Thread(target=self._run, name="global-slam", daemon=True)
        self._thread.start()

    @property
    def num_waiting(self) -> int:
        """How many nodes and tasks are not done."""
        return self._tasks.qsize()

    def add_node(self, node: Node) -> None:
        """Add a scan that was inserted; returns at once.

        Raises
        ------
        Exception
            What ended the thread.
        """
        if self.failure is not None:
            raise self.failure
        self._tasks.put(lambda: self._slam.add_node(node))

    def call(self, task: Task) -> None:
        """Have something done when all nodes so far have been added; returns at once."""
        self._tasks.put(task)

    def close(self) -> None:
        """Add what was handed over and end the thread; the graph is the caller's then."""
        self._tasks.put(None)
        self._thread.join()

    def _run(self) -> None:
        lower_thread_priority()  # the threads that search are started by this one
        while (task := self._tasks.get()) is not None:
            try:
                task()
            except Exception as failure:  # noqa: BLE001 - raised in the mapping thread
                self.failure = failure
                return
