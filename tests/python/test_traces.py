"""Traces: what h5py reads is what the module gives, and the other way round."""
import importlib.util
import unittest

import h5py
import numpy as np
import toothprep
from module_test import CommandTest, main, plunge_and_drag, write_csv

BUR = "cylinder:D1.2xL3.0"


class Traces(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        tooth = toothprep.block()
        tooth.save(cls.path("block.vdb"))
        write_csv(cls.path("path.csv"), *plunge_and_drag(seconds=1.5))
        cls.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "path.csv", "--bur", BUR, "-o", "trace.h5")
        cls.trace = toothprep.load_trace(cls.path("trace.h5"))

    def test_arrays_are_the_datasets(self):
        with h5py.File(self.path("trace.h5")) as file:
            for name, values in self.trace.items():
                self.assertEqual(values.dtype, file[name].dtype, name)
                np.testing.assert_array_equal(values, file[name][()], name)
                self.assertEqual(self.trace.units[name], file[name].attrs["units"], name)
            self.assertEqual(tuple(file["removed/volume"].attrs["tissues"]), self.trace.tissues)
            for name, value in self.trace.attributes.items():
                self.assertEqual(file.attrs[name], value, name)

    def test_saved_trace_is_the_file_again(self):
        self.trace.save(self.path("again.h5"))
        self.assertEqual(self.read("again.h5"), self.read("trace.h5"))
        with self.assertRaises(toothprep.Error):
            self.trace.save(self.path("again.h5"), overwrite=False)

    def test_measured_force_goes_through_a_file(self):
        trace = toothprep.Trace(self.trace, self.trace.attributes)
        trace["force/measured"] = 2 * trace["force/grinding"]
        trace.save(self.path("measured.h5"))
        again = toothprep.load_trace(self.path("measured.h5"))
        np.testing.assert_array_equal(again["force/measured"], 2 * self.trace["force/grinding"])
        motion = toothprep.load_trajectory(self.path("measured.h5"))
        np.testing.assert_array_equal(motion["force/measured"], again["force/measured"])
        np.testing.assert_array_equal(motion["handle/position"], again["handle/position"])

    def test_arrays_of_another_shape_are_refused(self):
        for name, values in [("torque", np.zeros(3)), ("force/device", np.zeros(len(self.trace["time"])))]:
            trace = toothprep.Trace(self.trace, self.trace.attributes)
            trace[name] = values
            with self.assertRaisesRegex(ValueError, name):
                trace.save(self.path("wrong.h5"))
        trace = toothprep.Trace({"time": self.trace["time"]}, self.trace.attributes)
        with self.assertRaises(KeyError):
            trace.save(self.path("wrong.h5"))

    def test_reading_while_h5py_holds_another_file(self):
        with h5py.File(self.path("other.h5"), "w") as file:
            file["x"] = np.arange(10)
            again = toothprep.load_trace(self.path("trace.h5"))
            self.assertEqual(len(file["x"]), 10)
        np.testing.assert_array_equal(again["time"], self.trace["time"])

    @unittest.skipUnless(importlib.util.find_spec("pandas"), "pandas is not there")
    def test_dataframe_has_the_columns_of_the_export(self):
        self.run_ok("export", "trace.h5", "-o", "trace.csv")
        import pandas
        exported = pandas.read_csv(self.path("trace.csv"), float_precision="round_trip")
        frame = self.trace.dataframe()
        self.assertEqual(list(frame.columns), list(exported.columns))
        np.testing.assert_array_equal(frame.to_numpy(float), exported.to_numpy(float))


if __name__ == "__main__":
    main()
