"""Runs the commands of data/own-tooth.md literally, on the teeth that come with the source and a recording whose truth is
known, and looks at what they leave.

Usage: test_own_tooth.py BINARY SOURCE
"""
import json
import re
import shlex
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import CommandTest

SOURCE = Path(sys.argv[2])
# The rig's frame: p_rig = TURN p_tooth + SHIFT.
TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
SHIFT = np.array([120.0, -35.5, 60.25])  # mm
PLACES = np.array([[2.0, 3.0, 15.0], [8.0, 3.5, 15.2], [5.0, 9.0, 14.1], [5.5, 5.0, 8.0]])  # mm, of the tooth


def blocks():
    text = (SOURCE / "data/own-tooth.md").read_text(encoding="utf-8")
    return [block.strip().splitlines() for block in re.findall(r"```sh\n(.*?)```", text, re.S)]


class OwnTooth(CommandTest):
    """The page's blocks are run once, in their order; the tests look at what is there then."""
    said = {}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        for lines in blocks():
            if any("recording.csv" in line for line in lines):
                cls.write_recording()
            for line in lines:
                words = shlex.split(line.replace("$DATA", str(SOURCE / "data")))
                assert words[0] == "toothprep", line
                cls.said[line] = cls.run_ok(*words[1:]).stderr

    @classmethod
    def write_recording(cls):
        """The handle's path of class1.h5 as another lab would have recorded it, at every fourth millisecond."""
        with h5py.File(cls.path("class1.h5"), "r") as trace:
            time = trace["/time"][::4]
            position = trace["/handle/position"][::4] @ TURN.T + SHIFT
            turn = rotation_matrices(trace["/handle/orientation"][::4])
        turned = TURN @ turn
        lines = ["Time (s);PosX;PosY;PosZ;" + ";".join(f"R{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)) + ";Comment"]
        for t, p, r in zip(time, position / 1000, turned):
            numbers = [f"{t:.3f}", *(f"{v:.9f}" for v in p), *(f"{v:.9f}" for v in r.ravel())]
            lines.append(";".join(number.replace(".", ",") for number in numbers) + ";-")
        cls.write("recording.csv", "\n".join(lines) + "\n")
        rig = PLACES @ TURN.T + SHIFT
        cls.write("pairs.toml", f"path_mm = {rig.tolist()}\ntooth_mm = {PLACES.tolist()}\n")

    def score(self, name):
        return json.loads(self.read(name))

    def test_every_command_of_the_page_was_run(self):
        self.assertEqual(len(self.said), sum(len(lines) for lines in blocks()))
        self.assertGreaterEqual(len(self.said), 15)

    def test_the_cavity_of_the_real_tooth_passes_and_leaves_the_pulp(self):
        score = self.score("class1.json")
        self.assertTrue(score["passed"])
        self.assertGreater(score["points_percent"], 90)
        self.assertFalse(score["pulp_exposed"])
        self.assertTrue((Path(self.folder) / "class1-report/report.html").is_file())

    def test_the_recording_of_another_lab_cuts_the_same_cavity(self):
        """Positions to a micrometre after import and placing: the path is the trace's own, cut with the same bur."""
        with h5py.File(self.path("class1.h5"), "r") as own, h5py.File(self.path("placed.h5"), "r") as placed:
            count = len(placed["/time"])
            position, expected = placed["/handle/position"][:], own["/handle/position"][::4][:count]
            self.assertLess(np.abs(position - expected).max(), 0.001)
            turn, truth = (rotation_matrices(file["/handle/orientation"][:][::step][:count]) for file, step in ((placed, 1), (own, 4)))
            angle = np.degrees(np.arccos(np.clip((np.einsum("nij,nij->n", turn, truth) - 1) / 2, -1, 1)))
            self.assertLess(angle.max(), 0.01)
        removed, truth = (self.score(name)["removed_mm3"]["total"] for name in ("own.json", "class1.json"))
        self.assertAlmostEqual(removed / truth, 1, delta=0.01)
        self.assertAlmostEqual(self.score("own.json")["points_percent"], self.score("class1.json")["points_percent"], delta=1)

    def test_the_path_of_one_tooth_prepares_another(self):
        score = self.score("molar.json")
        self.assertGreater(score["points_percent"], 70)
        self.assertGreater(score["removed_mm3"]["total"], 5)


def rotation_matrices(xyzw):
    x, y, z, w = np.asarray(xyzw).T
    return np.moveaxis(np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]), 2, 0)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=1)
