# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: T201 - its output is read by the process that started it
"""Runs a command and prints what it took as JSON; run as a script, and small, on purpose.

A process is charged with the memory of the one that it is forked from: a command started by a large
process seems to be at least as large.
"""

import json
import os
import sys
from time import perf_counter


def main() -> None:
    """Run the command in the arguments, its output into the file named first."""
    log, *command = sys.argv[1:]
    with open(log, "wb") as said:  # noqa: PTH123 - pathlib is memory, too
        redirect = [(os.POSIX_SPAWN_DUP2, said.fileno(), stream) for stream in (1, 2)]
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
