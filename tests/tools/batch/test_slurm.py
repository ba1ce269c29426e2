"""A sweep on a real Slurm: the bytes of the local runner, whatever happens to nodes, jobs and the controller.

Starts a cluster of its own (slurm_cluster.py) and stops it. Left out where Slurm is not installed.

Usage: test_slurm.py BINARY
"""
import collections
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
import slurm_cluster
from command_test import BINARY

# 200 items: one tooth, 100 replays of it, and something on each of these.
SWEEP = """
[sweep]
[sweep.over]
depth = { from = 0.05, to = 0.45, steps = 10 }
rate = { from = 100, to = 190, steps = %d }
[[sweep.step]]
name = "cut"
command = "replay"
fill = ["trajectory"]
keep = "score"
arguments = { tooth = "{tooth/tooth.vdb}", trajectory = "path.toml", bur = "ball:D1.2", drive = "direct", rotation_rate_rev_s = "{rate}" }
[[sweep.step]]
name = "tooth"
command = "specimen block"
arguments = { size_mm = "2,2,2", voxel_mm = 0.25 }
"""
# A block that takes seconds and several times the memory that is first asked for.
HEAVY = """
[[item]]
name = "block"
command = "specimen block"
arguments = { size_mm = "12,12,12", voxel_mm = 0.03 }
"""
PATH = """start_mm = [0, 0.7, 0]
axis = [0, 1, 0]
rate_hz = 200
[[segment]]
kind = "line"
to_mm = [0, {above}, 0]
speed_mm_s = %g
"""


def missing():
    names = slurm_cluster.missing()
    return f"not installed: {', '.join(names)} (scripts/install-packages --ci)" if names else None


@unittest.skipIf(missing(), missing())
class Slurm(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="toothprep-slurm-")
        cls.cluster = slurm_cluster.Cluster(os.path.join(cls.folder, "cluster"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.addClassCleanup(cls.cluster.stop)
        cls.cluster.start()

    def setUp(self):
        self.work = tempfile.mkdtemp(dir=self.folder)

    def write_sweep(self, rates=20, speed=4.0):
        Path(self.work, "sweep.toml").write_text(SWEEP % rates)
        Path(self.work, "path.toml").write_text(PATH.replace("{above}", "-{depth}") % speed)

    def batch(self, *more, code=0, **options):
        done = subprocess.run([BINARY, "batch", "sweep.toml", *more], cwd=self.work, env=self.cluster.environment,
                              capture_output=True, text=True, timeout=200, **options)
        if code is not None:
            self.assertEqual(done.returncode, code, done.stderr + done.stdout + self.logs())
        return done

    def logs(self):
        return "".join(f"\n{path}: {path.read_text()[-500:]}" for path in Path(self.work).rglob("*.log")
                       if path.stat().st_size)

    def submit(self, *more):
        return self.batch("-o", "far", "--runner", "slurm", "--job-memory-mb", "100", *more)

    def wait(self):
        return self.batch("-o", "far", "--runner", "slurm", "--wait", "--job-memory-mb", "100", "--items-per-job", "10")

    def done(self, folder="far"):
        # os.walk: folders of parts come and go meanwhile
        return sum("item.json" in files for _, _, files in os.walk(os.path.join(self.work, folder)))

    def assert_same_as_local(self, names=("batch.csv", "batch.json", "batch.h5", "summary.csv")):
        self.batch("-o", "near", "--quiet")
        for name in names:
            self.assertEqual(Path(self.work, "far", name).read_bytes(), Path(self.work, "near", name).read_bytes(), name)
        # Nothing ran twice to its end: one line for each item in all ledgers.
        lines = collections.Counter()
        for path in Path(self.work, "far/.batch/rows").glob("job-*.rows"):
            for line in path.read_text().splitlines():
                if json.loads(line.split("\t")[1])["failed"] is False:
                    lines[line.split("\t")[0]] += 1
        self.assertEqual([name for name, count in lines.items() if count > 1], [])

    def test_200_items_give_the_local_runners_bytes(self):
        self.write_sweep()
        said = self.submit("--items-per-job", "25").stderr
        self.assertIn("201 items are submitted", said)
        self.assertIn("at work on it", self.batch("-o", "far", "--runner", "slurm", code=1).stderr)
        status = self.batch("-o", "far", "--status").stdout
        self.assertIn("201 items", status)
        self.wait()
        self.assert_same_as_local()
        self.assertIn("201 done, 0 failed, 0 not run yet", self.batch("-o", "far", "--status").stdout)

    def test_a_node_that_dies_one_that_is_drained_and_a_controller_that_restarts_lose_nothing(self):
        self.write_sweep(rates=6, speed=0.5)
        self.submit("--items-per-job", "8")
        self.cluster.wait_until(lambda: self.done() > 3, "first items")
        self.cluster.kill("n1")  # its workers live on: nobody may run their items meanwhile
        self.cluster.kill("slurmctld")
        self.cluster.start_controller()
        self.cluster.wait_until(lambda: self.done() > 12, "further items")
        self.cluster.start_node("n1")
        self.cluster.run("scontrol", "update", "NodeName=n2", "State=DRAIN", "Reason=test")
        self.wait()
        self.cluster.run("scontrol", "update", "NodeName=n2", "State=RESUME")
        self.assert_same_as_local()

    def test_jobs_that_are_killed_are_followed_by_others(self):
        self.write_sweep(rates=3, speed=0.5)
        self.submit("--items-per-job", "15")
        self.cluster.wait_until(lambda: self.done() > 3, "first items")
        record = json.loads(Path(self.work, "far/.batch/slurm/round-1.json").read_text())
        self.cluster.run("scancel", "--signal=KILL", "--full", record["jobs"][1])
        self.wait()
        self.assertTrue(Path(self.work, "far/.batch/slurm/round-2.json").exists())
        self.assert_same_as_local()

    def test_more_time_is_asked_for_after_a_time_limit(self):
        # The least that can be asked for is a minute: a worker that stands still comes to it.
        self.write_sweep(rates=2, speed=0.5)
        self.submit("--items-per-job", "20", "--job-minutes", "1")
        claims = Path(self.work, "far/.batch/claims")
        self.cluster.wait_until(lambda: self.done() > 2 and list(claims.glob("cut-*")), "first items")
        worker = int(next(claims.glob("cut-*")).read_text().split()[0].split("-")[2])
        os.kill(worker, signal.SIGSTOP)
        self.wait()
        first, second = (json.loads(Path(self.work, f"far/.batch/slurm/round-{n}.json").read_text()) for n in (1, 2))
        self.assertEqual(second["minutes"], 2 * first["minutes"])
        self.assert_same_as_local()

    def test_an_item_that_outgrows_its_memory_is_killed_and_gets_more(self):
        Path(self.work, "sweep.toml").write_text(HEAVY)
        self.submit("--items-per-job", "1")
        self.wait()
        asked = [json.loads(path.read_text())["memory_mb"]
                 for path in sorted(Path(self.work, "far/.batch/slurm").glob("round-*.json"))]
        said = "".join(path.read_text() for path in Path(self.cluster.folder).glob("slurmd-n*.log"))
        self.assertIn("exceeded memory limit", said)
        self.assertGreater(len(asked), 1)
        self.assertEqual(asked, [100 * 2**n for n in range(len(asked))])
        self.assert_same_as_local(("batch.csv", "batch.json", "batch.h5"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
