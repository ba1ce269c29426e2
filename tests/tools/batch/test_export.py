"""The items of a batch as lines of sh and as a Snakefile: the same files as the batch itself makes.

Usage: test_export.py BINARY
"""
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest

# A sweep whose cuts keep only figures, and an item whose name needs quotes everywhere.
MANIFEST = """
[[item]]
name = "anna's work, & more"
command = "score"
after = ["second"]
arguments = { original = "{cavity/original.vdb}", prepared = "{cavity/prepared.vdb}", type = "class1" }
[[item]]
name = "cavity"
command = "specimen cavity"
arguments = { voxel_mm = 0.5, original = true }
[[item]]
name = "second"
command = "specimen block"
arguments = { size_mm = 2, voxel_mm = 0.5, enamel_mm = 1 }
[sweep]
[sweep.over]
depth = [0.2, 0.4]
note = ["a/b & c", '\\\\d']
[[sweep.step]]
name = "cut"
command = "replay"
fill = ["trajectory"]
keep = "score"
arguments = { tooth = "{tooth/tooth.vdb}", trajectory = "path.toml", bur = "ball:D1.2", drive = "direct", prepared = true }
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
PATH = """# {note}
start_mm = [0, 0.7, 0]
axis = [0, 1, 0]
rate_hz = 500
[[segment]]
kind = "line"
to_mm = [0, -{depth}, 0]
speed_mm_s = 2
"""
UNREPEATABLE = ("realtime_factor", "step_us_p50", "step_us_p99", "step_us_max")


class Export(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.write("path.toml", PATH)
        # What the lines of sh write stays; of what Snakemake writes only what is kept, and a folder.
        cls.write("manifest.toml", MANIFEST)
        cls.write("snake.toml", MANIFEST.replace('type = "class1" }', 'type = "class1", report = true }', 1))
        cls.write("keep.toml", MANIFEST.replace('keep = "score"', ""))
        for manifest, folder in (("snake.toml", "kept"), ("keep.toml", "all")):
            cls.run_ok("batch", manifest, "-o", "out", "--quiet")
            os.rename(cls.path("out"), cls.path(folder))

    def export(self, what, manifest="manifest.toml"):
        shutil.rmtree(self.path("out"), ignore_errors=True)
        done = self.run_ok("batch", manifest, "-o", "out", "--export", what)
        self.assertFalse(os.path.exists(self.path("out")))
        return done.stdout

    def files(self, folder, without):
        top = Path(self.path(folder))
        found = {}
        for path in top.rglob("*"):
            name = str(path.relative_to(top))
            if not path.is_file() or name.startswith((".", "batch.", "index.", "summary.")) or path.name in without:
                continue
            content = path.read_bytes()
            if path.name == "replay.json":
                content = {key: value for key, value in json.loads(content).items() if key not in UNREPEATABLE}
            found[name] = content
        return found

    def assert_same(self, folder, without=("item.json",)):
        expected, got = self.files(folder, without), self.files("out", without)
        self.assertEqual(sorted(got), sorted(expected))
        for name, content in expected.items():
            self.assertEqual(got[name], content, name)

    def test_run_one_after_the_other_the_lines_write_what_the_batch_writes(self):
        self.write("commands.txt", self.export("commands"))
        done = subprocess.run(["sh", "commands.txt"], cwd=self.folder, capture_output=True, text=True, timeout=120)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        self.assert_same("all")
        # What is there is never written over.
        again = subprocess.run(["sh", "commands.txt"], cwd=self.folder, capture_output=True, text=True, timeout=120)
        self.assertEqual(again.stderr.count("File exists"), 12)
        self.assert_same("all")

    def test_level_by_level_they_run_at_the_same_time(self):
        text = self.export("commands")
        levels = re.split(r"^# level \d+: .*\n", text, flags=re.M)[1:]
        self.assertEqual([len(level.splitlines()) for level in levels], [3, 5, 4])
        for level in levels:
            done = subprocess.run(["xargs", "-d", "\\n", "-P", "4", "-n", "1", "sh", "-c"], input=level, cwd=self.folder,
                                  capture_output=True, text=True, timeout=120)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assert_same("all")

    @unittest.skipUnless(shutil.which("parallel"), "parallel is not installed")
    def test_the_pages_lines_run_them_with_gnu_parallel(self):
        page = (Path(__file__).resolve().parents[3] / "data/batch/study.md").read_text(encoding="utf-8")
        line = re.search(r"^for n in .*parallel.*$", page, re.M).group(0)
        self.write("commands.txt", self.export("commands"))
        done = subprocess.run(["sh", "-c", line], cwd=self.folder, capture_output=True, text=True, timeout=120,
                              env=dict(os.environ, HOME=self.folder))
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assert_same("all")

    @unittest.skipUnless(shutil.which("snakemake"), "snakemake is not installed")
    def test_snakemake_makes_and_keeps_what_the_batch_does(self):
        self.write("Snakefile", self.export("snakemake", "snake.toml"))
        line = ["snakemake", "-s", "Snakefile", "--cores", "2"]
        environment = dict(os.environ, HOME=self.folder, XDG_CACHE_HOME=self.path("cache"))
        done = subprocess.run(line, cwd=self.folder, capture_output=True, text=True, timeout=250, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assert_same("kept", ("item.json", ".snakemake_timestamp"))
        done = subprocess.run(line, cwd=self.folder, capture_output=True, text=True, timeout=250, env=environment)
        self.assertIn("Nothing to be done", done.stderr)

    def test_an_argument_with_a_line_end_is_refused(self):
        self.write("odd.toml", '[[item]]\nname = "a"\ncommand = "replay"\narguments = { tooth = "path.toml", '
                               'trajectory = "path.toml", bur = "x\\ny" }\n')
        done = self.run_tool("batch", "odd.toml", "-o", "out", "--export", "commands")
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertIn("line end", done.stderr)

    def test_a_name_that_snakemake_takes_for_a_wildcard_is_refused(self):
        self.write("odd.toml", MANIFEST.replace("anna's", "{anna}"))
        done = self.run_tool("batch", "odd.toml", "-o", "out", "--export", "snakemake")
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertIn("brace", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
