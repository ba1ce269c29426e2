"""A small sweep as a user runs it: estimate, run, status, plots; workers beside one another; what goes wrong.

Usage: test_study.py BINARY PLOT_BATCH
"""
import csv
import importlib.machinery
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import BINARY, CommandTest
from tables import check_same_table

PLOT = os.path.abspath(sys.argv[2])
STUDY_PAGE = Path(__file__).resolve().parents[3] / "data/batch/study.md"
try:
    import pandas
except ImportError:
    pandas = None
SWEEP = """
[sweep]
[sweep.over]
depth = [0.2, 0.4]
bur = ["ball:D1.2", "cylinder:D0.8xL1.0"]
[[sweep.step]]
name = "cut"
command = "replay"
fill = ["trajectory"]
keep = "score"
arguments = { tooth = "{tooth/tooth.vdb}", trajectory = "path.toml", bur = "{bur}", drive = "direct", prepared = true }
[[sweep.step]]
name = "tooth"
command = "specimen block"
arguments = { size_mm = 2, voxel_mm = 0.2, enamel_mm = 1 }
[[sweep.step]]
name = "judged"
command = "score"
keep = "score"
arguments = { original = "{tooth/tooth.vdb}", prepared = "{cut/prepared.vdb}", trace = "{cut/trace.h5}", type = "class1" }
"""
PATH = """start_mm = [0, 0.7, 0]
axis = [0, 1, 0]
rate_hz = 500
[[segment]]
kind = "line"
to_mm = [0, -{depth}, 0]
speed_mm_s = 2
"""


