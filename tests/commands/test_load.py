"""`replay --drive load`: a given force pushes the bur.

Usage: test_load.py BINARY
"""
import json
import math
import sys
import unittest
from pathlib import Path

import h5py
import numpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import CommandTest  # noqa: E402

U, ALPHA, RATE, RADIUS, LENGTH = 0.3e3, 0.25, 100, 0.6, 1.5  # `paper`, enamel; tip 1.5 mm below the face
HOLD = "start_mm = [0, {y}, 0]\n[[segment]]\nkind = \"hold\"\nduration_s = {seconds}\n"


class Load(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "4,6,3", "--enamel-mm", "6")
        cls.write("hold.toml", HOLD.format(y=0.7, seconds=6))

    @classmethod
    def replay(cls, trajectory, output, *args, run=None):
        return (run or cls.run_ok)("replay", "--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--drive", "load",
                                   "--trajectory", trajectory, "-o", output, "--force", *args)

    def refused(self, trajectory, *args, code=1):
        done = self.replay(trajectory, "refused.h5", *args, run=self.run_tool)
        self.assertEqual(done.returncode, code, done.stderr)
        self.assertFalse(Path(self.path("refused.h5")).exists())
        return done.stderr

    def rows(self, columns, loads):
        """A .csv at 100 Hz that stands at the block, with these loads."""
        lines = [f"time_s,x_mm,y_mm,z_mm,{columns}"] + [f"{i / 100},0,0.7,0,{load}" for i, load in enumerate(loads)]
        self.write("loads.csv", "\n".join(lines) + "\n")

    def test_feed_force_and_torque_are_those_of_the_full_slot(self):
        report = json.loads(self.replay("hold.toml", "slot.h5", "--load-n", "0,-2,0", "--rail", "0,-1,0",
                                        "--json").stdout)
        with h5py.File(self.path("slot.h5")) as f:
            time, bur = f["time"][:], f["bur/position"][:]
            v = (bur[-1] - bur[-1000]) / (time[-1] - time[-1000])
            self.assertAlmostEqual(-v[1] / (4 * ALPHA * RATE * 2 / (U * LENGTH)), 1, delta=0.01)
            self.assertAlmostEqual(f["torque"][-1] / (4 * ALPHA * RADIUS * 2 / math.pi), 1, delta=0.01)
            numpy.testing.assert_array_equal(f["force/applied"][:], numpy.tile([0, -2, 0], (len(time), 1)))
            numpy.testing.assert_array_equal(f["force/device"][1:], -f["force/applied"][1:])
            self.assertEqual(f.attrs["drive"], "load")
            self.assertEqual(f["force/applied"].attrs["units"], "N")
        self.assertEqual((report["ran_off"], report["largest_lag_mm"]), (False, 0))
        self.assertLess(report["unbalanced_steps"], 5)  # as it enters
        self.assertEqual(report["findings"], [])
        self.assertEqual(report["energy_audit"], "within")

    def test_a_trace_replays_to_the_bit_and_the_csv_export_has_the_load(self):
        self.write("rail.toml", "[load]\nrail = [0, -1, 0]\n")
        self.rows("load_x_N,load_y_N,load_z_N", [f"0,{-1 - i / 100},0" for i in range(100)])
        self.replay("loads.csv", "one.h5", "--params", "rail.toml")
        self.replay("one.h5", "two.h5", "--params", "rail.toml")
        self.assertEqual(self.read("one.h5"), self.read("two.h5"))
        with h5py.File(self.path("one.h5")) as f:  # linear between the samples
            self.assertAlmostEqual(f["force/applied"][505, 1], -1.505, places=12)
        self.run_ok("export", "one.h5", "-o", "one.csv")
        self.assertTrue(self.read("one.csv").split(b"\n")[0].endswith(b"force_applied_x_N,force_applied_y_N,force_applied_z_N"))
        self.assertEqual(json.loads(self.run_ok("info", "one.h5", "--json").stdout)["findings"], [])

    def test_a_load_beyond_the_stall_torque_moves_nothing(self):
        # T = 4 alpha R F/pi: 1.2 mN m at 6.28 N. The bur enters, and stalls where as much is engaged.
        report = json.loads(self.replay("hold.toml", "stall.h5", "--load-n", "0,-7,0", "--rail", "0,-1,0",
                                        "--json").stdout)
        self.assertEqual(report["stall_onsets"], 1)
        with h5py.File(self.path("stall.h5")) as f:
            self.assertEqual(f["stalled"][-1], 1)
            self.assertGreater(f["bur/position"][-1, 1], -0.6)
            numpy.testing.assert_array_equal(f["bur/velocity"][-1], [0, 0, 0])

    def test_a_bur_that_leaves_the_block_ends_the_run_with_a_warning(self):
        self.run_ok("specimen", "block", "-o", "thin.vdb", "--size-mm", "3,1,3", "--enamel-mm", "1")
        done = self.run_ok("replay", "--tooth", "thin.vdb", "--bur", "cylinder:D1.2xL3.0", "--drive", "load", "--load-n",
                           "0,-4,0", "--rail", "0,-1,0", "--trajectory", "hold.toml", "--stall-torque-mnm", "inf", "-o",
                           "through.h5")
        self.assertRegex(done.stderr, r"left the tooth and went 5 mm without contact; the run ends there, at [0-9.]+ s")
        with h5py.File(self.path("through.h5")) as f:
            self.assertLess(f["time"][-1], 5.9)
            self.assertAlmostEqual(f["removed/volume"][-1, 0], 1.2 * 1.5, delta=0.02)

    def test_loads_that_cannot_be_meant_are_refused(self):
        self.assertIn("row 0: a bur that starts there and is pushed by (0, 1, 0) N goes 5 mm without touching the tooth",
                      self.refused("hold.toml", "--load-n", "0,1,0"))
        self.assertIn("holds no load, which --drive load needs", self.refused("hold.toml"))
        self.assertIn("the load is zero throughout", self.refused("hold.toml", "--load-n", "0,0,0"))
        self.assertIn("above 1000 N", self.refused("hold.toml", "--load-n", "0,-1e4,0"))
        self.assertIn("--rail: 0,0,0 has no direction",
                      self.refused("hold.toml", "--load-n", "0,-1,0", "--rail", "0,0,0"))
        self.assertIn("nan", self.refused("hold.toml", "--load-n", "0,nan,0", code=2))
        self.assertIn("--load-n", self.refused("hold.toml", "--load-n", "0,-1", code=2))
        done = self.run_tool("replay", "--tooth", "block.vdb", "--bur", "ball:D1.2", "--trajectory", "hold.toml", "-o",
                             "refused.h5", "--load-n", "0,1,0")
        self.assertEqual(done.returncode, 2)
        self.assertIn("needs --drive load", done.stderr)

    def test_rows_of_loads_that_are_wrong_are_refused_with_their_place(self):
        self.rows("load_x_N,load_y_N,load_z_N", ["0,-1,0", "0,nan,0", "0,-1,0"])
        self.assertIn("line 3, column load_y_N: 'nan' is not a finite number", self.refused("loads.csv"))
        self.rows("load_x_N,load_y_N,load_z_N", ["0,-1,0", "0,-1", "0,-1,0"])
        self.assertIn("line 3: has 6 columns where the header has 7", self.refused("loads.csv"))
        self.rows("load_x_N,load_y_N", ["0,-1"] * 3)
        self.assertIn("column 'load_z_N' is missing", self.refused("loads.csv"))
        with h5py.File(self.path("short.h5"), "w") as f:
            for name, data, unit in (("time", numpy.arange(9) / 100, "s"), ("handle/position", numpy.zeros((9, 3)), "mm"),
                                     ("force/applied", numpy.ones((8, 3)), "N")):
                f[name] = data
                f[name].attrs["units"] = unit
        self.assertIn("/force/applied", self.refused("short.h5"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
