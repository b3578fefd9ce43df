"""Run a command and write down what it took. A script of its own, run by its path: it must stay small.

Linux counts the memory of whoever starts a process to that process' peak, and `mvtn bench` itself holds hundreds of
MiB.
"""

from __future__ import annotations

import json
import os
import sys


def main(report: str, *command: str) -> int:
    """Write [CPU seconds, peak in units of `ru_maxrss`] into `report`; return the command's exit code."""
    process = os.posix_spawn(command[0], command, os.environ)
    _, status, used = os.wait4(process, 0)
    with open(report, "w", encoding="ascii") as file:
        json.dump([used.ru_utime + used.ru_stime, used.ru_maxrss], file)
    return os.waitstatus_to_exitcode(status)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]) & 0xFF)