class Study(CommandTest):
    def setUp(self):
        type(self).folder = tempfile.mkdtemp(prefix="toothprep-study-")
        self.addCleanup(shutil.rmtree, self.folder)
        self.write("sweep.toml", SWEEP)
        self.write("path.toml", PATH)

    def batch(self, *more):
        return self.run_tool("batch", "sweep.toml", "-o", "out", *more)

    def test_from_the_estimate_to_the_plots(self):
        plan = self.batch("--dry-run")
        self.assertEqual(plan.returncode, 0, plan.stderr)
        self.assertIn("9 items, 4 points", plan.stdout)
        self.assertRegex(plan.stdout, r"cut +replay +4 ")
        self.assertNotIn("the disk won't do", plan.stdout)
        self.assertFalse(os.path.exists(self.path("out")))
        self.assertIn("0 done, 0 failed, 9 not run yet", self.batch("--status").stdout)
        done = self.batch("--threads", "2")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("9 items, 9 run now", done.stderr)
        self.assertIn("9 done, 0 failed, 0 not run yet", self.batch("--status").stdout)
        self.assertIn("9 items, 0 run now", self.batch().stderr)
        with open(self.path("out/batch.csv"), newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        removed = {(r["sweep.bur"], r["sweep.depth"]): float(r["removed_mm3.enamel"]) for r in rows if r["step"] == "cut"}
        for bur in ("ball:D1.2", "cylinder:D0.8xL1.0"):
            self.assertGreater(removed[bur, "0.4"], removed[bur, "0.2"])
        # Of each cut only the figures stay; the tooth stays whole.
        kept = {p.name for p in Path(self.path("out/points")).rglob("*") if p.is_file()}
        self.assertEqual(kept, {"item.json", "log.txt", "replay.json", "score.json", "tooth.vdb", "trajectory.toml"})
        self.assertIn("cut,removed_mm3.enamel,depth,0.2,2,", self.read("out/summary.csv").decode())
        check_same_table(self, self.path("out"))
        with h5py.File(self.path("out/batch.h5")) as table:
            units = {name: table["items"][name].attrs.get("units") for name in table["items"]}
        self.assertEqual((units["removed_mm3.enamel"], units["peak_force_n"], units["process.mean_feed_mm_s"],
                          units["criteria.depth_mm.value"], units["criteria.depth_mm.points"], units["sweep.bur"]),
                         ("mm^3", "N", "mm/s", "mm", None, None))
        for kind in (["--tornado"], ["--curve", "depth", "--by", "bur"], ["--heatmap", "depth,bur"]):
            self.plot(*kind)

    @unittest.skipUnless(pandas, "python3-pandas is not installed")
    def test_the_pages_line_opens_the_table_in_pandas(self):
        self.batch("--quiet")
        line = re.search(r"`(table = pandas.DataFrame\(.*\))`", STUDY_PAGE.read_text(encoding="utf-8")).group(1)
        scope = {"pandas": pandas, "h5py": h5py}
        exec(line.replace("results/", self.path("out/")), scope)  # the page's own line
        table, text = scope["table"], pandas.read_csv(self.path("out/batch.csv"), keep_default_na=False)
        self.assertEqual(list(table.columns), list(text.columns))
        self.assertEqual(list(table["name"]), list(text["name"]))
        removed = table[table.step == "cut"].groupby("sweep.bur")["removed_mm3.enamel"].mean()
        self.assertEqual(sorted(removed.index), ["ball:D1.2", "cylinder:D0.8xL1.0"])

    def plot(self, *kind):
        line = [PLOT, "out", "--step", "cut", "--figure", "removed_mm3.enamel", "-o", f"{kind[0][2:]}.png"]
        done = subprocess.run(line + list(kind), cwd=self.folder, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.read(line[-1])[:4], b"\x89PNG")
        again = subprocess.run(line + list(kind), cwd=self.folder, capture_output=True, text=True, timeout=120)
        self.assertIn("exists already", again.stderr)

    def test_labels_of_a_tornado_stay_within_its_axes(self):
        import matplotlib
        matplotlib.use("Agg")
        import matplotlib.pyplot as plt
        sys.dont_write_bytecode = True
        loader = importlib.machinery.SourceFileLoader("plot_batch", PLOT)
        plot = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
        loader.exec_module(plot)
        rows = [({"rate_rev_s": f"{rate}.4375", "bur": bur}, 1000 / rate + len(bur))
                for rate in range(80, 300, 10) for bur in ("ball:D1.2", "cylinder:D0.8xL1.5")]
        figure, axes = plt.subplots(figsize=(7, 4.2), layout="constrained")
        plot.draw_tornado(axes, rows, ["rate_rev_s", "bur"], "force")
        figure.draw_without_rendering()
        frame = axes.get_window_extent()
        self.assertEqual(len(axes.texts), 4)
        for label in axes.texts:
            box = label.get_window_extent()
            self.assertGreaterEqual(box.x0, frame.x0, label.get_text())
            self.assertLessEqual(box.x1, frame.x1, label.get_text())

    def test_workers_on_the_same_items_do_each_of_them_once(self):
        self.batch("--only", "tooth", "--quiet")
        names = [r for r in self.names() if r.startswith("cut")]
        self.write("list.txt", "\n".join(names) + "\n")
        line = [BINARY, "batch", "sweep.toml", "-o", "out", "--runner", "slurm", "--work-on", "list.txt", "--quiet"]
        workers = [subprocess.Popen(line, cwd=self.folder, stderr=subprocess.PIPE, text=True) for _ in range(3)]
        for worker in workers:
            self.assertEqual((worker.communicate(timeout=120)[1], worker.returncode), ("", 0))
        lines = [text.split("\t")[0] for path in Path(self.path("out/.batch/rows")).glob("*.rows")
                 for text in path.read_text().splitlines()]
        self.assertEqual(sorted(name for name in lines if name.startswith("cut")), sorted(names))

    def names(self):
        """Of all items, by running them elsewhere."""
        self.run_tool("batch", "sweep.toml", "-o", "all", "--quiet")
        with open(self.path("all/batch.csv"), newline="", encoding="utf-8") as file:
            return [r["name"] for r in csv.DictReader(file)]

    def test_a_folder_that_cannot_be_made_and_slurm_that_is_not_there_are_refused(self):
        done = self.run_tool("batch", "sweep.toml", "-o", "absent/out")
        self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
        done = subprocess.run([BINARY, "batch", "sweep.toml", "-o", "out", "--runner", "slurm"], cwd=self.folder,
                              env={"PATH": "/nowhere"}, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 1)
        self.assertIn("sbatch is not installed", done.stderr)
        self.assertFalse(os.path.exists(self.path("out")))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
