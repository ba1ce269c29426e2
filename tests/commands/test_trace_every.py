"""`replay --trace-every N`: a trace of every Nth step, and what its readers say.

Usage: test_trace_every.py BINARY
"""
import json
import sys
import unittest
from pathlib import Path

import h5py
import numpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import CommandTest  # noqa: E402

PATH = """start_mm = [0, 0.7, 0]
axis = [0, 1, 0]
[[segment]]
kind = "line"
to_mm = [0, -0.2, 0]
speed_mm_s = 2
[[segment]]
kind = "line"
to_mm = [0.5, -0.2, 0]
speed_mm_s = 0.3
"""


class TraceEvery(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "3", "--voxel-mm", "0.1", "--enamel-mm", "3")
        cls.write("path.toml", PATH)
        cls.whole = cls.replay("path.toml", "whole.h5", "--prepared", "whole.vdb")
        cls.sparse = cls.replay("path.toml", "sparse.h5", "--prepared", "sparse.vdb", "--trace-every", "17")

    @classmethod
    def replay(cls, trajectory, output, *args):
        done = cls.run_ok("replay", "--tooth", "block.vdb", "--bur", "ball:D1.2", "--trajectory", trajectory,
                          "-o", output, "--force", "--json", *args)
        return done.stderr, json.loads(done.stdout)

    def datasets(self, name):
        found = {}
        with h5py.File(self.path(name)) as f:
            f.visititems(lambda path, item: found.update({path: item[()]}) if isinstance(item, h5py.Dataset) else None)
        return found

    def test_the_rows_are_the_whole_traces_own_and_end_with_the_last(self):
        whole, sparse = self.datasets("whole.h5"), self.datasets("sparse.h5")
        steps = len(whole["time"]) - 1
        kept = sorted({*range(0, steps + 1, 17), steps})
        self.assertNotEqual(steps % 17, 0)
        self.assertEqual(set(whole), set(sparse))
        for name, values in whole.items():
            numpy.testing.assert_array_equal(values[kept], sparse[name], name)
        self.assertLess(self.path_size("sparse.h5"), self.path_size("whole.h5") / 2)

    def path_size(self, name):
        return Path(self.path(name)).stat().st_size

    def test_the_figures_and_the_tooth_are_those_of_all_steps(self):
        quick = ("realtime_factor", "step_us_p50", "step_us_p99", "step_us_max")
        self.assertEqual({k: v for k, v in self.whole[1].items() if k not in quick},
                         {k: v for k, v in self.sparse[1].items() if k not in quick})
        self.assertEqual(self.read("whole.vdb"), self.read("sparse.vdb"))
        with h5py.File(self.path("whole.h5")) as a, h5py.File(self.path("sparse.h5")) as b:
            self.assertNotIn("rows_every", a.attrs)
            self.assertEqual(b.attrs["rows_every"], 17)
            for name in a.attrs:
                self.assertEqual(a.attrs[name], b.attrs[name], name)

    def test_readers_say_that_steps_are_missing(self):
        info = self.run_ok("info", "sparse.h5", "--json")
        self.assertEqual(json.loads(info.stdout)["rows_every"], 17)
        for done in (info, self.run_ok("export", "sparse.h5", "-o", "sparse.csv"),
                     self.run_ok("replay", "--tooth", "block.vdb", "--bur", "ball:D1.2", "--trajectory", "sparse.h5",
                                 "-o", "again.h5")):
            self.assertIn("every 17th step only", done.stderr)
        self.assertNotIn("step only", self.whole[0])

    def refused(self, code, *args):
        done = self.run_tool(*args)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stderr

    def test_what_needs_every_step_refuses_it(self):
        self.assertIn("rows_every", self.refused(1, "view", "sparse.h5", "--tooth", "block.vdb", "--no-open"))
        self.assertIn("rows_every", self.refused(1, "calibrate", "--measured", "sparse.h5", "--tooth", "block.vdb",
                                                 "--bur", "ball:D1.2", "-o", "fit.json"))

    def test_numbers_that_cannot_be_meant_are_refused_and_nothing_is_written(self):
        for every, text in (("0", "--trace-every"), ("-3", "--trace-every"), ("1.5", "--trace-every"),
                            ("101", "at most 100"), ("20000001", "--trace-every")):
            done = self.run_tool("replay", "--tooth", "block.vdb", "--bur", "ball:D1.2", "--trajectory", "path.toml",
                                 "-o", "refused.h5", "--trace-every", every)
            self.assertNotEqual(done.returncode, 0, every)
            self.assertIn(text, done.stderr)
            self.assertFalse(Path(self.path("refused.h5")).exists())

    def test_a_damaged_number_is_an_error_with_its_place(self):
        for value in (0, 2.5, -1, float("nan"), 1e300):
            self.write("damaged.h5", self.read("sparse.h5"))
            with h5py.File(self.path("damaged.h5"), "r+") as f:
                f.attrs.modify("rows_every", value) if isinstance(value, int) else f.attrs.create("rows_every", value)
            self.assertIn("rows_every", self.refused(1, "info", "damaged.h5"), value)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
