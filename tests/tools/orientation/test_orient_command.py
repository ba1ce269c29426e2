"""Runs `toothprep orient` and the commands that use the frame it keeps: voxelize, info, score, render.

Usage: test_orient_command.py BINARY
"""
import json
import math
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest


def degrees_between(a, b):
    dot = sum(x * y for x, y in zip(a, b))
    return math.degrees(math.acos(max(-1, min(1, dot / math.hypot(*a) / math.hypot(*b)))))


# A pocket in the molar's central fissure, as `data/trajectories/class1-molar.toml` has it, cut at once.
POCKET = """start_mm = [5.5, 3.15, 24.0]
axis = [0.0, 0.0, 1.0]
rate_hz = 1000
[[segment]]
kind = "line"
to_mm = [5.5, 3.15, 19.2]
speed_mm_s = 20
[[segment]]
kind = "lattice"
origin_mm = [5.5, 3.15, 19.2]
u_mm = [0.0, 3.3, 0.0]
v_mm = [1.0, 0.0, 0.0]
step_mm = 1.0
layers = 11
layer_depth_mm = 0.4
speed_mm_s = 20
plunge_speed_mm_s = 10
"""


class Orient(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "scan", "--spacing-mm", "0.2", "--labels", "labels.nrrd", "-o", "scan.nrrd")
        # A voxel size whose threefold single precision rounds down.
        cls.run_ok("voxelize", "labels.nrrd", "--labels", "enamel=1,dentin=2,pulp=3", "--voxel-mm", "0.24", "-o", "tooth.vdb")
        cls.run_ok("specimen", "cavity", "--kind", "box", "--size-mm", "6,4,5", "--voxel-mm", "0.2", "--length-mm", "3",
                   "--width-mm", "1.4", "--depth-mm", "1.7", "--enamel-mm", "1.2", "-o", "after.vdb", "--original", "before.vdb")
        cls.run_ok("mesh", "before.vdb", "-o", "before.stl")
        cls.run_ok("mesh", "after.vdb", "-o", "after.stl")

    def json_of(self, *args):
        return json.loads(self.run_ok(*args, "--json").stdout)

    def refused(self, *args):
        done = self.run_tool(*args)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
        return done.stderr

    def test_voxelize_keeps_the_estimate_and_info_shows_it(self):
        info = self.json_of("info", "tooth.vdb")
        self.assertLess(degrees_between(info["frame_occlusal"], (0, 0, 1)), 3)
        self.assertGreaterEqual(info["frame_occlusal_uncertainty_deg"], 3)
        self.assertEqual(info["frame_occlusal_source"], "estimated")
        self.assertIsNone(info["frame_mesial"])
        self.assertEqual(info["frame_mesial_source"], "not known")
        self.assertEqual(info["frame_form"], "molar")
        self.assertIn("mesial not known", info["frame"])

    def test_corrections_are_kept_until_anew(self):
        frame = self.json_of("orient", "tooth.vdb", "--mesial", "0,-1,0", "--tooth-number", "36", "-o", "named.vdb",
                             "--picture", "frame.png", "--force")
        self.assertLess(degrees_between(frame["buccal"], (1, 0, 0)), 4)
        self.assertTrue(self.read("frame.png").startswith(b"\x89PNG"))
        self.assertEqual(frame["tooth_sha256"], self.json_of("info", "named.vdb")["tooth_sha256"])
        again = self.json_of("orient", "named.vdb", "--occlusal", "0.1,0,1")
        self.assertEqual((again["occlusal_source"], again["mesial_source"], again["tooth_number"]), ("given", "given", 36))
        anew = self.json_of("orient", "named.vdb", "--anew")
        self.assertIsNone(anew["mesial"])
        self.assertNotIn("tooth_number", anew)

    def test_landmarks(self):
        self.write("marks.toml", b"crown_mm = [6.1, 5.5, 18]\napical_mm = [6.1, 5.5, 2]\nmesial_mm = [6.1, 0.5, 14]\n"
                                 b"distal_mm = [6.1, 10.5, 14]\ntooth_number = 36\n")
        frame = self.json_of("orient", "tooth.vdb", "--landmarks", "marks.toml")
        self.assertLess(degrees_between(frame["occlusal"], (0, 0, 1)), 0.01)
        self.assertEqual(frame["buccal_source"], "landmarks")
        self.write("bad.toml", b"mesal_mm = [0, 0, 1]\n")
        self.assertIn("did you mean 'mesial_mm'?", self.refused("orient", "tooth.vdb", "--landmarks", "bad.toml"))

    def test_what_makes_no_frame_is_refused(self):
        self.assertIn("within 10 degrees of the occlusal one", self.refused("orient", "tooth.vdb", "--mesial", "0,0,1"))
        self.assertIn("no tooth number of FDI", self.refused("orient", "tooth.vdb", "--tooth-number", "19"))

    def score(self, *args):
        return self.json_of("score", "--type", "class1", "-o", "s.json", "--force", *args)

    def test_an_axis_that_is_not_known_gives_no_certain_verdict(self):
        meshes = ("--original", "before.stl", "--prepared", "after.stl", "--voxel-mm", "0.2")
        guessed = self.score(*meshes)
        given = self.score(*meshes, "--axis", "0,1,0")
        self.assertEqual(guessed["options"]["axis_from"], "found")
        self.assertFalse(guessed["options"]["axis_known"])
        self.assertFalse(guessed["verdict_certain"])
        self.assertTrue(any("axis is not known" in note or "could also have been" in note for note in guessed["notes"]))
        self.assertTrue(given["options"]["axis_known"])
        self.assertEqual(given["options"]["axis_uncertainty_deg"], 0)
        walls = [key for key in guessed["uncertainty"] if key.startswith("wall_angles_deg.") and key in given["uncertainty"]]
        self.assertTrue(walls)
        for key in ("floor_tilt_deg", "undercut_along_axis_mm", "depth_mm", *walls):
            self.assertGreater(guessed["uncertainty"][key], given["uncertainty"][key], key)
        self.assertGreaterEqual(guessed["uncertainty"]["floor_tilt_deg"], 20)

    def test_score_takes_the_teeths_own_axis_with_its_uncertainty(self):
        self.write("pocket.toml", POCKET.encode())
        self.run_ok("replay", "--tooth", "tooth.vdb", "--trajectory", "pocket.toml", "--bur", "cylinder:D1.2xL3.0", "--drive",
                    "direct", "--prepared", "cut.vdb", "-o", "cut.h5", "--force")
        cut = ("--original", "tooth.vdb", "--prepared", "cut.vdb")
        own, given = self.score(*cut), self.score(*cut, "--axis", "0,0,1")
        self.assertEqual(own["options"]["axis_from"], "estimated")
        axis = own["options"]["axis_uncertainty_deg"]
        self.assertGreaterEqual(own["uncertainty"]["floor_tilt_deg"], axis)
        self.assertLessEqual(abs(own["floor_tilt_deg"] - given["floor_tilt_deg"]), axis)
        # What differs lies in the range stated.
        self.assertLessEqual(own["points_percent_low"], given["points_percent"])
        self.assertGreaterEqual(own["points_percent_high"], given["points_percent"])

    def test_several_recordings_add_up(self):
        self.write("pocket.toml", POCKET.encode())
        run = ("replay", "--trajectory", "pocket.toml", "--drive", "direct", "--force")
        self.run_ok(*run, "--tooth", "tooth.vdb", "--bur", "cylinder:D1.2xL3.0", "--prepared", "one.vdb", "-o", "one.h5")
        self.run_ok(*run, "--tooth", "one.vdb", "--bur", "cylinder:D1.4xL3.0", "--prepared", "two.vdb", "-o", "two.h5")
        teeth = ("--original", "tooth.vdb", "--prepared", "two.vdb")
        first, second, both = (self.score(*teeth, *traces)["process"] for traces in
                               (("--trace", "one.h5"), ("--trace", "two.h5"), ("--trace", "one.h5", "--trace", "two.h5")))
        for key in ("time_s", "path_mm", "energy_j", "cutting_time_s"):
            self.assertAlmostEqual(both[key], first[key] + second[key], places=6, msg=key)
        self.assertEqual(both["peak_force_n"], max(first["peak_force_n"], second["peak_force_n"]))
        inputs = self.score(*teeth, "--trace", "one.h5", "--trace", "two.h5")["inputs"]
        self.assertEqual((inputs["trace"]["file"], inputs["trace_2"]["file"]), ("one.h5", "two.h5"))

    def test_render_says_what_it_makes_up(self):
        small = ("--size", "80x60", "--samples", "1", "--force")
        done = self.run_ok("render", "tooth.vdb", "--view", "mesial", "-o", "m.png", *small)
        self.assertIn("isn't known", done.stderr)
        done = self.run_ok("render", "tooth.vdb", "--view", "occlusal", "-o", "o.png", *small)
        self.assertNotIn("isn't known", done.stderr)
        self.assertIn("isn't known", self.run_ok("render", "before.stl", "--view", "occlusal", "-o", "s.png", *small).stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
