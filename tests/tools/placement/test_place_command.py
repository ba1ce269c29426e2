"""Runs `toothprep place`, `prepare`, and what goes on with their paths: replay, score.

Usage: test_place_command.py BINARY
"""
import json
import sys
import tomllib
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest

OWN = """frame = "tooth"
start_mm = [0, 0, 4]
[[segment]]
kind = "waypoints"
points_mm = [[0, 0, 0.6], [0.5, 0, -0.4]]
speed_mm_s = 20
"""
BUR = ["--bur", "57"]


class Place(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "molar", "--voxel-mm", "0.3", "-o", "molar.vdb")
        cls.run_ok("specimen", "block", "--size-mm", "4", "--voxel-mm", "0.3", "-o", "block.vdb")
        cls.write("own.toml", OWN)
        cls.write("file.toml", OWN.replace('frame = "tooth"\n', ""))

    def refused(self, *args):
        done = self.run_tool(*args)
        self.assertEqual(done.returncode, 1, done.stderr)
        lines = [line for line in done.stderr.splitlines() if not line.startswith("warning")]
        self.assertEqual(len(lines), 1, done.stderr)
        return lines[0]

    def place(self, *args):
        return json.loads(self.run_ok("place", "--tooth", "molar.vdb", *BUR, "--json", *args).stdout)

    def test_a_script_in_the_tooths_frame_is_placed_on_its_fossa(self):
        j = self.place("--trajectory", "own.toml", "-o", "placed.h5", "--picture", "placed.png")
        fossa = j["tooth_fossa_mm"]
        for axis, (low, high, shift) in enumerate(zip(*j["tips_mm"], ((0, 0), (-0.5, 0), (-0.4, 4)))):
            self.assertAlmostEqual(low, fossa[axis] + shift[0], delta=1e-6)  # mesial is -y
            self.assertAlmostEqual(high, fossa[axis] + shift[1], delta=1e-6)
        self.assertGreater(j["removed_mm3"]["enamel"], 0.2)
        self.assertGreater(j["least_to_pulp_mm"], 2)
        self.run_ok("replay", "--tooth", "molar.vdb", *BUR, "--trajectory", "placed.h5", "-o", "a.h5", "--drive", "direct")
        self.run_ok("replay", "--tooth", "molar.vdb", *BUR, "--trajectory", "own.toml", "-o", "b.h5", "--drive", "direct")
        self.run_ok("export", "a.h5", "-o", "a.csv")
        self.run_ok("export", "b.h5", "-o", "b.csv")
        self.assertEqual(Path(self.path("a.csv")).read_text(), Path(self.path("b.csv")).read_text())

    def test_a_path_of_another_tooths_file_stays_where_it_is_on_the_same_tooth(self):
        self.place("--trajectory", "own.toml", "-o", "there.h5")
        j = self.place("--trajectory", "there.h5", "--from", "molar.vdb")
        k = self.place("--trajectory", "own.toml")
        for a, b in zip(j["tips_mm"][0] + j["tips_mm"][1], k["tips_mm"][0] + k["tips_mm"][1]):
            self.assertAlmostEqual(a, b, delta=1e-6)

    def test_a_path_is_fitted_to_pairs_of_places(self):
        self.write("pairs.toml", "path_mm = [[0,0,0],[1,0,0],[0,1,0]]\ntooth_mm = [[6,5,17],[6,4,17],[7,5,17]]\n")
        j = self.place("--trajectory", "file.toml", "--at", "pairs.toml")
        self.assertAlmostEqual(j["tips_mm"][0][1], 4.5, delta=1e-6)
        self.assertAlmostEqual(j["tips_mm"][1][2], 21, delta=1e-6)

    def test_landmarks_of_the_tooth_count_before_what_its_file_knows(self):
        # Mesial to +x, a quarter turn from where the file has it (-y).
        self.write("marks.toml", "fossa_mm = [6, 5, 16.8]\nmesial_mm = [10, 5, 14]\ndistal_mm = [2, 5, 14]\n"
                                 "buccal_mm = [6, 9, 14]\nlingual_mm = [6, 1, 14]\n")
        j = self.place("--trajectory", "own.toml", "--at", "marks.toml")
        for got, wanted in zip(j["tips_mm"][0] + j["tips_mm"][1], (6, 5, 16.4, 6.5, 5, 20.8)):
            self.assertAlmostEqual(got, wanted, delta=1e-6)
        self.assertEqual(j["tooth_fossa_mm"], [6, 5, 16.8])
        self.write("odd.toml", "centre_mm = [6, 5, 16.8]\n")
        self.assertIn("centre_mm", self.refused("place", "--tooth", "molar.vdb", *BUR, "--trajectory", "own.toml", "--at", "odd.toml"))

    def test_what_is_not_known_is_refused(self):
        self.assertIn("frame that isn't known", self.refused("place", "--tooth", "molar.vdb", *BUR, "--trajectory", "file.toml"))
        self.assertIn("mesial", self.refused("place", "--tooth", "block.vdb", *BUR, "--trajectory", "own.toml"))
        self.assertIn("--at", self.refused("place", "--tooth", "molar.vdb", *BUR, "--trajectory", "own.toml", "--at", "1,2"))
        self.assertIn("own frame", self.refused("live", "--tooth", "molar.vdb", *BUR, "--hand", "own.toml", "-o", "live.h5"))

    def test_a_path_that_opens_the_pulp_is_warned_of(self):
        self.write("deep.toml", OWN.replace("-0.4", "-5"))
        done = self.run_ok("place", "--tooth", "molar.vdb", *BUR, "--trajectory", "deep.toml")
        self.assertIn("opens the pulp", done.stderr)
        self.assertEqual(1, self.run_tool("place", "--tooth", "molar.vdb", *BUR, "--trajectory", "deep.toml",
                                          "-o", "deep.h5", "--strict").returncode)
        self.assertFalse(Path(self.path("deep.h5")).exists())


