"""toothprep batch as a user runs it: replays of a block, resumed, interrupted, with a bad item.

Usage: test_batch_command.py BINARY
"""
import csv
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
from command_test import BINARY, CommandTest
from tables import check_same_table

MANIFEST = """
[defaults]
command = "replay"
arguments = { tooth = "block.vdb", bur = "ball:D1.2", drive = "direct" }
[[item]]
name = "shallow"
arguments = { trajectory = "paths/shallow.toml", prepared = true }
[[item]]
name = "broken"
arguments = { trajectory = "paths/broken.toml" }
[[item]]
name = "deep"
arguments = { trajectory = "paths/deep.toml" }
"""


class Batch(CommandTest):
    def setUp(self):
        type(self).folder = tempfile.mkdtemp(prefix="toothprep-batch-")  # each test its own
        self.addCleanup(shutil.rmtree, self.folder)
        self.run_tool("specimen", "block", "-o", "block.vdb", "--size-mm", "4", "--voxel-mm", "0.2")
        self.write("paths/broken.toml", "axis = [0, 0, 0]\n")
        for name, depth in (("shallow", -0.5), ("deep", -1.5), ("long", -3.9)):
            speed = 0.01 if name == "long" else 2
            self.write(f"paths/{name}.toml",
                       f'start_mm = [0, 0.7, 0]\naxis = [0, 1, 0]\nrate_hz = 1000\n[[segment]]\nkind = "line"\n'
                       f'to_mm = [0, {depth}, 0]\nspeed_mm_s = {speed}\n')
        self.write("manifest.toml", MANIFEST)

    def test_replays_resumes_and_names_what_failed(self):
        done = self.run_tool("batch", "manifest.toml", "-o", "out", "--threads", "2")
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("1 of 3 items failed: broken", done.stderr.splitlines()[-1])
        self.assertEqual(done.stdout, "")
        with open(self.path("out/batch.csv"), newline="") as f:
            rows = list(csv.DictReader(f))
        self.assertEqual([r["name"] for r in rows], ["shallow", "broken", "deep"])
        self.assertEqual([r["status"] for r in rows], ["done", "failed", "done"])
        self.assertIn("broken.toml", rows[1]["reason"])
        self.assertGreater(float(rows[2]["removed_mm3.enamel"]), float(rows[0]["removed_mm3.enamel"]))
        self.assertNotIn("realtime_factor", rows[0])
        self.assertEqual(sorted(os.listdir(self.path("out/shallow"))),
                         ["item.json", "log.txt", "prepared.vdb", "replay.json", "trace.h5"])
        columns = check_same_table(self, self.path("out"))
        self.assertEqual(columns["steps"].dtype, "float64")  # a failed item has none
        table = self.read("out/batch.csv") + self.read("out/batch.json") + self.read("out/batch.h5")
        # Another number at a time in another folder: the same bytes.
        self.run_tool("batch", "manifest.toml", "-o", "other", "--threads", "1")
        self.assertEqual(self.read("other/batch.csv") + self.read("other/batch.json") + self.read("other/batch.h5"), table)
        self.assertEqual(self.read("other/deep/trace.h5"), self.read("out/deep/trace.h5"))
        # Mended, only that one runs.
        shutil.copy(self.path("paths/deep.toml"), self.path("paths/broken.toml"))
        done = self.run_tool("batch", "manifest.toml", "-o", "out")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("3 items, 1 run now", done.stderr)
        with open(self.path("out/batch.json")) as f:
            items = json.load(f)["items"]
        self.assertEqual(items[1]["figures"], items[2]["figures"])
        columns = check_same_table(self, self.path("out"))
        self.assertEqual((columns["steps"].dtype, columns["plausible"].dtype), ("int64", "bool"))

    def test_interrupt_keeps_what_is_done(self):
        self.write("manifest.toml", MANIFEST.replace("broken", "long"))
        child = subprocess.Popen([BINARY, "batch", "manifest.toml", "-o", "out", "--threads", "3"], cwd=self.folder,
                                 stderr=subprocess.PIPE, text=True)
        for _ in range(600):
            if all(os.path.exists(self.path(p)) for p in ("out/deep/item.json", "out/shallow/item.json")):
                break
            time.sleep(0.1)
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=60)
        self.assertEqual(child.returncode, 1)
        self.assertIn("interrupted after 2 of 3", said.splitlines()[-1])
        self.assertEqual(sorted(n for n in os.listdir(self.path("out")) if n[0] != "."), ["deep", "shallow"])

    def test_a_killed_batch_leaves_no_process_and_the_next_clears_up(self):
        self.write("manifest.toml", MANIFEST.replace("broken", "long"))
        child = subprocess.Popen([BINARY, "batch", "manifest.toml", "-o", "out", "--threads", "3"], cwd=self.folder,
                                 stderr=subprocess.DEVNULL)
        self.wait_until(lambda: os.path.exists(self.path("out/deep/item.json")) and self.processes())
        child.kill()
        child.wait()
        self.wait_until(lambda: not self.processes())
        self.write("manifest.toml", MANIFEST.replace("broken", "deep").replace('name = "deep"', 'name = "again"', 1))
        done = self.run_tool("batch", "manifest.toml", "-o", "out")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual([n for n in os.listdir(self.path("out")) if n.startswith(".toothprep")], [])

    def wait_until(self, true):
        for _ in range(600):
            if true():
                return
            time.sleep(0.1)
        self.fail("it never happened")

    def processes(self):
        """Those that work below the results."""
        found = []
        for pid in filter(str.isdigit, os.listdir("/proc")):
            try:
                if os.readlink(f"/proc/{pid}/cwd").startswith(self.path("out/")):
                    found.append(pid)
            except OSError:
                pass
        return found

    def test_refuses_before_anything_runs(self):
        for text, says in ((MANIFEST.replace("drive", "drvie"), "did you mean 'drive'?"),
                           (MANIFEST.replace("block.vdb", "brick.vdb"), "there is no file"),
                           (MANIFEST.replace('"deep"', '"shallow"'), "is used twice"),
                           ("", "names no item")):
            self.write("manifest.toml", text)
            done = self.run_tool("batch", "manifest.toml", "-o", "out")
            self.assertEqual(done.returncode, 1)
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
            self.assertIn(says, done.stderr)
            self.assertFalse(os.path.exists(self.path("out")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
