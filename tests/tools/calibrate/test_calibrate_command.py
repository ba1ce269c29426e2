"""The chain of a calibration as a user runs it: plan, fit, replay with what was fitted, and what bad input says."""
import json
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest

SOURCE = Path(sys.argv[2])
BUR = ["--bur", "cylinder:D1.2xL3.0"]
PATH = str(SOURCE / "data/trajectories/calibration.toml")


class Calibration(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "5,3,5", "--enamel-mm", "1")
        cls.run_ok("specimen", "block", "-o", "other.vdb", "--size-mm", "5,3,5", "--enamel-mm", "0.8")
        for name in ("rig.h5", "rig.csv"):
            cls.run_ok("specimen", "measurement", "--tooth", "block.vdb", *BUR, "--trajectory", PATH, "--u-j-per-mm3",
                         "enamel=0.42,dentin=0.085", "--alpha", "enamel=0.31,dentin=0.22", "--bias-n", "0.1,-0.05,0.02",
                         "--delay-ms", "3", "--outliers-percent", "1", "-o", name)

    @classmethod
    def run_tool(cls, *args, **more):
        return super().run_tool("-q", *args, **more)

    def refused(self, words, *arguments):
        result = self.run_tool(*arguments)
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertEqual(len(result.stderr.strip().splitlines()), 1, result.stderr)
        self.assertIn(words, result.stderr)

    def file(self, name):
        return Path(self.folder) / name

    def rewritten(self, name, change, extra=None):
        """rig.csv with its rows changed; `extra` is a column that is added."""
        head, *rows = self.file("rig.csv").read_text().splitlines()
        columns = head.split(",")
        changed = [change(dict(zip(columns, row.split(",")))) for row in rows]
        names = columns + ([extra] if extra else [])
        self.write(name, "\n".join([",".join(names), *(",".join(str(row[key]) for key in names) for row in changed)]) + "\n")

    def test_positions_in_metres_are_refused_as_such_and_not_for_their_forces(self):
        self.rewritten("metres.csv", lambda row: {**row, **{key: float(row[key]) / 1000 for key in ("x_mm", "y_mm", "z_mm")}})
        self.refused("positions in metres", "calibrate", "--tooth", "block.vdb", "--measured", "metres.csv", *BUR, "-o", "m.json")

    def test_a_recorded_speed_in_rpm_is_named(self):
        self.rewritten("rpm.csv", lambda row: {**row, "rotation_rate_rev_s": 120000}, "rotation_rate_rev_s")
        done = self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", "rpm.csv", *BUR, "--bootstrap", "50", "-o", "r.json")
        self.assertIn("likely cause: rpm: it would be 2000 rev/s", done.stderr)
        self.assertTrue(any("rpm" in warning for warning in json.loads(self.file("r.json").read_text())["warnings"]))

    def test_csv_to_parameters_to_replay(self):
        self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", *BUR, "--estimate", "delay", "-o",
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
        self.run_ok("replay", "--tooth", "block.vdb", "--params", "fit.toml", *BUR, "--trajectory", PATH, "-o", "t.h5")

    def test_same_from_h5(self):
        self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", "rig.h5", *BUR, "--estimate", "delay", "-o", "a.json")
        self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", *BUR, "--estimate", "delay", "-o",
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
        self.run_ok(*common, "--force-unit", "gf", "--estimate", "delay")
        u = json.loads(self.file("grams.json").read_text())["tissues"]["enamel"]["u_j_per_mm3"]
        self.assertLess(abs(u / 0.42 - 1), 0.05)

    def test_rounded_positions_are_named_as_the_cause_and_smoothing_cures_them(self):
        lines = self.file("rig.csv").read_text().splitlines()
        head = lines[0].split(",")
        places = [head.index(name) for name in ("x_mm", "y_mm", "z_mm")]
        rows = [line.split(",") for line in lines[1:]]
        for row in rows:
            for k in places:
                row[k] = f"{float(row[k]):.3f}"
        self.file("rounded.csv").write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n")
        common = ("calibrate", "--tooth", "block.vdb", "--measured", "rounded.csv", *BUR, "--estimate", "delay")
        rough = self.run_ok(*common, "-o", "rounded.json").stderr
        self.assertIn("rounded.csv: positions are rounded to 0.001 mm", rough)
        self.assertNotIn("sensor frame rotated", rough)
        window = rough.split("positions are rounded")[1].split("--smooth-motion-ms ")[1].split()[0]
        smooth = self.run_ok(*common, "--smooth-motion-ms", window, "-o", "smoothed.json").stderr
        self.assertNotIn("rounded", smooth)
        errors = [abs(json.loads(self.file(n).read_text())["tissues"]["enamel"]["u_j_per_mm3"] / 0.42 - 1)
                  for n in ("rounded.json", "smoothed.json")]
        self.assertLess(errors[1], 0.02)
        self.assertLess(errors[1], 0.5 * errors[0])

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
        self.run_ok("replay", "--tooth", "block.vdb", *BUR, "--trajectory", PATH, "-o", "plain.h5")
        self.refused("/force/measured: is missing", "calibrate", "--tooth", "block.vdb", "--measured", "plain.h5", *BUR, "-o",
                     "x.json")

    # A path for what takes long: at 200 Hz, side feed and plunge in both tissues.
    def short_path(self, name, speed, ahead=0.0):
        points = [(-3.6, -0.8, -1.0), (-3.2, -0.8, -1.0), (0.2 + ahead, -0.8, -1.0), (0.2 + ahead, -2.0, -1.0),
                  (-1.5, -2.0, -1.0), (-1.0, -1.6, 0.6), (-1.0, 0.5, 0.6)]
        rows, time, rate = ["time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw"], 0.0, 200
        def add(p):
            rows.append(f"{time:.6f},{p[0]:.6f},{p[1]:.6f},{p[2]:.6f},-0.7071067811865476,0,0,0.7071067811865476")
        add(points[0])
        for a, b in zip(points, points[1:]):
            length = sum((y - x) ** 2 for x, y in zip(a, b)) ** 0.5
            count = max(1, round(length / speed * rate))
            for i in range(1, count + 1):
                time += 1 / rate
                add([x + (y - x) * i / count for x, y in zip(a, b)])
        self.file(name).write_text("\n".join(rows) + "\n")
        self.file("slow.toml").write_text("[step]\ntime_step_s = 0.005\n")

    TRUTH = ("--u-j-per-mm3", "enamel=0.42,dentin=0.085", "--alpha", "enamel=0.31,dentin=0.22")

    def near_truth(self, name, tolerance):
        fit = json.loads(self.file(name).read_text())
        for tissue, u, alpha in (("enamel", 0.42, 0.31), ("dentin", 0.085, 0.22)):
            own = fit["tissues"][tissue]
            self.assertTrue(own["identifiable"], own["why_not"])
            self.assertLess(abs(own["u_j_per_mm3"] / u - 1), tolerance)
            self.assertLess(abs(own["alpha"] / alpha - 1), tolerance)
        return fit

    def test_handle_of_a_coupled_rig(self):
        self.short_path("handle.csv", 0.8)
        rig = ("--params", "slow.toml", "--stiffness-n-per-mm", "3")
        self.run_ok("specimen", "measurement", "--drive", "coupled", "--tooth", "block.vdb", *BUR, "--trajectory",
                      "handle.csv", *self.TRUTH, *rig, "--noise-percent", "0", "-o", "handle-rig.h5")
        self.run_ok("calibrate", "--drive", "coupled", "--tooth", "block.vdb", "--measured", "handle-rig.h5", *BUR, *rig,
                      "-o", "coupled.json", "--params-out", "coupled.toml")
        fit = self.near_truth("coupled.json", 1e-3)
        self.assertEqual(fit["drive"], "coupled")
        self.assertGreaterEqual(fit["replay_iterations"], 1)
        # The same file holds the bur's motion, which is taken unless the handle's is asked for.
        self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", "handle-rig.h5", *BUR, *rig, "-o", "imposed.json")
        self.assertEqual(self.near_truth("imposed.json", 0.02)["drive"], "direct")
        # Another coupling than the recording's is said.
        result = self.run_tool("calibrate", "--drive", "coupled", "--tooth", "block.vdb", "--measured", "handle-rig.h5", *BUR,
                                 "--params", "slow.toml", "--stiffness-n-per-mm", "2.9", "-o", "other.json")
        self.assertIn("was recorded with a coupling", result.stderr)

    def fitted_spindle(self, rig, handpiece, speed_noise_percent, *flags):
        """The fit of a recording (rig) of such a drooping handpiece, and the parameter file that came out."""
        self.short_path("slow.csv", 0.8)
        self.file("spindle.toml").write_text('[step]\ntime_step_s = 0.005\n[handpiece]\nmodel = "droop"\n' + handpiece)
        self.run_ok("specimen", "measurement", "--tooth", "block.vdb", *BUR, "--trajectory", "slow.csv", *self.TRUTH, "--params",
                    "spindle.toml", "--noise-percent", "2", "--speed-noise-percent", speed_noise_percent, "-o", rig)
        self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", rig, *BUR, "--time-step-s", "0.005", *flags,
                    "-o", rig + ".json", "--params-out", rig + ".toml")
        return json.loads(self.file(rig + ".json").read_text()), self.file(rig + ".toml").read_text()

    def test_droop_from_recorded_speed(self):
        fit, parameters = self.fitted_spindle("droop-rig.csv", "rotation_rate_rev_s = 130\nstall_torque_mnm = 4\n", "1",
                                              "--fit-droop")
        self.near_truth("droop-rig.csv.json", 0.03)
        self.assertTrue(fit["rotation_rate_recorded"])
        self.assertTrue(fit["droop"]["identifiable"])
        self.assertLess(abs(fit["droop"]["rotation_rate_rev_s"] / 130 - 1), 0.005)
        self.assertLess(abs(fit["droop"]["stall_torque_mnm"] / 4 - 1), 0.05)
        self.assertIn('model = "droop"', parameters)
        common = ("calibrate", "--tooth", "block.vdb", *BUR, "-o", "x.json", "--fit-droop", "--measured")
        self.refused("--fit-droop", *common, "rig.h5", "--rotation-rate-rev-s", "100")
        self.refused("--fit-droop", *common, "rig.h5", "--drive", "coupled")
        self.refused("needs the speed", *common, "rig.csv")

    ROTOR = "droop_exponent = 2\nrotation_rate_rev_s = 130\nstall_torque_mnm = 3\nrotor_inertia_g_mm2 = 1000\n"

    def test_exponent_and_rotor_from_recorded_speed(self):
        fit, parameters = self.fitted_spindle("rotor-rig.h5", self.ROTOR, "1", "--fit-droop-exponent", "--fit-rotor",
                                              "--law", "size")
        self.near_truth("rotor-rig.h5.json", 0.03)
        self.assertIn(2.0, fit["droop"]["droop_exponents_like_the_best"])
        self.assertLess(abs(fit["droop"]["rotor_inertia_g_mm2"] / 1000 - 1), 0.1)
        self.assertEqual(fit["best_law"], "paper")  # noise of the speed is no law
        self.assertIn("rotor_inertia_g_mm2", parameters)

    def test_parameters_of_another_law_have_the_handpiece_too(self):
        law = "".join(f"[tissue.{name}]\nreference_chip_um = 5\nsize_exponent = 0.4\n" for name in ("enamel", "dentin"))
        fit, parameters = self.fitted_spindle("both-rig.h5", self.ROTOR + law, "0.5", "--fit-droop-exponent", "--fit-rotor",
                                              "--law", "size")
        self.assertEqual(fit["best_law"], "size")
        self.assertRegex(parameters, "(?m)^size_exponent = ")
        self.assertRegex(parameters, "(?m)^rotor_inertia_g_mm2 = ")

    def test_a_law_with_a_size_effect_from_recording_to_parameters_to_replay(self):
        self.short_path("slow.csv", 0.8)
        law = "\n".join(f"[tissue.{name}]\nreference_chip_um = 5\nsize_exponent = {m}" for name, m in
                        (("enamel", 0.35), ("dentin", 0.2)))
        self.file("size.toml").write_text("[step]\ntime_step_s = 0.005\n" + law)
        self.short_path("fast.csv", 4)
        for path in ("slow.csv", "fast.csv"):
            self.run_ok("specimen", "measurement", "--tooth", "block.vdb", *BUR, "--trajectory", path, *self.TRUTH,
                          "--params", "size.toml", "--noise-percent", "2", "-o", "size-" + path)
        common = ("calibrate", "--tooth", "block.vdb", *BUR, "--time-step-s", "0.005", "--measured", "size-slow.csv",
                  "size-fast.csv", "-o")
        self.run_ok(*common, "size.json", "--law", "size,up-cutting", "--params-out", "size-fit.toml", "--bootstrap", "100")
        fit = json.loads(self.file("size.json").read_text())
        self.assertEqual([law["law"] for law in fit["laws"]], ["paper", "size", "up-cutting"])
        self.assertEqual(fit["best_law"], "size")
        own = fit["laws"][1]["tissues"]
        for tissue, m in (("enamel", 0.35), ("dentin", 0.2)):
            low, high = own[tissue]["size_exponent_ci95"]
            self.assertLess(abs(own[tissue]["size_exponent"] - m), 0.05)
            self.assertLess(high - low, 0.2)
        self.assertLess(fit["laws"][1]["validation_rms_n"], 0.7 * fit["laws"][0]["validation_rms_n"])
        self.assertIn("size_exponent", self.file("size-fit.toml").read_text())
        self.refused("--law needs", *common, "x.json", "--law", "size", "--drive", "coupled")
        self.refused("fits the paper's law", *common, "x.json", "--params", "size.toml")

    def test_h5_of_someone_else_with_the_bur_only(self):
        import h5py
        with h5py.File(self.file("rig.h5")) as rig, h5py.File(self.file("own.h5"), "w") as own:
            for name in ("time", "bur/position", "bur/orientation", "force/measured"):
                own.create_dataset(name, data=rig[name][:]).attrs["units"] = rig[name].attrs["units"]
        self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", "own.h5", *BUR, "--estimate", "delay", "-o", "own.json")
        self.run_ok("calibrate", "--tooth", "block.vdb", "--measured", "rig.h5", *BUR, "--estimate", "delay", "-o",
                      "whole.json")
        a, b = (json.loads(self.file(n).read_text())["tissues"]["enamel"]["u_j_per_mm3"] for n in ("own.json", "whole.json"))
        self.assertAlmostEqual(a, b, places=9)
        self.refused("/handle/position: is missing", "calibrate", "--drive", "coupled", "--tooth", "block.vdb", "--measured",
                     "own.h5", *BUR, "-o", "x.json")

    def test_same_for_any_number_of_threads(self):
        texts = []
        for threads in ("1", "4"):
            self.run_ok("--threads", threads, "calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", "rig.h5", *BUR,
                          "--estimate", "delay", "-o", "threads.json", "--force")
            texts.append(self.file("threads.json").read_text())
        self.assertEqual(*texts)

    def test_noisy_motion_and_stalls_are_said(self):
        self.run_ok("specimen", "measurement", "--tooth", "block.vdb", *BUR, "--trajectory", PATH, "--position-noise-um", "3",
                      "-o", "shaky.csv")
        result = self.run_tool("calibrate", "--tooth", "block.vdb", "--measured", "shaky.csv", *BUR, "-o", "shaky.json")
        self.assertIn("--smooth-motion-ms", result.stderr)
        result = self.run_tool("calibrate", "--tooth", "block.vdb", "--measured", "shaky.csv", *BUR, "-o", "smooth.json",
                                 "--smooth-motion-ms", "100")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertNotIn("velocity's noise", result.stderr)
        own = json.loads(self.file("smooth.json").read_text())["tissues"]["enamel"]
        self.assertLess(abs(own["u_j_per_mm3"] / 0.3 - 1), 0.05)
        lines = self.file("rig.csv").read_text().splitlines()
        still = [lines[0] + ",stalled"] + [f"{line},{1 if 3000 <= i < 3200 else 0}" for i, line in enumerate(lines[1:])]
        self.file("still.csv").write_text("\n".join(still) + "\n")
        result = self.run_tool("calibrate", "--tooth", "block.vdb", "--measured", "still.csv", *BUR, "-o", "still.json")
        self.assertIn("stood still in 200 samples", result.stderr)
        self.assertGreaterEqual(json.loads(self.file("still.json").read_text())["recordings"][0]["samples_stalled"], 200)

    def test_bad_options(self):
        common = ("calibrate", "--tooth", "block.vdb", "--measured", "rig.h5", *BUR, "-o", "x.json")
        self.refused("weight", *common, "--estimate", "weight")
        self.refused("no parameter is identifiable", *common, "--bias", "1e160,0,0")
        measurement = ("specimen", "measurement", "--tooth", "block.vdb", *BUR, "--trajectory", PATH, "-o", "y.h5")
        for words, arguments in (("--bias", (*common, "--bias", "none")), ("--bias", (*common, "--bias", "1,nan,0")),
                                 ("TISSUE=VALUE", (*measurement, "--alpha", "enamel")),
                                 ("TISSUE=VALUE", (*measurement, "--alpha", "enamel=nan"))):
            result = self.run_tool(*arguments)
            self.assertEqual(result.returncode, 2, result.stderr)
            self.assertIn(words, result.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