class Prepare(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "molar", "--voxel-mm", "0.2", "-o", "molar.vdb")

    def prepared(self, kind, *args):
        """Plans, cuts on the virtual spring, and scores."""
        self.run_ok("prepare", "--type", kind, "--tooth", "molar.vdb", *BUR, "-o", "path.toml", "--force", *args)
        with open(self.path("path.toml"), "rb") as f:
            self.assertGreater(len(tomllib.load(f)["segment"]), 10)
        run = json.loads(self.run_ok("replay", "--tooth", "molar.vdb", *BUR, "--trajectory", "path.toml",
                                     "-o", "trace.h5", "--prepared", "cut.vdb", "--json", "--force").stdout)
        self.run_ok("score", "--original", "molar.vdb", "--prepared", "cut.vdb", "--type", kind, "--trace", "trace.h5",
                    "-o", "score.json", "--force")
        with open(self.path("score.json")) as f:
            return run, json.load(f)

    def check_run(self, run):
        self.assertAlmostEqual(run["energy_ratio"], 1, delta=0.1)
        self.assertEqual(run["removed_mm3"]["pulp"], 0)
        self.assertEqual(run["stalled_steps"], 0)

    def test_class1_is_as_deep_and_wide_as_asked_for(self):
        run, score = self.prepared("class1", "--depth-mm", "1.7", "--width-mm", "1.5")
        self.check_run(run)
        self.assertAlmostEqual(score["depth_mm"], 1.7, delta=0.1)
        self.assertAlmostEqual(score["isthmus_width_mm"], 1.5, delta=0.2)  # pushed off the walls by 0.05 to 0.1 mm each
        self.assertLess(score["floor_tilt_deg"], 2)
        self.assertTrue(score["passed"])

    def test_class2_has_a_box_on_its_side(self):
        run, score = self.prepared("class2", "--side", "mesial")
        self.check_run(run)
        self.assertAlmostEqual(score["axial_depth_mm"], 1.35, delta=0.3)
        self.assertLess(score["gingival_floor_tilt_deg"], 3)
        self.assertTrue(score["passed"])

    def test_in_the_scan_of_a_real_tooth_the_torques_work_is_the_energy_of_what_is_removed(self):
        scan = Path(__file__).resolve().parents[3] / "data/examples/teeth/ct-tooth.nrrd"
        self.run_ok("voxelize", str(scan), "--voxel-mm", "0.1", "-o", "real.vdb")
        self.run_ok("orient", "real.vdb", "--mesial", "1", "0", "0", "--tooth-number", "46", "-o", "placed.vdb")
        for bur, drive in (("cylinder:D1.2xL4.0xR0.3", "direct"), ("cylinder:D1.2xL4.0xR0.3", "coupled"), ("ball:D1.2", "direct")):
            self.run_ok("prepare", "--type", "class1", "--tooth", "placed.vdb", "--bur", bur, "-o", "real.toml", "--force")
            run = json.loads(self.run_ok("replay", "--tooth", "placed.vdb", "--bur", bur, "--trajectory", "real.toml", "--drive",
                                         drive, "-o", "real.h5", "--json", "--force").stdout)
            self.assertGreater(run["removed_mm3"]["enamel"], 6)
            self.assertAlmostEqual(run["energy_ratio"], 1, delta=0.005, msg=f"{bur} {drive}")

    def test_what_would_open_the_pulp_is_refused_with_the_place(self):
        done = self.run_tool("prepare", "--type", "class1", "--tooth", "molar.vdb", *BUR, "--depth-mm", "4.5", "-o", "deep.toml")
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stderr, r"pulp at [\d.]+ [\d.]+ [\d.]+ mm")
        self.assertFalse(Path(self.path("deep.toml")).exists())

    def test_a_bur_wider_than_the_cavity_is_refused(self):
        done = self.run_tool("prepare", "--type", "class1", "--tooth", "molar.vdb", *BUR, "--width-mm", "0.8", "-o", "thin.toml")
        self.assertEqual(done.returncode, 1)
        self.assertIn("bur's diameter", done.stderr)

    def test_class2_needs_a_side(self):
        done = self.run_tool("prepare", "--type", "class2", "--tooth", "molar.vdb", *BUR, "-o", "side.toml")
        self.assertEqual(done.returncode, 1)
        self.assertIn("mesial or distal", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
