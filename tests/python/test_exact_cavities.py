"""Cavities of known figures, scored from meshes, labels and scans, have 95 % of their figures within the stated uncertainty.

Usage: test_exact_cavities.py BINARY SOURCE_DIR
"""
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

BINARY, SOURCE = sys.argv[1:3]


class ExactCavities(unittest.TestCase):
    def run_script(self, *arguments):
        line = ["/usr/bin/python3", str(Path(SOURCE) / "scripts" / "exact-cavities"), *arguments]
        return subprocess.run(line, capture_output=True, text=True, timeout=280)

    def test_nearly_all_figures_are_within_their_uncertainty(self):
        with tempfile.TemporaryDirectory() as folder:
            done = self.run_script("-o", folder, "--toothprep", BINARY, "--voxels-mm", "0.2", "--routes",
                                   "meshes,labels,scans", "--cavities", "box,dovetail,class II,tapered class II,bevel")
            self.assertEqual(done.returncode, 0, done.stderr)
            rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines()[2:]]
            self.assertEqual(len(Path(folder, "figures.csv").read_text().splitlines()), 1 + sum(int(r[3]) for r in rows))
        self.assertEqual([row[0] for row in rows], ["meshes", "labels", "scans"] * 2, "a cavity could not be scored")
        for source, _, pose, figures, within, _, farthest in rows:
            self.assertGreaterEqual(int(figures), 90)
            self.assertGreaterEqual(int(within), 0.95 * int(figures), f"{source}, {pose}: {farthest}")

    def test_crowns_of_labels_and_scans_have_every_figure_within_its_uncertainty(self):
        """Also the margin of a bevel all around, and sharp edges at walls that labels put in steps."""
        with tempfile.TemporaryDirectory() as folder:
            done = self.run_script("-o", folder, "--toothprep", BINARY, "--voxels-mm", "0.1", "--routes", "labels,scans",
                                   "--cavities", "stump,bevel")
            self.assertEqual(done.returncode, 0, done.stderr)
        rows = done.stdout.splitlines()[2:]
        self.assertEqual(len(rows), 4)
        for row in rows:
            source, _, pose, figures, within, *_ = [cell.strip() for cell in row.split("|")[1:-1]]
            self.assertEqual(within, figures, f"{source}, {pose}: {done.stderr}")

    def test_what_is_missing_is_said(self):
        for arguments, words in ((["--toothprep", "nowhere"], "no such program"),
                                 (["--toothprep", BINARY, "--routes", "teeth,wax"], "'wax' is none of")):
            with tempfile.TemporaryDirectory() as folder:
                done = self.run_script("-o", folder + "/new", *arguments)
                self.assertEqual(done.returncode, 1)
                self.assertIn(words, done.stderr)
                self.assertFalse(Path(folder, "new").exists())


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
