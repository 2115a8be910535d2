# SPDX-License-Identifier: Apache-2.0
"""Global SLAM in a background thread, so that poses do not wait for the pose graph."""

from __future__ import annotations

from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread

from cartoloop.global_slam.global_slam import GlobalSlam
from cartoloop.runtime.thread_priority import lower_thread_priority
from cartoloop.submaps.node import Node

Task = Callable[[], None]


class BackgroundGlobalSlam:
    """Passes nodes to global SLAM in their order, in a thread that alone accesses the graph.

    Parameters
    ----------
    slam : to be accessed by tasks of `call` only, until `close`.

    Attributes
    ----------
    failure : the exception that ended the thread, or None.
    """

    def __init__(self, slam: GlobalSlam) -> None:
        self._slam = slam
        self._tasks: SimpleQueue[Task | None] = SimpleQueue()
        self.failure: Exception | None = None
        self._thread = Thread(target=self._run, name="global-slam", daemon=True)
        self._thread.start()

    @property
    def num_waiting(self) -> int:
        """Number of nodes and tasks that are not done."""
        return self._tasks.qsize()

    def add_node(self, node: Node) -> None:
        """Queue a node; returns immediately.

        Raises
        ------
        Exception
            The failure that ended the thread.
        """
        if self.failure is not None:
            raise self.failure
        self._tasks.put(lambda: self._slam.add_node(node))

    def call(self, task: Task) -> None:
        """Queue a task that runs after all nodes so far were added; returns immediately."""
        self._tasks.put(task)

    def close(self) -> None:
        """Add the queued nodes and end the thread; the caller may access the graph afterwards."""
        self._tasks.put(None)
        self._thread.join()

    def _run(self) -> None:
        lower_thread_priority()  # inherited by the search threads
        while (task := self._tasks.get()) is not None:
            try:
                task()
            except Exception as failure:  # noqa: BLE001 - raised in the mapping thread
                self.failure = failure
                return
