"""Recordings of known truth, written as other labs write them, and read in by `toothprep import`.

Usage: test_import.py BINARY
"""
import json
import os
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest  # noqa: E402

RATE = 500.0
COUNT = 1500
MICROMETRE, HUNDREDTH_DEGREE = 1e-3, np.radians(0.01)


def multiply(a, b):
    """Quaternions x, y, z, w in rows."""
    av, aw, bv, bw = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    return np.concatenate([aw * bv + bw * av + np.cross(av, bv), aw * bw - np.sum(av * bv, -1, keepdims=True)], -1)


def conjugate(q):
    return q * np.array([-1, -1, -1, 1])


def about(axis, angle):
    axis = np.eye(3)["xyz".index(axis)]
    angle = np.atleast_1d(angle)[:, None] / 2
    return np.concatenate([np.sin(angle) * axis, np.cos(angle)], 1)


def turned(q, v):
    v4 = np.concatenate([np.broadcast_to(v, q[..., :3].shape), np.zeros(q.shape[:-1] + (1,))], -1)
    return multiply(multiply(q, v4), conjugate(q))[..., :3]


def matrices(q):
    return np.stack([turned(q, e) for e in np.eye(3)], -1)


def angle_between(p, q):
    return 2 * np.arccos(np.clip(np.abs(np.sum(p * q, -1)), 0, 1))


class Truth:
    """Three seconds at a tooth: a curved path, a bur that tilts, forces while it cuts."""
    time = np.arange(COUNT) / RATE
    position = np.stack([3 * np.sin(2.1 * time), 2 * np.cos(1.3 * time) + 5, 0.8 * time - 1], 1)
    roll, pitch, yaw = 0.4 * np.sin(time), 0.3 * np.cos(1.7 * time), 0.9 * time
    orientation = multiply(about("z", yaw), multiply(about("y", pitch), about("x", roll)))
    velocity = np.gradient(position, time, axis=0)
    cuts = (np.sin(4 * time) > 0)[:, None]
    force = -0.4 * velocity * cuts
    buttons = (np.sin(4 * time) > -0.5).astype(int)


class ImportTest(CommandTest):
    def imported(self, name, *options):
        """(time, position, orientation, file's other datasets, JSON) after a successful import."""
        done = self.run_ok("import", name, *options, "-o", "out.h5", "--json", "--force")
        with h5py.File(self.path("out.h5")) as file:
            data = {k: file[k][...] for k in ("time", "handle/position", "handle/orientation", "handle/buttons")}
            for k in ("force/measured", "rotation_rate", "stalled"):
                if k in file:
                    data[k] = file[k][...]
        return data, json.loads(done.stdout), done.stderr

    def refused(self, name, *options, says):
        done = self.run_tool("import", name, *options, "-o", "none.h5")
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertRegex(done.stderr.splitlines()[-1], says)
        self.assertFalse(os.path.exists(self.path("none.h5")))

    def assert_true_path(self, data, position=MICROMETRE, angle=HUNDREDTH_DEGREE, rows=slice(None)):
        self.assertEqual(len(data["time"]), len(Truth.time[rows]))
        np.testing.assert_allclose(data["time"], Truth.time[rows] - Truth.time[rows][0], atol=1e-7)
        worst = np.abs(data["handle/position"] - Truth.position[rows]).max()
        self.assertLess(worst, position)
        self.assertLess(angle_between(data["handle/orientation"], Truth.orientation[rows]).max(), angle)

    def write_table(self, name, header, columns, separator=",", decimal=".", before="", encoding="utf-8", digits=9):
        lines = [] if header is None else [separator.join(header)]
        for row in zip(*columns):
            lines.append(separator.join(
                (v if isinstance(v, str) else f"{v:.{digits}f}" if isinstance(v, (float, np.floating)) else str(v))
                .replace(".", decimal) for v in row))
        self.write(name, (before + "\n".join(lines) + "\n").encode(encoding))


