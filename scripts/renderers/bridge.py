"""What a bridge is before anything heavy is loaded: its command line, its errors in one line, its signals.

Nothing here needs more than Python, so that even a missing numpy can be told.
"""

import argparse
import contextlib
import os
import pathlib
import re
import signal
import sys


# Those that end a run; not every system has all.
SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Failure(Exception):
    """What stops a frame or a run, in one line for people; exit status 1."""


class Misuse(Failure):
    """A command line that cannot be meant; exit status 2."""


class Stopped(BaseException):
    """A signal; raised so that half-written files go."""

    def __init__(self, number):
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.status = 128 + number


class Parser(argparse.ArgumentParser):
    """Its errors are one line and where to look, instead of the usage."""

    def __init__(self, description):
        super().__init__(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)

    def error(self, message):
        raise Misuse(message)


def name():
    """What a bridge calls itself."""
    return pathlib.Path(getattr(sys.modules["__main__"], "__file__", None) or sys.argv[0]).name


def complain(text):
    """One line on standard error, whatever is in the text."""
    line = re.sub(r"[\x00-\x1f\x7f]", " ", text)
    if sys.stderr:
        with contextlib.suppress(OSError):
            print(f"{name()}: error: {line}", file=sys.stderr, flush=True)


def brief(error, line=0):
    """An exception in one line: the reason that the system gives, a line of its text, or at least its name."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, MemoryError):
        return "not enough memory: render fewer pixels or a smaller frame"
    # Dr.Jit hides the reason of what fails in Python behind one that says so.
    if error.__cause__ is not None and "(see above)" in str(error):
        return brief(error.__cause__, line)
    # Mitsuba begins its lines with a space of no width, or with a place in its source, and lists things on lines of their own.
    text = re.sub(r":\n\s*- ", ": ", re.sub(r"^\[\w+\.cpp:\d+\] ", "", str(error).replace("\u200b", "")))
    lines = [text.strip() for text in text.splitlines() if text.strip()]
    if isinstance(error, RuntimeError) and lines:
        return lines[line]
    return f"{type(error).__name__}: {lines[line]}" if lines else type(error).__name__


@contextlib.contextmanager
def needing(packages, otherwise="take the .venv that scripts/env makes"):
    """Around the imports of a bridge: what cannot be imported is told in one line, with what to install."""
    way = f"{sys.executable or 'python'} -m pip install {packages}, or {otherwise}"
    try:
        if sys.version_info < (3, 11):
            raise ImportError(f"Python 3.11 or newer is needed, this is {sys.version.split()[0]}")
        yield
    except KeyboardInterrupt:
        complain("stopped by SIGINT")
        sys.exit(130)
    except ModuleNotFoundError as error:
        complain(f"this Python has no {error.name}: {way}")
        sys.exit(1)
    except (ImportError, OSError) as error:
        complain(f"{brief(error)}: try {way}")
        sys.exit(1)


# The signal that came, if one did.
came = None


def stop(number, _):
    global came
    came = Stopped(number)
    for other in SIGNALS:
        signal.signal(other, signal.SIG_IGN)  # the way out is short, and not to be cut
    raise came


def check_signal():
    """Raises a signal once more: libraries that call Python may make another exception of it, or none."""
    if came:
        raise came from None


def run(body, end=sys.exit):
    """Runs a bridge: whatever stops it is one line, and exit status 1, 2 or that of a signal. `end` takes the status."""
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, stop)
    if sys.stdout:
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        status = attempt(body)
    except Stopped as stopped:  # in between
        status = stopped.status
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except OSError as error:
            status = status or 1
            complain(f"standard output: {brief(error)}")
            # Python would try again at its end, and say so at length.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    end(status)


def attempt(body):
    """The exit status of a body."""
    try:
        try:
            body()
        except Exception:
            check_signal()
            raise
    except Misuse as misuse:
        complain(f"{misuse} (see '{name()} --help')")
        return 2
    except Failure as failure:
        complain(str(failure))
        return 1
    except Stopped as stopped:
        complain(str(stopped))
        return stopped.status
    except SystemExit as ended:  # --help
        return ended.code if isinstance(ended.code, int) else 0
    except Exception as error:
        complain(brief(error))
        return 1
    return 0
