"""Sessions: the same bits as the program, from row 0 on, and figures that physics gives."""
import json

import h5py
import numpy as np
import toothprep
from module_test import CommandTest, main, plunge_and_drag, write_csv

BUR = "cylinder:D1.2xL3.0"


class Sessions(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.tooth = toothprep.block()
        cls.tooth.save(cls.path("block.vdb"))
        cls.motion = plunge_and_drag()
        write_csv(cls.path("path.csv"), *cls.motion)

    def replay(self, name, trajectory, *more):
        done = self.run_ok("replay", "--tooth", "block.vdb", "--trajectory", trajectory, "--bur", BUR, "-o", name,
                           "--json", "--force", *more)
        with h5py.File(self.path(name)) as file:
            datasets = {}
            file.visititems(lambda key, item: datasets.update({key: item[()]}) if hasattr(item, "shape") else None)
            return datasets, json.loads(done.stdout), dict(file.attrs)

    def assert_same_bits(self, ours, theirs):
        self.assertEqual(set(ours), set(theirs))
        for name in theirs:
            self.assertEqual(ours[name].dtype, theirs[name].dtype, name)
            np.testing.assert_array_equal(ours[name], theirs[name], name)  # NaN-free: files hold finite values

    def test_run_equals_replay_in_both_drives(self):
        time, position, orientation, buttons = self.motion
        for drive in ("coupled", "direct"):
            with self.subTest(drive):
                theirs, figures, attributes = self.replay("trace.h5", "path.csv", "--drive", drive)
                session = toothprep.Session(self.tooth, BUR, drive=drive, position=position[0],
                                            orientation=orientation[0])
                ours = session.run(time, position, orientation, buttons)
                self.assert_same_bits(ours, theirs)
                self.assertGreater(np.abs(ours["force/device"]).max(), 0.05)
                self.assertGreater(ours["removed/volume"][-1].sum(), 0.1)
                for key in ("energy_ratio", "torque_work_mj", "peak_force_n", "stalled_steps", "removed_mm3"):
                    self.assertEqual(session.totals[key], figures[key], key)
                for key in ("parameters", "tooth_sha256", "bur", "drive", "engine", "energy_ratio"):
                    self.assertEqual(ours.attributes[key], attributes[key], key)

    def test_an_imposed_load_equals_replay(self):
        time = np.arange(300) * 1e-3
        position, load = np.tile([0, 0.65, -1.5], (300, 1)), (0.1, -2, 0.2)
        write_csv(self.path("held.csv"), time, position, np.tile([0, 0, 0, 1.0], (300, 1)), np.ones(300, int))
        theirs, figures, attributes = self.replay("trace.h5", "held.csv", "--drive", "load", "--load-n", "0.1,-2,0.2")
        session = toothprep.Session(self.tooth, BUR, drive="load")
        ours = session.run(time, position, load=load)
        self.assert_same_bits(ours, theirs)
        self.assertEqual(ours.attributes["drive"], "load")
        self.assertGreater(session.totals["contact_steps"], 100)
        stepped = toothprep.Session(self.tooth, BUR, drive="load", position=position[0])
        for _ in time[1:]:
            row = stepped.step(position[0], load=load)
        np.testing.assert_array_equal(row.bur_position, theirs["bur/position"][-1])
        ours.save(self.path("saved.h5"))
        again = toothprep.load_trace(self.path("saved.h5"))
        np.testing.assert_array_equal(again["force/applied"], np.tile(load, (300, 1)))
        with self.assertRaisesRegex(ValueError, "needs the load"):
            stepped.step(position[0])
        with self.assertRaisesRegex(ValueError, "for sessions with drive='load'"):
            toothprep.Session(self.tooth, BUR).run(time, position, load=load)
        with self.assertRaisesRegex(ValueError, "not finite"):
            stepped.step(position[0], load=(0, float("nan"), 0))
        with self.assertRaisesRegex(toothprep.Error, "without touching the tooth"):
            toothprep.Session(self.tooth, BUR, drive="load").run(time, position, load=(0, 1, 0))

    def test_voxel_engine_and_physical_preset_equal_replay(self):
        time, position, orientation, buttons = self.motion
        theirs, _, _ = self.replay("trace.h5", "path.csv", "--preset", "physical", "--engine", "voxel")
        session = toothprep.Session(self.tooth, BUR, {"preset": "physical", "engine": {"kind": "voxel"}},
                                    position=position[0], orientation=orientation[0])
        self.assert_same_bits(session.run(time, position, orientation, buttons), theirs)

    def test_script_of_another_rate_is_resampled_as_replay_does(self):
        self.write("path.toml", 'start_mm = [0, 0.2, 0]\naxis = [0, 1, 0]\nrate_hz = 400\n'
                   '[[segment]]\nkind = "line"\nto_mm = [0.3, -0.3, 0]\nspeed_mm_s = 1.0\n')
        motion = toothprep.load_trajectory(self.path("path.toml"))
        theirs, _, _ = self.replay("trace.h5", "path.toml")
        session = toothprep.Session(self.tooth, BUR, position=motion["handle/position"][0],
                                    orientation=motion["handle/orientation"][0])
        ours = session.run(motion["time"], motion["handle/position"], motion["handle/orientation"])
        self.assertGreater(len(ours["time"]), 2 * len(motion["time"]))
        self.assert_same_bits(ours, theirs)

    def test_rejected_readings_of_a_recording_make_no_step_as_in_replay(self):
        time, position, orientation, buttons = self.motion
        session = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        recorded = session.run(time, position, orientation, buttons)
        recorded["reading_rejected"][400:410] = 1
        recorded["handle/position"][400:410] = 1e3
        recorded.save(self.path("recorded.h5"))
        theirs, _, _ = self.replay("again.h5", "recorded.h5")
        motion = toothprep.load_trajectory(self.path("recorded.h5"))
        session = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        ours = session.run(motion["time"], motion["handle/position"], motion["handle/orientation"],
                           motion["handle/buttons"], rejected=motion["reading_rejected"])
        self.assert_same_bits(ours, theirs)
        self.assertEqual(session.totals["rejected_steps"], 10)
        self.assertFalse(ours["force/device"][400:410].any())

    def test_row_0_is_the_start(self):
        time, position, orientation, buttons = self.motion
        session = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        trace = session.run(time + 5, position, orientation, buttons)
        np.testing.assert_array_equal(trace["time"], time + 5)
        np.testing.assert_array_equal(trace["bur/position"][0], position[0])
        for name in ("force/device", "force/grinding", "torque", "power", "removed/volume", "bur/velocity"):
            self.assertFalse(np.any(trace[name][0]), name)

    def test_steps_equal_the_run_row_by_row(self):
        time, position, orientation, buttons = self.motion
        run = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        trace = run.run(time, position, orientation, buttons)
        session = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        for i in range(1, len(time)):
            record = session.step(position[i], orientation[i], int(buttons[i]))
            if i == len(time) - 1:
                record = session.finish()
            for name in trace:
                np.testing.assert_array_equal(getattr(record, name.replace("/", "_")), trace[name][i], f"{name} {i}")
        self.assertEqual(session.totals, run.totals)

    def test_without_a_position_the_first_sample_is_the_start(self):
        time, position, orientation, buttons = self.motion
        given = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        found = toothprep.Session(self.tooth, BUR)
        first = given.run(time, position, orientation, buttons)
        self.assert_same_bits(found.run(time, position, orientation, buttons), first)
        stepped = toothprep.Session(self.tooth, BUR)
        self.assertEqual(stepped.step(position[0]).torque, 0)
        self.assertEqual(stepped.totals["steps"], 0)

    def test_a_run_goes_on_where_the_last_one_ended(self):
        time, position, orientation, buttons = self.motion
        session = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        half = len(time) // 2
        session.run(time[:half + 1], position[:half + 1], orientation[:half + 1], buttons[:half + 1])
        removed = sum(session.totals["removed_mm3"].values())
        trace = session.run(time[half:], position[half:], orientation[half:], buttons[half:])
        self.assertEqual(trace["time"][0], time[half])
        self.assertAlmostEqual(trace["removed/volume"][0].sum(), removed)
        self.assertGreater(trace["removed/volume"][-1].sum(), removed + 0.05)
        self.assertAlmostEqual(session.totals["energy_ratio"], 1, delta=0.05)

    def test_a_path_that_begins_elsewhere_is_refused(self):
        session = toothprep.Session(self.tooth, BUR, position=(0, 1, 0))
        with self.assertRaisesRegex(ValueError, "row 0 is the start"):
            session.run([0, 0.001], [(0, 0.9, 0), (0, 0.8, 0)])
        self.assertEqual(session.totals["steps"], 0)

    def test_remaining_is_what_prepared_holds(self):
        time, position, orientation, buttons = self.motion
        self.replay("trace.h5", "path.csv", "--prepared", "prepared.vdb")
        session = toothprep.Session(self.tooth, BUR, position=position[0], orientation=orientation[0])
        session.run(time, position, orientation, buttons)
        self.assertEqual(session.remaining().sha256, toothprep.load(self.path("prepared.vdb")).sha256)
        mesh = session.remaining_mesh()
        np.testing.assert_array_equal(mesh["vertices"], session.remaining().mesh()["vertices"])

    def test_torque_of_a_slot_is_u_d_depth_v_over_two_pi_n(self):
        # The bur starts within the block, so the slot is full at once: the power 2 pi N T is u D d v.
        u, diameter, depth, speed, rate = 300, 1.2, 1.0, 0.4, 100  # N/mm^2, mm, mm, mm/s, rev/s
        time = np.arange(1500) * 0.001
        position = np.stack([speed * time, 0 * time - depth, 0 * time], axis=1)
        half = np.sqrt(0.5)
        session = toothprep.Session(self.tooth, BUR, {"handpiece": {"stall_torque_mnm": float("inf")}}, drive="direct",
                                    position=position[0], orientation=(-half, 0, 0, half))
        torque = session.run(time, position)["torque"][500:].mean()
        self.assertAlmostEqual(torque * 2 * np.pi * rate / (u * diameter * depth * speed), 1, delta=0.02)


if __name__ == "__main__":
    main()
