"""Runs lacuna and the tools of others as processes, and says what they used."""

import dataclasses
import os
import pathlib
import select
import signal
import subprocess
import sys
import tempfile

import OpenImageIO

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = ROOT.parent / "shared" / "data"
SAMPLES = ROOT / "samples"
LACUNA = os.environ.get("LACUNA", str(ROOT / "target" / "release" / "lacuna"))
# The commands that the wheel puts on the PATH are slow wrappers; these are the binaries.
OIIO_BIN = pathlib.Path(OpenImageIO.__file__).parent / "bin"


@dataclasses.dataclass
class Result:
    """What a process did: exit status (negative: the signal), its output, its peak memory (of it and nothing else: see `launch.py`),
    the seconds that it took and those that it kept processors busy."""

    command: list
    status: int
    stdout: str
    stderr: str
    peak_bytes: int
    seconds: float
    busy: float

    def lines(self):
        return [line for line in self.stderr.splitlines() if line.strip()]

    def __str__(self):
        return f"{' '.join(self.command)}\nexit {self.status}\n{self.stdout}{self.stderr}"


def run(command, timeout=600, environment=None, before=None, folder=None):
    """Runs a command to its end; it is killed after `timeout` seconds (status -9). `before` is called in the process that starts it."""
    command = [str(word) for word in command]
    told, tell = os.pipe()
    launch = [sys.executable, "-I", "-S", ROOT / "tests" / "launch.py", str(tell), *command]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err, open(told) as report:
        process = subprocess.Popen(launch, stdin=subprocess.DEVNULL, stdout=out, stderr=err, cwd=folder, pass_fds=[tell], process_group=0,
                                   env=None if environment is None else os.environ | environment, preexec_fn=before)
        os.close(tell)
        ended = []
        try:
            ended, _, _ = select.select([report], [], [], timeout)
        finally:
            # In time, too late, or because the tests are interrupted.
            if not ended:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode("utf-8", "replace"))
        figures = report.read() if ended else f"{signal.SIGKILL.value} 0 {timeout} 0"
    if not figures:
        raise OSError(f"{command[0]} cannot be started: {texts[1]}")
    status, peak, seconds, busy = figures.split()
    return Result(command, os.waitstatus_to_exitcode(int(status)), *texts, int(peak), float(seconds), float(busy))


def lacuna(*words, ok=True, **options):
    """Runs lacuna; with `ok` anything but exit status 0 fails the test."""
    result = run([LACUNA, *words], **options)
    assert "panicked" not in result.stderr and "internal error" not in result.stderr, result
    if ok:
        assert result.status == 0, result
    return result


def quick_fill(*words, **options):
    """Runs `lacuna fill` by splines and without an estimate unless `words` say otherwise: quick, where a test is about neither."""
    chosen = [] if "--filter" in words else ["--filter", "ss"]
    return lacuna("fill", *words, *chosen, "--no-estimate", **options)


def wait_until_at_work(process):
    """Reads standard error of a run up to the first line of its progress: a frame has been read, what follows is work."""
    for line in process.stderr:
        if "Progress: " in line:
            return
    raise AssertionError(f"ended before it said anything, with status {process.wait()}")


def oiio(tool, *words):
    """Runs oiiotool or idiff."""
    return run([OIIO_BIN / tool, *words])


def idiff(one, other):
    """Fails the test unless idiff finds both files equal, every part of them. It passes NaN: count those as well."""
    result = oiio("idiff", "-a", "-fail", "0", "-warn", "0", one, other)
    assert result.status == 0, result
