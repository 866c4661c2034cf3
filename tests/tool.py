"""Runs lacuna and the tools of others as processes, and says what they used."""

import dataclasses
import os
import pathlib
import subprocess
import tempfile
import threading
import time

import OpenImageIO

ROOT = pathlib.Path(__file__).resolve().parent.parent
DATA = ROOT.parent / "shared" / "data"
SAMPLES = ROOT / "samples"
LACUNA = os.environ.get("LACUNA", str(ROOT / "target" / "release" / "lacuna"))
# The commands that the wheel puts on the PATH are slow wrappers; these are the binaries.
OIIO_BIN = pathlib.Path(OpenImageIO.__file__).parent / "bin"


@dataclasses.dataclass
class Result:
    """What a process did: exit status (negative: the signal), its output, its peak memory (see `Peak`), the seconds that
    it took and those that it kept processors busy."""

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


class Peak(threading.Thread):
    """The most memory that a process held, looked at every hundredth of a second.

    What the kernel says at its end is never less than what this process held when it started the other."""

    def __init__(self, process):
        super().__init__(daemon=True)
        self.status = pathlib.Path(f"/proc/{process.pid}/status")
        self.ended = threading.Event()
        self.bytes = 0

    def run(self):
        while not self.ended.wait(0.01):
            try:
                lines = self.status.read_text().splitlines()
            except OSError:
                return
            self.bytes = max([self.bytes, *(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM"))])

    def end(self, kernel):
        """The peak; the kernel's word where the process was too short to be looked at."""
        self.ended.set()
        self.join()
        return min(self.bytes or kernel, kernel)


def run(command, timeout=600, environment=None, before=None, folder=None):
    """Runs a command to its end; it is killed after `timeout` seconds (status -9)."""
    command = [str(word) for word in command]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        start = time.perf_counter()
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, cwd=folder,
                                   env=None if environment is None else os.environ | environment, preexec_fn=before)
        alarm = threading.Timer(timeout, process.kill)
        alarm.start()
        peak = Peak(process)
        peak.start()
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        alarm.cancel()
        peak_bytes = peak.end(usage.ru_maxrss * 1024)
        process.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for stream in (out, err):
            stream.seek(0)
            texts.append(stream.read().decode("utf-8", "replace"))
    return Result(command, process.returncode, *texts, peak_bytes, seconds, usage.ru_utime + usage.ru_stime)


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