class Tables(ImportTest):
    position, q = Truth.position.T, Truth.orientation.T

    def test_separators_decimal_commas_encodings_headers_and_preambles(self):
        plain = ["time_s", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]
        columns = [Truth.time, *self.position, *self.q]
        upper = ["Time (s)", "PosX [mm]", "PosY [mm]", "PosZ [mm]", "QX", "QY", "QZ", "QW"]
        variants = {
            "plain.csv": dict(header=plain), "tabs.tsv": dict(header=upper, separator="\t"),
            "comma.csv": dict(header=upper, separator=";", decimal=","), "blanks.txt": dict(header=plain, separator="  "),
            "bom.csv": dict(header=plain, encoding="utf-8-sig"), "utf16.txt": dict(header=upper, separator="\t", encoding="utf-16"),
            "numpy.txt": dict(header=["# time_s"] + plain[1:], separator=" "),
            "tabs_comma.txt": dict(header=upper, separator="\t", decimal=","),
            "preamble.csv": dict(header=upper, before="Rig 7, Lab\nOperator: N.N.\n\n% tool 3\n"),
            "quoted.csv": dict(header=['"%s"' % h for h in upper]),
            "crlf.csv": dict(header=[*plain[:-1], plain[-1] + "\r"]),
        }
        for name, options in variants.items():
            with self.subTest(name):
                self.write_table(name, columns=columns, **options)
                data, facts, _ = self.imported(name)
                self.assert_true_path(data)
                self.assertEqual(facts["warnings"], [])

    def test_a_line_of_units_and_further_columns_are_read(self):
        header = ["Frame", "Time", "TipX", "TipY", "TipZ", "q0", "qx", "qy", "qz", "VelX", "Comment", "Pedal", "Speed"]
        units = ["", "(ms)", "(m)", "(m)", "(m)", "", "", "", "", "(m/s)", "", "", "(rpm)"]
        columns = [np.arange(COUNT), Truth.time * 1e3, *(self.position / 1e3), self.q[3], *self.q[:3], Truth.velocity[:, 0],
                   ["ok"] * COUNT, Truth.buttons, np.full(COUNT, 6000.0)]
        self.write_table("units.csv", header, columns, before="", digits=10)
        text = self.read("units.csv").decode().split("\n", 1)
        self.write("units.csv", text[0] + "\n" + ",".join(units) + "\n" + text[1])
        data, facts, stderr = self.imported("units.csv")
        self.assert_true_path(data)
        np.testing.assert_array_equal(data["handle/buttons"], Truth.buttons)
        np.testing.assert_allclose(data["rotation_rate"], 100)
        self.assertRegex(" ".join(facts["notes"]), "columns not used: Frame, VelX")
        self.assertIn("Comment", stderr)

    def test_a_table_without_a_header_is_read_by_numbers(self):
        self.write_table("bare.txt", None, [Truth.time, *self.position, *self.q], separator=" ")
        self.refused("bare.txt", says="--columns x=NAME")
        data, _, _ = self.imported("bare.txt", "--columns", "time=1,x=2,y=3,z=4,qx=5,qy=6,qz=7,qw=8", "--length-unit", "mm")
        self.assert_true_path(data)

    def test_ros_tables_keep_the_nanoseconds(self):
        stamps = 1_700_000_000_123_456_789 + (np.arange(COUNT) * 2_000_000)
        header = ["%time", "field.header.seq", "field.header.frame_id", "field.pose.position.x", "field.pose.position.y",
                  "field.pose.position.z", "field.pose.orientation.x", "field.pose.orientation.y",
                  "field.pose.orientation.z", "field.pose.orientation.w"]
        self.write_table("ros.csv", header, [stamps, np.arange(COUNT), ["world"] * COUNT, *(self.position / 1e3), *self.q], digits=10)
        data, facts, _ = self.imported("ros.csv")
        self.assert_true_path(data)
        np.testing.assert_allclose(np.diff(data["time"]), 0.002, atol=1e-12)
        self.assertRegex(" ".join(facts["warnings"]), "taken for ns.*taken for m")

    def test_units_that_nobody_states_are_assumed_aloud_or_asked_for(self):
        self.write_table("meters.csv", ["t", "x", "y", "z"], [Truth.time, *(self.position / 1e3)])
        data, facts, stderr = self.imported("meters.csv")
        np.testing.assert_allclose(data["handle/position"], Truth.position, atol=1e-3)
        self.assertRegex(stderr, "warning: .*taken for m: the path spans")
        self.assertRegex(stderr, "warning: .*no orientation")
        self.assertEqual(self.run_tool("import", "meters.csv", "-o", "none.h5", "--strict").returncode, 1)
        self.write_table("stated.csv", ["t_s", "x_m", "y_m", "z_m"], [Truth.time, *self.position])
        self.refused("stated.csv", says=r"spans 6 m in this unit.*--length-unit mm")
        self.write_table("between.csv", ["t", "x", "y", "z"], [Truth.time, *(self.position * 120)])
        self.refused("between.csv", says="no path at a tooth.*--length-unit")

    def test_clock_times_and_rates_in_place_of_seconds(self):
        clock = [f"12:59:{58 + t:09.6f}" if t < 2 else f"13:00:{t - 2:09.6f}" for t in Truth.time]
        self.write_table("clock.csv", ["Timestamp", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"], [clock, *self.position, *self.q])
        data, _, _ = self.imported("clock.csv")
        self.assert_true_path(data)
        self.write_table("no_time.csv", ["sample", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"], [np.arange(COUNT), *self.position, *self.q])
        self.refused("no_time.csv", says="--rate-hz")
        data, _, _ = self.imported("no_time.csv", "--rate-hz", "500")
        self.assert_true_path(data)

    def test_the_exports_own_csv_reads_back_bit_for_bit(self):
        self.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "3,2,3", "--force")
        self.write("slot.toml", 'start_mm = [0, 0.5, -2.2]\naxis = [0, 1, 0]\n[[segment]]\nkind = "line"\n'
                                'to_mm = [0, 0.4, -2]\nspeed_mm_s = 2\n')
        self.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "slot.toml", "--bur", "cylinder:D1.2xL3.0", "-o", "trace.h5")
        self.run_ok("export", "trace.h5", "-o", "trace.csv")
        data, facts, _ = self.imported("trace.csv")
        with h5py.File(self.path("trace.h5")) as trace:
            for name in ("time", "handle/position", "handle/orientation", "handle/buttons"):
                np.testing.assert_array_equal(data[name], trace[name][...])
        self.assertEqual(facts["warnings"], [])
        data, _, _ = self.imported("trace.h5")
        with h5py.File(self.path("trace.h5")) as trace:
            np.testing.assert_array_equal(data["handle/position"], trace["handle/position"][...])
        self.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "out.h5", "--bur", "cylinder:D1.2xL3.0", "-o", "again.h5")
        with h5py.File(self.path("trace.h5")) as one, h5py.File(self.path("again.h5")) as two:
            np.testing.assert_array_equal(one["force/device"][...], two["force/device"][...])


class Orientations(ImportTest):
    head = ["time_s", "x_mm", "y_mm", "z_mm"]
    motion = [Truth.time, *Truth.position.T]

    def test_quaternion_orders(self):
        q = Truth.orientation.T
        self.write_table("wxyz.csv", self.head + ["q1", "q2", "q3", "q4"], self.motion + [q[3], *q[:3]])
        columns = "time=1,x=2,y=3,z=4,qw=5,qx=6,qy=7,qz=8"
        self.assert_true_path(self.imported("wxyz.csv", "--columns", columns)[0])
        self.write_table("wrong.csv", self.head + ["qx", "qy", "qz", "qw"], self.motion + [q[3], *q[:3]])
        self.assert_true_path(self.imported("wrong.csv", "--quaternion", "wxyz")[0])
        self.write_table("q0.csv", self.head + ["q0", "q1", "q2", "q3"], self.motion + [q[3], *q[:3]])
        data, facts, _ = self.imported("q0.csv")
        self.assert_true_path(data)
        self.assertRegex(facts["warnings"][0], "q0 is taken for the scalar")

    def test_euler_angles_in_both_conventions_and_units(self):
        angles = [np.degrees(Truth.roll), np.degrees(Truth.pitch), np.degrees(Truth.yaw)]
        self.write_table("rpy.csv", self.head + ["roll (deg)", "pitch (deg)", "yaw (deg)"], self.motion + angles)
        self.assert_true_path(self.imported("rpy.csv")[0])
        self.assert_true_path(self.imported("rpy.csv", "--euler", "ZYX")[0])
        self.write_table("zyx.csv", self.head + ["a", "b", "c"], self.motion + [Truth.yaw, Truth.pitch, Truth.roll])
        columns = "time=1,x=2,y=3,z=4,e1=a,e2=b,e3=c"
        self.refused("zyx.csv", "--columns", columns, says="--euler")
        self.refused("zyx.csv", "--columns", columns, "--euler", "ZYX", says="degrees or radians.*--angle-unit")
        self.assert_true_path(self.imported("zyx.csv", "--columns", columns, "--euler", "ZYX", "--angle-unit", "rad")[0])

    def test_rotation_matrices_and_what_is_none(self):
        m = matrices(Truth.orientation).reshape(-1, 9).T
        names = [f"R{i}{j}" for i in range(3) for j in range(3)]
        self.write_table("matrix.csv", self.head + names, self.motion + list(m))
        self.assert_true_path(self.imported("matrix.csv")[0])
        m[0] *= -1
        self.write_table("mirror.csv", self.head + names, self.motion + list(m))
        self.refused("mirror.csv", says="line 2, rotation matrix")
        self.write_table("long.csv", self.head + ["qx", "qy", "qz", "qw"], self.motion + list(2 * Truth.orientation.T))
        self.refused("long.csv", says="line 2, quaternion: has length 2")

    def test_device_logs_of_hapi(self):
        half = np.arccos(np.clip(Truth.orientation[:, 3], -1, 1))
        axis = Truth.orientation[:, :3] / np.maximum(np.sin(half), 1e-12)[:, None]
        rows = ["TIME POSITION ORIENTATION FORCE BUTTONS"]
        for i in range(COUNT):
            numbers = [Truth.time[i], *Truth.position[i] / 1e3, *axis[i], 2 * half[i], *Truth.force[i]]
            rows.append(" ".join(f"{v:.5f}" for v in numbers) + f" {Truth.buttons[i]}")
        self.write("device.log", "\n".join(rows) + "\n")
        data, facts, stderr = self.imported("device.log")
        # Five decimals of a metre.
        self.assert_true_path(data, position=0.0051, angle=np.radians(0.03))
        self.assertEqual(facts["kind"], "device log of H3D or HAPI")
        self.assertAlmostEqual(facts["position_step_mm"], 0.01, 5)
        self.assertRegex(stderr, "--smooth-motion-ms")


    def binary_log(self):
        """A log as HAPI writes it, and its rows' size."""
        half = np.arccos(np.clip(Truth.orientation[:, 3], -1, 1))
        axis = Truth.orientation[:, :3] / np.maximum(np.sin(half), 1e-12)[:, None]
        rows = np.zeros(COUNT, np.dtype([("time", "<f8"), ("position", "<f8", 3), ("orientation", "<f8", 4), ("force", "<f8", 3),
                                         ("buttons", "<i4")]))
        rows["time"], rows["position"], rows["force"] = Truth.time, Truth.position / 1e3, Truth.force
        rows["orientation"], rows["buttons"] = np.column_stack([axis, 2 * half]), Truth.buttons
        words = b"TIME POSITION ORIENTATION FORCE BUTTONS".split()
        return b"".join(word + b"\0" for word in words) + b"\0" + rows.tobytes(), rows.itemsize

    def test_binary_device_logs_of_hapi_are_exact(self):
        whole, size = self.binary_log()
        Path(self.path("device.dat")).write_bytes(whole)
        data, facts, _ = self.imported("device.dat")
        self.assert_true_path(data)
        self.assertEqual(facts["kind"], "device log of H3D or HAPI, binary")
        Path(self.path("cut.dat")).write_bytes(whole[:-5])
        data, _, stderr = self.imported("cut.dat")
        self.assertEqual(len(data["time"]), COUNT - 1)
        self.assertIn(f"the last row is not whole ({size - 5} of {size} bytes)", stderr)

    def test_damaged_binary_device_logs_are_refused(self):
        whole, _ = self.binary_log()
        for name, content, says in (("short.dat", whole[:60], "fewer than two samples"), ("head.dat", whole[:20], "header"),
                                    ("word.dat", whole.replace(b"FORCE", b"FORGE", 1), "header"),
                                    ("moved.dat", whole.replace(b"BUTTONS\0", b"", 1), "TIME")):
            Path(self.path(name)).write_bytes(content)
            self.refused(name, says=says)


class Frames(ImportTest):
    def test_a_marker_a_tip_offset_and_a_frame_are_taken_off(self):
        to_world = multiply(about("z", 0.7), about("x", -0.4))[0]
        shift = np.array([10.5, -3, 22])
        to_bur = multiply(about("y", 1.1), about("z", 0.2))[0]
        tip = np.array([4.0, -60, 12])
        # marker = world^-1 . truth . (marker to bur)^-1
        q = multiply(multiply(conjugate(to_world)[None], Truth.orientation), conjugate(to_bur)[None])
        p = turned(np.broadcast_to(conjugate(to_world), q.shape), Truth.position - shift) - turned(q, tip)
        force = turned(np.broadcast_to(conjugate(to_world), q.shape), Truth.force)
        self.write_table("marker.csv", ["time_s", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw", "fx_N", "fy_N", "fz_N"],
                         [Truth.time, *p.T, *q.T, *force.T])
        self.write("world.toml", f"translation_mm = {list(shift)}\nrotation_xyzw = {list(map(float, to_world))}\n")
        rows = np.eye(4)
        rows[:3, :3], rows[:3, 3] = matrices(to_bur[None])[0], tip
        self.write("bur.toml", f"matrix = {rows.tolist()}\n")
        data, _, _ = self.imported("marker.csv", "--transform", "world.toml", "--marker-to-bur", "bur.toml")
        self.assert_true_path(data)
        np.testing.assert_allclose(data["force/measured"], Truth.force, atol=1e-6)
        self.write("turn.toml", f"rotation_xyzw = {list(map(float, to_bur))}\n")
        data, _, _ = self.imported("marker.csv", "--transform", "world.toml", "--marker-to-bur", "turn.toml",
                                   "--tip-offset-mm", ",".join(map(str, tip)))
        self.assert_true_path(data)

    def test_a_transform_that_is_none_is_refused(self):
        self.write_table("p.csv", ["time_s", "x_mm", "y_mm", "z_mm"], [Truth.time, *Truth.position.T])
        for text, says in (("rotation_xyzw = [1, 1, 0, 0]", "length 1"), ("matrix = [[1,0,0,0],[0,1,0,0],[0,0,-1,0]]", "mirrors"),
                           ("matrix = [[2,0,0,0],[0,2,0,0],[0,0,2,0]]", "without a scale"), ("translation = [1,2,3]", "translation_mm"),
                           ("matrix = [[1,0,0],[0,1,0],[0,0,1]]", "rows of 4"), ("translation_mm = [nan, 0, 0]", "finite"),
                           ("matrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]\ntranslation_mm = [1, 2, 3]", "beside")):
            self.write("t.toml", text)
            self.refused("p.csv", "--transform", "t.toml", says=says)


class Simulators(ImportTest):
    def write_fivrs(self, name, root, wrench_root):
        epoch = 1.7e9
        body = multiply(about("z", 0.2 * Truth.time), about("x", np.full(COUNT, 0.3)))
        origin = np.stack([100 + Truth.time, 50 - Truth.time, 20 + 0 * Truth.time], 1)
        drill = multiply(body, Truth.orientation)
        place = origin + turned(body, Truth.position)
        with h5py.File(self.path(name), "w") as file:
            for stream, p, q in (("drill_pose", place, drill), ("anatomy_pose", origin, body)):
                file[f"{root}/high_frequency_poses/{stream}/time_stamp"] = epoch + Truth.time
                file[f"{root}/high_frequency_poses/{stream}/pose"] = np.concatenate([p / 1e3, q], 1)
            every = np.arange(0, COUNT, 2)
            file[f"{wrench_root}/drill_force_feedback/time_stamp"] = epoch + Truth.time[every]
            file[f"{wrench_root}/drill_force_feedback/wrench"] = np.concatenate(
                [turned(body[every], Truth.force[every]), np.zeros((len(every), 3))], 1)

    def test_fivrs_recordings_old_and_new(self):
        for name, root, wrench in (("old.hdf5", "", ""), ("new.hdf5", "/physics_data/continuous_data", "/physics_data/intermittent_data")):
            with self.subTest(name):
                self.write_fivrs(name, root, wrench)
                data, facts, _ = self.imported(name)
                rows = slice(0, COUNT - 1)  # the last pose comes after the last force
                # Epochs in doubles hold 0.24 us.
                np.testing.assert_allclose(data["time"], Truth.time[rows], atol=1e-6)
                self.assertLess(np.abs(data["handle/position"] - Truth.position[rows]).max(), MICROMETRE)
                self.assertLess(angle_between(data["handle/orientation"], Truth.orientation[rows]).max(), HUNDREDTH_DEGREE)
                smooth = np.abs(np.gradient(Truth.cuts[rows, 0].astype(float))) == 0
                self.assertLess(np.abs(data["force/measured"] - Truth.force[rows])[smooth].max(), 0.02)
                self.assertIn("relative to the anatomy", " ".join(facts["notes"]))

    def test_an_hdf5_of_something_else_is_refused(self):
        with h5py.File(self.path("else.h5"), "w") as file:
            file["data/values"] = np.zeros((5, 7))
        self.refused("else.h5", says="neither /time and /handle/position nor")


class Blemishes(ImportTest):
    head = ["time_s", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]

    def test_poses_that_a_slow_tracker_repeats_are_interpolated(self):
        held = (np.arange(COUNT) // 5) * 5
        self.write_table("held.csv", self.head, [Truth.time, *Truth.position[held].T, *Truth.orientation[held].T])
        data, facts, _ = self.imported("held.csv")
        self.assertGreater(facts["held_poses"], COUNT * 0.75)
        inner = slice(0, COUNT - 5)
        self.assertLess(np.abs(data["handle/position"][inner] - Truth.position[inner]).max(), 0.002)
        self.assertLess(angle_between(data["handle/orientation"][inner], Truth.orientation[inner]).max(), np.radians(0.05))
        data, _, stderr = self.imported("held.csv", "--keep-held")
        np.testing.assert_allclose(data["handle/position"], Truth.position[held], atol=1e-9)
        self.assertIn("moves by leaps", stderr)

    def test_a_bur_at_rest_is_not_taken_for_a_held_pose(self):
        still = np.where(np.arange(COUNT) < 700, 0, np.arange(COUNT))
        self.write_table("rest.csv", self.head, [Truth.time, *Truth.position[still].T, *Truth.orientation[still].T])
        data, facts, _ = self.imported("rest.csv")
        self.assertEqual(facts["held_poses"], 0)
        np.testing.assert_allclose(data["handle/position"], Truth.position[still], atol=1e-8)

    def test_spikes_are_named_and_taken_out_on_request(self):
        position = Truth.position.copy()
        position[[200, 640, 641, 1200]] += [[3, 0, 0], [0, 5, 1], [0, 5, 1], [0, 0, -0.5]]
        self.write_table("spikes.csv", self.head, [Truth.time, *position.T, *Truth.orientation.T])
        data, facts, stderr = self.imported("spikes.csv")
        self.assertEqual(facts["spikes"], 4)
        self.assertRegex(stderr, r"4 positions jump away and back, by up to 5\.\d* mm, first at 0\.400 s; --despike")
        np.testing.assert_allclose(data["handle/position"], position, atol=1e-8)
        self.assert_true_path(self.imported("spikes.csv", "--despike")[0], angle=np.radians(0.02))

    def test_empty_fields_repeated_times_and_gaps_are_counted(self):
        rows = [i for i in range(COUNT) if not 300 <= i < 380]
        lines = [",".join(self.head)]
        for i in rows:
            values = [Truth.time[i], *Truth.position[i], *Truth.orientation[i]]
            lines.append(",".join("" if i in (50, 51) and c in (1, 2, 3) else f"{v:.9f}" for c, v in enumerate(values)))
            if i == 100:
                lines.append(lines[-1])
        self.write("holes.csv", "\n".join(lines))
        data, facts, stderr = self.imported("holes.csv")
        self.assertEqual((facts["missing_rows"], facts["repeated_times"], facts["gaps"]), (2, 1, 1))
        self.assertAlmostEqual(facts["largest_gap_s"], 0.162, 6)
        self.assert_true_path(data, rows=[i for i in rows if i not in (50, 51)])
        self.assertIn("--allow-gaps", stderr)

    def test_smoothing_takes_off_what_rounding_put_on(self):
        rounded = np.round(Truth.position, 2)
        self.write_table("rounded.csv", self.head, [Truth.time, *rounded.T, *Truth.orientation.T])
        _, facts, stderr = self.imported("rounded.csv")
        self.assertAlmostEqual(facts["position_step_mm"], 0.01, 6)
        window = float(stderr.split("--smooth-motion-ms ")[1].split()[0])
        data, _, _ = self.imported("rounded.csv", "--smooth-motion-ms", str(window))
        inner = slice(50, -50)
        speed = np.gradient(data["handle/position"], Truth.time, axis=0)
        rough = np.gradient(rounded, Truth.time, axis=0)
        error = np.sqrt(np.mean((speed - Truth.velocity)[inner] ** 2))
        self.assertLess(error, 0.25 * np.sqrt(np.mean((rough - Truth.velocity)[inner] ** 2)))

    def test_a_force_with_its_own_clock_is_laid_beside_the_motion(self):
        rng = np.random.default_rng(5)
        # A hand's tremor: by its slow motion alone a clock is known to tenths of a second.
        frequency = np.fft.rfftfreq(COUNT, 1 / RATE)
        noise = np.fft.rfft(rng.normal(0, 1, (COUNT, 3)), axis=0) * ((frequency > 3) & (frequency < 15))[:, None]
        tremor = np.fft.irfft(noise, COUNT, axis=0)
        position = Truth.position + 0.02 * tremor / tremor.std()
        true_force = -0.4 * np.gradient(position, Truth.time, axis=0) * Truth.cuts
        self.write_table("motion.csv", self.head, [Truth.time, *position.T, *Truth.orientation.T])
        for delay, rotated in ((0.2468, False), (-0.3333, True)):
            with self.subTest(delay):
                t = np.arange(-1, 4, 0.0007)  # of the motion's clock
                force = np.stack([np.interp(t, Truth.time, f, 0, 0) for f in true_force.T], 1) + rng.normal(0, 0.05, (len(t), 3))
                if rotated:  # a sensor in a frame of its own
                    force = turned(np.broadcast_to(about("x", 1.2)[0], (len(t), 4)), force)
                self.write_table("force.csv", ["time_s", "Fx (N)", "Fy (N)", "Fz (N)"], [t + 1 + delay, *force.T])
                data, facts, _ = self.imported("motion.csv", "--force-file", "force.csv")
                error = abs(facts["force_delay_s"] - (1 + delay))
                self.assertLess(facts["force_delay_std_s"], 0.01)
                self.assertLess(error, max(3 * facts["force_delay_std_s"], 0.0005))
                self.assertEqual(len(data["force/measured"]), COUNT)
                data, _, _ = self.imported("motion.csv", "--force-file", "force.csv", "--force-delay-ms", str(1000 * (1 + delay)))
                if not rotated:
                    self.assertLess(np.sqrt(np.mean((data["force/measured"] - true_force) ** 2)), 0.1)

    def test_a_force_that_has_nothing_to_do_with_the_motion_is_refused(self):
        rng = np.random.default_rng(6)
        self.write_table("motion.csv", self.head, [Truth.time, *Truth.position.T, *Truth.orientation.T])
        self.write_table("noise.csv", ["time_s", "fx_N", "fy_N", "fz_N"], [Truth.time, *rng.normal(0, 1, (3, COUNT))])
        self.refused("motion.csv", "--force-file", "noise.csv", says="--force-delay-ms")

    def test_grams_are_asked_for(self):
        grams = Truth.force / 0.00980665
        self.write_table("grams.csv", self.head + ["fx", "fy", "fz"], [Truth.time, *Truth.position.T, *Truth.orientation.T, *grams.T])
        self.refused("grams.csv", says="--force-unit gf")
        data, _, _ = self.imported("grams.csv", "--force-unit", "g", "--force-on", "tooth")
        np.testing.assert_allclose(data["force/measured"], -Truth.force, atol=1e-8)


class BadFiles(ImportTest):
    def test_each_has_one_clear_error(self):
        good = "time_s,x_mm,y_mm,z_mm\n" + "".join(f"{t:.3f},{x:.6f},{y:.6f},{z:.6f}\n" for t, (x, y, z) in zip(Truth.time, Truth.position))
        lines = good.splitlines()
        cases = {
            "empty.csv": ("", "is empty"), "words.csv": ("just some words\nand more of them\n", "not a table"),
            "cut.csv": (good[:-12], r"line 1501: has \d columns where the others have 4"),
            "text.csv": ("\n".join(lines[:40] + ["0.039,oops,1,2"] + lines[40:]), "line 41, column x_mm: is no number"),
            "back.csv": ("\n".join(lines[:40] + [lines[5]] + lines[40:]), "line 41, time: goes back"),
            "twice.csv": ("time_s,x_mm,x_mm,y_mm,z_mm\n0,1,1,1,1\n0.1,1,2,1,1\n", "several columns may be x"),
            "two.csv": ("time_s,left_x,left_y,left_z,right_x,right_y,right_z\n0,1,1,1,1,1,1\n0.1,2,2,2,2,2,2\n", "several columns may be x: 'left_x', 'right_x'"),
            "unit.csv": ("time_s,x_N,y_N,z_N\n0,1,1,1\n0.1,2,2,2\n", "which is no unit of x"),
            "zero.csv": (b"time_s,x_mm\0,y_mm\n0,1,1\n", "zero byte"),
            "one.csv": ("time_s,x_mm,y_mm,z_mm\n0,1,1,1\n", "table|two samples"),
            "nan.csv": ("time_s,x_mm,y_mm,z_mm\n0,nan,1,1\n0.1,nan,1,1\n0.2,nan,2,2\n", "with a pose|no path"),
        }
        for name, (text, says) in cases.items():
            with self.subTest(name):
                self.write(name, text)
                self.refused(name, says=says)
        self.refused("absent.csv", says="absent.csv")
        os.makedirs(self.path("folder.csv"))
        self.refused("folder.csv", says="folder.csv")

    def test_columns_that_are_named_wrongly_are_refused(self):
        self.write_table("p.csv", ["time_s", "x_mm", "y_mm", "z_mm"], [Truth.time, *Truth.position.T])
        for columns, says in (("x=x_mm,y=y_mm", "'z': is missing beside 'x'"), ("x=9,y=2,z=3", "no column"), ("q=1", "no quantity"),
                              ("x", "not KEY=COLUMN"), ("time=1,time=2", "twice"), ("x=x_m,y=y_mm,z=z_mm", "did you mean 'x_mm'")):
            self.refused("p.csv", "--columns", columns, says=says)


if __name__ == "__main__":
    sys.argv = sys.argv[:1]
    unittest.main()
