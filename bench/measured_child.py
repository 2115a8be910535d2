# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: T201 - its output is read by the process that started it
"""Runs a command and prints its cost as JSON. Run as a script that imports little, on purpose.

The peak memory of a process includes that of the process it was forked from, so a command that is
started by a large process appears to be at least as large.
"""

import json
import os
import sys
from time import perf_counter


def main() -> None:
    """Run the command in the arguments, its output into the file named first."""
    log, *command = sys.argv[1:]
    with open(log, "wb") as output:  # noqa: PTH123 - pathlib is memory, too
        redirect = [(os.POSIX_SPAWN_DUP2, output.fileno(), stream) for stream in (1, 2)]
        start = perf_counter()
        pid = os.posix_spawn(command[0], command, os.environ, file_actions=redirect)
        _, status, usage = os.wait4(pid, 0)
        wall_s = perf_counter() - start
    print(
        json.dumps(
            {
                "status": os.waitstatus_to_exitcode(status),
                "wall_s": wall_s,
                "cpu_s": usage.ru_utime + usage.ru_stime,
                "max_rss": usage.ru_maxrss,
            }
        )
    )


if __name__ == "__main__":
    main()
