"""What a sequence costs on this machine and on a farm, as a Markdown table. Called by scripts/farm/measure.

Frames of 400 x 400 pixels (three colours and alpha, 20 % of the pixels) are rendered by lacuna and filled by total variation:
by one run, by an array on three virtual nodes of one processor, by both again, and by the array with a node lost on the way.
Each way is taken from an empty folder three times but for the reruns; the middle of the three is told.
"""

import pathlib
import shutil
import statistics
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

import slurm  # noqa: E402
from tool import LACUNA, lacuna  # noqa: E402

CHUNK = 4
FILTER = ["--filter", "tv"]


def local(room):
    lacuna("fill", room / "sparse.####.exr", "-o", room / "local" / "####.exr", "--create-dir", "-u", "-q", *FILTER, timeout=3000)


class Farm:
    """The sequence as an array."""

    def __init__(self, cluster, room, count):
        self.cluster, self.room, self.count = cluster, room, count

    def submit(self):
        said = self.cluster.run(LACUNA, "submit", "slurm", "--chunk", CHUNK, "--logs", self.room / "logs", "--no-verify", "--", "fill",
                                self.room / "sparse.####.exr", "-o", self.room / "farm" / "####.exr", "--create-dir",
                                f"--frames=1-{self.count}", *FILTER)
        return said.split()[1]

    def wait(self, array):
        def completed():
            states = {state for state, *_ in self.cluster.jobs(array).values()}
            assert not states & {"FAILED", "CANCELLED", "TIMEOUT"}, states
            return states == {"COMPLETED"}
        slurm.wait_for("the array", 3000, completed)

    def run(self):
        self.wait(self.submit())

    def run_with_a_loss(self):
        """A node is lost once it has done half of a chunk; seconds until Slurm notices, which its configuration decides."""
        array = self.submit()
        done = set()

        def half():
            log = self.room / "logs" / "lacuna.jsonl"
            lines = log.read_text().splitlines() if log.exists() else []
            for task, (state, _, node) in self.cluster.jobs(array).items():
                done.clear()
                done.update(line for line in lines if f'"task":"{task}"' in line)
                if state == "RUNNING" and node == "n2" and len(done) == CHUNK // 2:
                    return True
            return False

        slurm.wait_for("half a chunk", 600, half, pause=0.05)
        self.cluster.lose("n2")
        lost = time.perf_counter()
        slurm.wait_for("Slurm to notice", 300, lambda: self.cluster.states()["n2"] == "down")
        noticed = time.perf_counter() - lost
        self.wait(array)
        return noticed


def seconds(work):
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def measure(room, cluster, count):
    lacuna("render", ROOT / "samples" / "scenes" / "vessels.toml", "-o", room / "sparse.####.exr", "--density", "0.2", "--size", "400x400",
           "--frames", f"1-{count}", "--set", "camera.orbit=5", "-q", timeout=3000)
    farm = Farm(cluster, room, count)
    whole, array = [], []
    for _ in range(3):
        for name in ("local", "farm", "logs"):
            shutil.rmtree(room / name, ignore_errors=True)
        whole.append(seconds(lambda: local(room))[0])
        array.append(seconds(farm.run)[0])
        assert contents(room / "local") == contents(room / "farm")
    again = seconds(lambda: local(room))[0]
    array_again = seconds(farm.run)[0]
    for name in ("farm", "logs"):
        shutil.rmtree(room / name)
    loss, noticed = seconds(farm.run_with_a_loss)
    assert contents(room / "local") == contents(room / "farm")
    tasks = -(-count // CHUNK)
    print(f"| {count} frames, 400 x 400, `tv` | seconds |\n|---|---:|")
    for what, value in [
        ("one run on this machine", statistics.median(whole)),
        (f"array of {tasks} tasks on three nodes", statistics.median(array)),
        ("the run again with `-u`, all done", again),
        ("the array again, all done", array_again),
        ("the array with a node lost in the middle of a chunk", loss),
        ("of which until Slurm took the node for lost", noticed),
    ]:
        print(f"| {what} | {value:.1f} |")


def main():
    reason = slurm.missing()
    if reason:
        sys.exit(f"farm: {reason} (scripts/farm/test-slurm installs it)")
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 24
    with tempfile.TemporaryDirectory() as folder:
        room = pathlib.Path(folder)
        (room / "slurm").mkdir()
        with slurm.Cluster(room / "slurm") as cluster:
            measure(room, cluster, count)


if __name__ == "__main__":
    main()
