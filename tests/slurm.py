"""A cluster of Slurm on this machine: a controller and virtual nodes, with their own configuration, key, ports and folders.

Every daemon is a child of this process and is stopped at the end, as is whatever they started: all of it carries the path of
the configuration in its environment. A node can be lost as a machine is whose power fails.
"""

import os
import pathlib
import secrets
import shutil
import signal
import socket
import subprocess
import time

PROGRAMS = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel", "sinfo"]
CONFIGURATION = """\
ClusterName=lacuna
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerType=sched/builtin
SchedulerParameters=batch_sched_delay=0,sched_interval=1,sched_min_interval=0
SlurmdParameters=config_overrides
ReturnToService=2
SlurmctldTimeout=30
SlurmdTimeout={timeout}
KillWait=5
MinJobAge=600
{nodes}
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
NODE = "NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={cpus} RealMemory={memory} State=UNKNOWN"


def missing():
    """Why there can be no cluster here, or None."""
    if os.geteuid() != 0:
        return "Slurm's virtual nodes need root"
    absent = [name for name in PROGRAMS if shutil.which(name, path=PATH) is None]
    return f"no {', '.join(absent)}: install slurmctld, slurmd, slurm-client and munge" if absent else None


PATH = os.environ.get("PATH", "") + ":/usr/sbin:/sbin"


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def wait_for(what, seconds, condition, pause=0.2):
    """The first true value of `condition`; fails the test after `seconds`."""
    end = time.monotonic() + seconds
    while True:
        if found := condition():
            return found
        assert time.monotonic() < end, f"{what}: not within {seconds} s"
        time.sleep(pause)


class Cluster:
    """Three nodes of one processor each, unless told otherwise."""

    def __init__(self, folder, nodes=3, cpus=1, memory=2000, timeout=6):
        self.folder = pathlib.Path(folder)
        # The daemons' users look into it.
        self.folder.chmod(0o755)
        self.file = self.folder / "slurm.conf"
        self.names = [f"n{number}" for number in range(1, nodes + 1)]
        port, *ports = free_ports(nodes + 1)
        host = socket.gethostname()
        lines = [NODE.format(name=name, host=host, port=at, cpus=cpus, memory=memory) for name, at in zip(self.names, ports)]
        self.file.write_text(CONFIGURATION.format(host=host, port=port, folder=self.folder, timeout=timeout, nodes="\n".join(lines)))
        self.environment = os.environ | {"SLURM_CONF": str(self.file), "PATH": PATH}
        self.daemons = {}

    def __enter__(self):
        try:
            self.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_):
        self.stop()

    def start(self):
        key = self.folder / "munge.key"
        key.write_bytes(secrets.token_bytes(128))
        key.chmod(0o400)
        (self.folder / "state").mkdir()
        files = [f"--{name}={self.folder}/munge.{name.split('-')[0]}" for name in ["key-file", "pid-file", "log-file", "seed-file", "socket"]]
        self.daemon("munged", "munged", "--foreground", "--force", *files)
        wait_for("munged", 10, (self.folder / "munge.socket").exists)
        self.daemon("slurmctld", "slurmctld", "-D", "-c", "-f", self.file)
        for name in self.names:
            (self.folder / f"spool.{name}").mkdir()
            self.daemon(name, "slurmd", "-D", "-N", name, "-f", self.file)
        wait_for("the nodes", 60, lambda: self.states() == {name: "idle" for name in self.names})

    def daemon(self, name, *command):
        with open(self.folder / f"{name}.out", "wb") as out:
            self.daemons[name] = subprocess.Popen([str(word) for word in command], stdin=subprocess.DEVNULL, stdout=out, stderr=out,
                                                  env=self.environment, start_new_session=True)

    def run(self, *command, ok=True, **options):
        done = subprocess.run([str(word) for word in command], env=self.environment, text=True, capture_output=True, timeout=300, **options)
        assert done.returncode == 0 or not ok, f"{command}\n{done.stdout}{done.stderr}"
        return done.stdout

    def states(self):
        """Node -> state, without the signs for what it does not answer to."""
        lines = self.run("sinfo", "--noheader", "--Node", "--format", "%N %t", ok=False).split("\n")
        return {name: state.rstrip("*") for name, state in (line.split() for line in lines if line)}

    def jobs(self, *numbers):
        """Task ("12_3", or "12" for a job without an array) -> (state, reason, node), of all jobs or of those."""
        chosen = ["--jobs", ",".join(str(number) for number in numbers)] if numbers else []
        lines = self.run("squeue", "--noheader", "--array", "--states=all", "--format=%i|%T|%r|%N", *chosen).splitlines()
        return {task: tuple(rest) for task, *rest in (line.split("|") for line in lines)}

    def processes(self, node=None):
        """What the daemons started, on all nodes or on one: tasks, and first the steps (which report how a task ends)."""
        steps, tasks, mark = set(), [], f"SLURM_CONF={self.file}".encode()
        own = {process.pid for process in self.daemons.values()} | {os.getpid()}
        for entry in pathlib.Path("/proc").iterdir():
            if not entry.name.isdigit() or int(entry.name) in own:
                continue
            try:
                variables = (entry / "environ").read_bytes().split(b"\0")
                parent = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
                if mark not in variables or (node and f"SLURMD_NODENAME={node}".encode() not in variables):
                    continue
                tasks.append(int(entry.name))
                # A step has no environment to be told by.
                if pathlib.Path(f"/proc/{parent}/comm").read_text().startswith("slurmstepd"):
                    steps.add(parent)
            except OSError:
                continue
        return [*steps, *tasks]

    def lose(self, node):
        """The node is gone from one moment to the next, with all that runs on it: nobody reports anything."""
        daemon = self.daemons[node]
        daemon.kill()
        daemon.wait()
        for process in self.processes(node):
            kill(process)

    def stop(self):
        # Nothing of it is used again, and a controller that misses a node ends slowly.
        for process in reversed(self.daemons.values()):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        for process in self.processes():
            kill(process)

    def logs(self):
        """The ends of the daemons' logs, for a test that failed."""
        return "\n".join(f"== {path.name}\n{path.read_text(errors='replace')[-2000:]}" for path in sorted(self.folder.glob("*.log")))


def kill(process):
    try:
        os.kill(process, signal.SIGKILL)
    except ProcessLookupError:
        pass
