"""Items and jobs that are killed for want of memory run again with more, on a stand-in for Slurm's programs.

Usage: test_memory_rounds.py BINARY
"""
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest

MANIFEST = """
[[item]]
name = "long"
command = "replay"
arguments = { tooth = "block.vdb", trajectory = "path.toml", bur = "ball:D1.2", drive = "direct" }
"""
PATH = """start_mm = [0, 0.7, 0]
axis = [0, 1, 0]
rate_hz = 1000
[[segment]]
kind = "line"
to_mm = [0, 0.5, 0]
speed_mm_s = 0.002
"""
# Jobs are queued as files, and run by the test.
SBATCH = """#!/bin/sh
n=$(($(cat "$FAKE/count") + 1)); echo $n > "$FAKE/count"
for word in "$@"; do case $word in --array=*) touch "$FAKE/array.$n";; esac; script=$word; done
cp "$script" "$FAKE/job.$n"; echo $n
"""


# Of nodes and of partitions.
SINFO = """#!/bin/sh
case "$*" in *%l*) cat "$FAKE/limits.txt";; *) cat "$FAKE/sinfo.txt";; esac
"""


class MemoryRounds(CommandTest):
    def setUp(self):
        type(self).folder = tempfile.mkdtemp(prefix="toothprep-memory-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "2", "--voxel-mm", "0.2", "--enamel-mm", "1")
        self.write("manifest.toml", MANIFEST)
        self.write("path.toml", PATH)
        self.write("fake/count", "0\n")
        for name, text in (("sbatch", SBATCH), ("squeue", '#!/bin/sh\ncat "$FAKE/squeue.txt"\n'),
                           ("sacct", '#!/bin/sh\ncat "$FAKE/sacct.txt"\n'), ("scontrol", "#!/bin/sh\nexit 1\n"),
                           ("sinfo", SINFO)):
            self.write(f"fake/{name}", text)
            os.chmod(self.path(f"fake/{name}"), 0o755)
        self.write("fake/squeue.txt", "")
        self.write("fake/sinfo.txt", "")
        self.write("fake/limits.txt", "")
        self.environment = dict(os.environ, FAKE=self.path("fake"), PATH=self.path("fake") + ":" + os.environ["PATH"])

    def submit(self):
        done = self.run_tool("batch", "manifest.toml", "-o", "out", "--runner", "slurm", "--job-memory-mb", "100",
                             "--job-minutes", "10", env=self.environment)
        self.assertEqual(done.returncode, 0, done.stderr)

    def job(self, number, kill=False):
        """Runs one, and kills the item that it works on."""
        array = os.path.exists(self.path(f"fake/array.{number}"))
        environment = dict(self.environment, SLURM_JOB_ID=str(number))
        if array:
            environment.update(SLURM_ARRAY_JOB_ID=str(number), SLURM_ARRAY_TASK_ID="0")
        worker = subprocess.Popen(["sh", self.path(f"fake/job.{number}")], cwd=self.folder, env=environment,
                                  stderr=subprocess.PIPE, text=True)
        if kill:
            os.kill(self.item_at_work(), signal.SIGKILL)
        self.assertEqual((worker.communicate(timeout=120)[1], worker.returncode), ("", 0))

    def item_at_work(self):
        for _ in range(10000):
            for pid in filter(str.isdigit, os.listdir("/proc")):
                try:
                    if os.readlink(f"/proc/{pid}/cwd").startswith(self.path("out/")):
                        return int(pid)
                except OSError:
                    pass
            time.sleep(0.005)
        self.fail("no item ever ran")

    def asked(self, number):
        """Minutes and megabytes of a round."""
        with open(self.path(f"out/.batch/slurm/round-{number}.json"), encoding="utf-8") as file:
            record = json.load(file)
        return record["minutes"], record["memory_mb"]

    def test_an_item_that_was_killed_gets_twice_the_memory_though_its_job_ended_well(self):
        self.submit()
        self.job(1, kill=True)
        self.write("fake/squeue.txt", "1 COMPLETED\n2 RUNNING\n")
        self.write("fake/sacct.txt", "COMPLETED\n")
        self.job(2)
        self.assertEqual((self.asked(1), self.asked(2)), ((10, 100), (10, 200)))
        self.assertIn("--mem-per-cpu=200M", self.read("fake/job.3").decode())
        self.job(3)
        self.job(4)
        self.assertIn(b"long,done", self.read("out/batch.csv"))
        self.assertTrue(os.path.exists(self.path("out/.batch/slurm/complete")))

    def test_the_accounts_tell_a_lack_of_memory_from_a_lack_of_time_when_squeue_has_forgotten(self):
        self.submit()
        for state, asked in (("OUT_OF_MEMORY", (10, 200)), ("TIMEOUT", (20, 200)), ("CANCELLED by 0", (20, 200))):
            collector = int(self.read("fake/count"))
            self.write("fake/sacct.txt", state + "\n")
            self.job(collector)
            self.assertEqual(self.asked(collector // 2 + 1), asked, state)

    def test_a_job_that_only_failed_gets_more_memory_where_its_log_names_the_memory(self):
        self.submit()
        self.write("fake/squeue.txt", "1 FAILED\n")
        self.write("fake/sacct.txt", "FAILED\n")
        for log, asked in (("toothprep: exceeded memory limit\n", (10, 100)),
                           ("slurmstepd-n1: error: StepId=1.batch exceeded memory limit (2 > 1), being killed\n", (10, 200))):
            collector = int(self.read("fake/count"))
            self.write(f"out/.batch/slurm/round-{collector // 2}/1_0.log", log)
            self.job(collector)
            self.assertEqual(self.asked(collector // 2 + 1), asked, log)

    def test_no_more_memory_is_asked_for_than_the_largest_node_has(self):
        self.write("fake/sinfo.txt", "150\n330\n240\n")
        self.write("fake/sacct.txt", "OUT_OF_MEMORY\n")
        self.submit()
        for asked in (200, 330, 330):
            collector = int(self.read("fake/count"))
            self.job(collector)
            self.assertEqual(self.asked(collector // 2 + 1), (10, asked))

    def test_no_more_time_is_asked_for_than_the_partition_allows(self):
        self.write("fake/sacct.txt", "TIMEOUT\n")
        for text, minutes in (("short 5:00\nall* 35:00\n", 35), ("all* 1:10:30\n", 70), ("all* 1-00:00:00\nx 1:00\n", 80),
                              ("all* infinite\n", 80)):
            self.write("fake/limits.txt", text)
            shutil.rmtree(self.path("out"), ignore_errors=True)
            self.write("fake/count", "0\n")
            self.submit()
            for _ in range(3):
                self.job(int(self.read("fake/count")))
            self.assertEqual(self.asked(4), (minutes, 100), text)
        self.write("fake/limits.txt", "all* 5:00\n")
        shutil.rmtree(self.path("out"), ignore_errors=True)
        refused = self.run_tool("batch", "manifest.toml", "-o", "out", "--runner", "slurm", "--job-minutes", "10",
                                env=self.environment)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("--job-minutes 10: jobs of the partition may take 5 minutes at most", refused.stderr)
        self.assertFalse(os.path.exists(self.path("out/.batch/slurm")))

    def test_without_accounts_both_are_doubled(self):
        self.submit()
        os.remove(self.path("fake/sacct"))
        self.job(2)
        self.assertEqual(self.asked(2), (20, 200))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
