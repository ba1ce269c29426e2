"""A Slurm of its own on this machine: munge, a controller and node daemons on the loopback address, under one folder."""
import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "mungekey")
PATH = os.environ["PATH"] + ":/usr/sbin:/sbin"


def missing():
    """The programs that are not installed."""
    return [name for name in PROGRAMS if not shutil.which(name, path=PATH)]


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


class Cluster:
    """Nodes n1, n2, ... of `cpus` processors each. `stop()` ends every process that was started, by its id."""

    def __init__(self, folder, nodes=2, cpus=2):
        self.folder, self.processes = Path(folder), {}
        self.nodes = [f"n{i + 1}" for i in range(nodes)]
        ports = free_ports(nodes + 1)
        for name in ("state", "munge", *("spool-" + node for node in self.nodes)):
            (self.folder / name).mkdir(parents=True)
        os.chmod(self.folder, 0o755)
        os.chmod(self.folder / "munge", 0o755)
        user = subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip()
        host = socket.gethostname().split(".")[0]
        lines = [f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={cpus} RealMemory=2000 State=UNKNOWN"
                 for node, port in zip(self.nodes, ports[1:])]
        (self.folder / "slurm.conf").write_text(f"""ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={self.folder}/munge/socket
CredType=cred/munge
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/spool-%n
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/slurmd-%n.pid
SlurmctldLogFile={self.folder}/slurmctld.log
SlurmdLogFile={self.folder}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SchedulerType=sched/backfill
SchedulerParameters=sched_interval=1,batch_sched_delay=0,defer,sched_min_interval=0
ReturnToService=2
MpiDefault=none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=1
JobAcctGatherParams=OverMemoryKill,UsePss
AccountingStorageType=accounting_storage/none
SlurmdTimeout=10
SlurmctldTimeout=10
InactiveLimit=0
KillWait=3
MinJobAge=300
OverTimeLimit=0
""" + "\n".join(lines) + f"\nPartitionName=main Nodes={','.join(self.nodes)} Default=YES MaxTime=INFINITE State=UP\n")
        (self.folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
        self.environment = dict(os.environ, PATH=PATH, SLURM_CONF=str(self.folder / "slurm.conf"))

    def start(self):
        key, sock = self.folder / "munge/key", self.folder / "munge/socket"
        subprocess.run(["mungekey", "--create", f"--keyfile={key}"], check=True, env=self.environment)
        self._spawn("munged", ["munged", "--foreground", "--force", f"--key-file={key}", f"--socket={sock}",
                               f"--pid-file={self.folder}/munge/pid", f"--seed-file={self.folder}/munge/seed",
                               f"--log-file={self.folder}/munge/log"])
        self.wait_until(sock.exists, "munge")
        self.start_controller()
        for node in self.nodes:
            self.start_node(node)
        self.wait_until(lambda: set(self.node_states().values()) == {"idle"}, "idle nodes")

    def start_controller(self):
        self._spawn("slurmctld", ["slurmctld", "-D"])

    def start_node(self, node):
        self._spawn(node, ["slurmd", "-D", "-N", node])

    def _spawn(self, name, line):
        with open(self.folder / (name + ".out"), "a", encoding="utf-8") as log:
            self.processes[name] = subprocess.Popen(line, env=self.environment, stdout=log, stderr=log,
                                                    stdin=subprocess.DEVNULL)

    def kill(self, name, how=signal.SIGKILL):
        process = self.processes.pop(name)
        process.send_signal(how)
        process.wait(timeout=30)

    def stop(self):
        for name in ("slurmctld", *self.nodes, "munged"):
            process = self.processes.get(name)
            if process:
                process.terminate()
                try:
                    process.wait(timeout=10)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        self.processes.clear()

    def run(self, *line):
        return subprocess.run(line, env=self.environment, capture_output=True, text=True, timeout=60)

    def node_states(self):
        out = self.run("sinfo", "-h", "-N", "-o", "%N %t").stdout
        return dict(line.split() for line in out.splitlines())

    def wait_until(self, true, what, seconds=60):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if true():
                return
            time.sleep(0.1)
        raise AssertionError(f"{what}: not within {seconds} s")
