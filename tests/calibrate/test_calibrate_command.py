"""The chain of a calibration as a user runs it: plan, fit, replay with what was fitted, and what bad input says."""
import json
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

BINARY, SOURCE = sys.argv.pop(1), Path(sys.argv.pop(1))
BUR = ["--bur", "cylinder:D1.2xL3.0"]
PATH = str(SOURCE / "data/trajectories/calibration.toml")


class Calibration(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.run_good("specimen", "block", "-o", "block.vdb", "--size-mm", "5,3,5", "--enamel-mm", "1")
        cls.run_good("specimen", "block", "-o", "other.vdb", "--size-mm", "5,3,5", "--enamel-mm", "0.8")
        for name in ("rig.h5", "rig.csv"):
            cls.run_good("specimen", "measurement", "--tooth", "block.vdb", *BUR, "--trajectory", PATH, "--u-j-per-mm3",
                         "enamel=0.42,dentin=0.085", "--alpha", "enamel=0.31,dentin=0.22", "--bias-n", "0.1,-0.05,0.02",
                         "--delay-ms", "3", "--outliers-percent", "1", "-o", name)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def run_binary(cls, *arguments):
        return subprocess.run([BINARY, "-q", *arguments], cwd=cls.folder.name, capture_output=True, text=True, timeout=200)

    @classmethod
    def run_good(cls, *arguments):
        result = cls.run_binary(*arguments)
        assert result.returncode == 0, result.stderr
        return result

    def refused(self, words, *arguments):
        result = self.run_binary(*arguments)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        self.assertIn(words, result.stderr)

    def file(self, name):
        return Path(self.folder.name) / name

    def test_csv_to_parameters_to_replay(self):
        self.run_good("calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", *BUR, "--estimate", "delay", "-o",
                      "fit.json", "--params-out", "fit.toml", "--report", "report", "--no-plots")
        fit = json.loads(self.file("fit.json").read_text())
        self.assertEqual(fit["schema"], "toothprep-fit")
        self.assertEqual(fit["rotation_rate_rev_s"], 100)
        for tissue, u, alpha in (("enamel", 0.42, 0.31), ("dentin", 0.085, 0.22)):
            own = fit["tissues"][tissue]
            self.assertTrue(own["identifiable"])
            self.assertLess(abs(own["u_j_per_mm3"] / u - 1), 0.05)
            self.assertLess(abs(own["alpha"] / alpha - 1), 0.05)
            self.assertGreater(own["u_std_j_per_mm3"], 0)
        self.assertFalse(fit["tissues"]["pulp"]["identifiable"])
        self.assertIsNone(fit["tissues"]["pulp"]["u_j_per_mm3"])
        self.assertEqual(fit["tissues"]["pulp"]["why_not"], "never touched")
        self.assertLess(abs(fit["delay_s"] - 0.003), 0.0005)
        self.assertLess(abs(fit["bias_n"][0] - 0.1), 0.02)
        self.assertGreater(fit["residual_r2"], 0.95)
        for name in ("fit.json", "force-1.csv", "draws.csv", "adequacy.csv"):
            self.assertTrue((self.file("report") / name).is_file(), name)
        self.run_good("replay", "--tooth", "block.vdb", "--params", "fit.toml", *BUR, "--trajectory", PATH, "-o", "t.h5")

    def test_same_from_h5(self):
        self.run_good("calibrate", "--tooth", "block.vdb", "--measured", "rig.h5", *BUR, "--estimate", "delay", "-o", "a.json")
        self.run_good("calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", *BUR, "--estimate", "delay", "-o",
                      "b.json")
        a, b = (json.loads(self.file(n).read_text())["tissues"]["enamel"]["u_j_per_mm3"] for n in ("a.json", "b.json"))
        self.assertAlmostEqual(a, b, places=6)

    def test_another_tooth_is_refused(self):
        self.refused("another tooth", "calibrate", "--tooth", "other.vdb", "--measured", "rig.h5", *BUR, "-o", "x.json")
        self.assertFalse(self.file("x.json").exists())

    def test_grams_are_doubted_and_taken_when_stated(self):
        lines = self.file("rig.csv").read_text().splitlines()
        rows = [line.split(",") for line in lines[1:]]
        for row in rows:
            row[-3:] = [repr(float(f) / 0.00980665) for f in row[-3:]]
        self.file("grams.csv").write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n")
        common = ("calibrate", "--tooth", "block.vdb", "--measured", "grams.csv", *BUR, "-o", "grams.json")
        self.refused("it looks like grams", *common)
        self.run_good(*common, "--force-unit", "gf", "--estimate", "delay")
        u = json.loads(self.file("grams.json").read_text())["tissues"]["enamel"]["u_j_per_mm3"]
        self.assertLess(abs(u / 0.42 - 1), 0.05)

    def test_lengths_and_nan_in_a_file(self):
        import h5py
        import shutil
        for words, change in (("/force/measured", lambda f: f["force/measured"][:-5]),
                              ("/force/measured", lambda f: f["force/measured"][:] * float("nan"))):
            shutil.copy(self.file("rig.h5"), self.file("bad.h5"))
            with h5py.File(self.file("bad.h5"), "r+") as f:
                values, units = change(f), f["force/measured"].attrs["units"]
                del f["force/measured"]
                f.create_dataset("force/measured", data=values).attrs["units"] = units
            self.refused(words, "calibrate", "--tooth", "block.vdb", "--measured", "bad.h5", *BUR, "-o", "x.json")

    def test_without_force(self):
        self.run_good("replay", "--tooth", "block.vdb", *BUR, "--trajectory", PATH, "-o", "plain.h5")
        self.refused("/force/measured: is missing", "calibrate", "--tooth", "block.vdb", "--measured", "plain.h5", *BUR, "-o",
                     "x.json")

    def test_bad_options(self):
        common = ("calibrate", "--tooth", "block.vdb", "--measured", "rig.h5", *BUR, "-o", "x.json")
        self.refused("--bias", *common, "--bias", "none")
        self.refused("weight", *common, "--estimate", "weight")
        self.refused("TISSUE=VALUE", "specimen", "measurement", "--tooth", "block.vdb", *BUR, "--trajectory", PATH, "-o",
                     "y.h5", "--alpha", "enamel")


if __name__ == "__main__":
    unittest.main()
