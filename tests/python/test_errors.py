"""What goes wrong, and as which exception with which parts."""
import pickle
import warnings

import numpy as np
import toothprep
from module_test import CommandTest, main

BUR = "cylinder:D1.2xL3.0"


class Errors(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.tooth = toothprep.block(size_mm=3, enamel_mm=1, voxel_mm=0.2)

    def error_of(self, call, *args, **more):
        with self.assertRaises(toothprep.Error) as raised:
            call(*args, **more)
        return raised.exception

    def test_parts_of_an_unreadable_file(self):
        error = self.error_of(toothprep.load, self.path("absent.vdb"))
        self.assertEqual(error.file, self.path("absent.vdb"))
        self.assertTrue(error.condition)
        self.assertTrue(str(error).startswith(error.file))

    def test_parts_of_a_wrong_parameter_file(self):
        self.write("wrong.toml", "[tissue.enamel]\nforce_ratio = -1\n")
        error = self.error_of(toothprep.Session, self.tooth, BUR, self.path("wrong.toml"))
        self.assertEqual(error.file, self.path("wrong.toml"))
        self.assertIn("force_ratio", str(error))

    def test_unknown_key_of_a_dict_names_the_nearest(self):
        error = self.error_of(toothprep.parameters, {"tissue": {"enamel": {"force_rato": 1}}})
        self.assertEqual(error.file, "parameters")
        self.assertIn("force_rato", str(error))
        self.assertIn("force_ratio", str(error))

    def test_parts_of_a_wrong_trajectory(self):
        self.write("path.csv", "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n0.001,0,nan,0\n")
        error = self.error_of(toothprep.load_trajectory, self.path("path.csv"))
        self.assertEqual(error.file, self.path("path.csv"))
        self.assertIn("3", error.place)

    def test_parts_of_a_damaged_trace(self):
        self.write("trace.h5", b"\x89HDF\r\n\x1a\n" + bytes(500))
        self.assertEqual(self.error_of(toothprep.load_trace, self.path("trace.h5")).file, self.path("trace.h5"))

    def test_errors_without_a_file_have_empty_parts(self):
        error = self.error_of(toothprep.block, voxel_mm=-1)
        self.assertEqual((error.file, error.place, error.remedy), ("", "", ""))
        self.assertEqual(error.condition, str(error))

    def test_errors_can_be_pickled(self):
        error = self.error_of(toothprep.load, self.path("absent.vdb"))
        again = pickle.loads(pickle.dumps(error))
        self.assertEqual((str(again), again.file, again.condition), (str(error), error.file, error.condition))

    def test_wrong_arguments_are_pythons_errors(self):
        session = toothprep.Session(self.tooth, BUR, position=(0, 1, 0))
        for kind, call in [
                (TypeError, lambda: toothprep.load(3)),
                (TypeError, lambda: toothprep.Bur(1.2)),
                (TypeError, lambda: toothprep.block(enamel_mm="2")),
                (TypeError, lambda: toothprep.parameters(3)),
                (TypeError, lambda: toothprep.parameters({"preset": [1]})),
                (OverflowError, lambda: toothprep.parameters({"handpiece": {"rotation_rate_rev_s": 2**70}})),
                (TypeError, lambda: toothprep.Session(None, BUR)),
                (TypeError, lambda: toothprep.Session("tooth.vdb", BUR)),
                (ValueError, lambda: toothprep.Session(self.tooth, BUR, drive="loose")),
                (ValueError, lambda: toothprep.Session(self.tooth, BUR, position=(0, 1))),
                (ValueError, lambda: toothprep.Session(self.tooth, BUR, position=(0, 1, 0), orientation=(0, 0, 0, 2))),
                (ValueError, lambda: session.step((0, np.nan, 0))),
                (TypeError, lambda: session.step(None)),
                (OverflowError, lambda: session.step((0, 1, 0), buttons=-1)),
                (OverflowError, lambda: session.step((0, 1, 0), buttons=2**33)),
                (ValueError, lambda: session.run([0], [(0, 1, 0)])),
                (ValueError, lambda: session.run([0, 0.001], [(0, 1, 0)])),
                (ValueError, lambda: session.run([0, 0.001], [(0, 1), (0, 1)])),
                (ValueError, lambda: session.run([0, 0.001], [(0, 1, 0), (0, np.inf, 0)])),
                (OverflowError, lambda: session.run([0, 0.001], [(0, 1, 0)] * 2, buttons=[1, -1])),
                (TypeError, lambda: session.run([0, 0.001], [(0, 1, 0)] * 2, progress=3)),
                (ValueError, lambda: self.tooth.dense("gum")),
                (ValueError, lambda: self.tooth.bricks("gum")),
                (ValueError, lambda: self.tooth.mesh("gum")),
                (ValueError, lambda: toothprep.voxelize()),
                (ValueError, lambda: toothprep.voxelize("scan.nrrd", labels={"gum": 1})),
                (TypeError, lambda: toothprep.voxelize("scan.nrrd", voxel_mm="fine")),
                (TypeError, lambda: toothprep.voxelize("scan.nrrd", tooth="large")),
                (TypeError, lambda: toothprep.voxelize("scan.nrrd", tooth=1, neighbours={"37": "large"})),
                (ValueError, lambda: toothprep.voxelize("scan.nrrd", neighbours={"37": 2})),
                (ValueError, lambda: toothprep.calibrate(self.tooth, "m.h5", BUR, loss="least")),
                (ValueError, lambda: toothprep.calibrate(self.tooth, "m.h5", BUR, estimate="mass")),
                (toothprep.Error, lambda: toothprep.calibrate(self.tooth, "m.h5", BUR, law="newton")),
                (ValueError, lambda: toothprep.score("a.vdb", "b.vdb", type="class9")),
                (TypeError, lambda: toothprep.score(self.tooth, self.tooth)),
                (ValueError, lambda: toothprep.set_threads(-1))]:
            with self.assertRaises(kind):
                call()
        self.assertEqual(session.totals["steps"], 0)

    def test_time_that_does_not_increase_names_the_time(self):
        session = toothprep.Session(self.tooth, BUR, position=(0, 1, 0))
        error = self.error_of(session.run, [0, 0.001, 0.001], [(0, 1, 0)] * 3)
        self.assertIn("0.001", error.place)

    def test_what_cannot_be_meant_is_a_warning(self):
        session = toothprep.Session(self.tooth, BUR, position=(0, 1, 0))
        time = np.arange(100) * 0.001
        with self.assertWarnsRegex(UserWarning, "path: "):  # 10 m/s
            session.run(time, np.stack([10e3 * time, 1 + 0 * time, 0 * time], axis=1))

    def test_warnings_of_a_run_are_those_of_replay(self):
        time = np.arange(100) * 0.001
        position = np.stack([0 * time, 0.5 - 20 * time, 0 * time], axis=1)
        self.tooth.save(self.path("tooth.vdb"))
        with open(self.path("path.csv"), "w") as file:
            file.write("time_s,x_mm,y_mm,z_mm\n")
            file.writelines(f"{t!r},{x!r},{y!r},{z!r}\n" for t, (x, y, z) in zip(time.tolist(), position.tolist()))
        done = self.run_ok("replay", "--tooth", "tooth.vdb", "--trajectory", "path.csv", "--bur", BUR, "--drive",
                           "direct", "-o", "run.h5")
        theirs = [line.removeprefix("warning: ").replace("path.csv: ", "path: ")
                  for line in done.stderr.splitlines() if line.startswith("warning: ")]
        self.assertTrue(any("stall torque" in line for line in theirs))
        with warnings.catch_warnings(record=True) as ours:
            warnings.simplefilter("always")
            toothprep.Session(self.tooth, BUR, drive="direct", position=position[0]).run(time, position)
        self.assertEqual([str(w.message) for w in ours], theirs)

    def test_bur_too_thin_for_the_voxels_is_refused_at_once(self):
        self.assertIn("voxel", str(self.error_of(toothprep.Session, self.tooth, "ball:D0.3", position=(0, 1, 0))))


if __name__ == "__main__":
    main()
