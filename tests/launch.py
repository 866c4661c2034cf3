"""Runs a command from a small process and writes what the kernel says of it to a pipe: `launch.py DESCRIPTOR COMMAND ...`.

The kernel's peak memory of a process is never less than what the process held that started it, and a test runner holds a lot.
Written: the status of wait(2), bytes at the peak, seconds, seconds of processor."""

import os
import signal
import sys
import time

report = int(sys.argv[1])
os.set_inheritable(report, False)
start = time.perf_counter()
# Python ignores a broken pipe, and what it starts would.
child = os.posix_spawnp(sys.argv[2], sys.argv[2:], os.environ, setsigdef=[signal.SIGPIPE])
_, status, usage = os.wait4(child, 0)
seconds = time.perf_counter() - start
os.write(report, f"{status} {usage.ru_maxrss * 1024} {seconds} {usage.ru_utime + usage.ru_stime}".encode())
