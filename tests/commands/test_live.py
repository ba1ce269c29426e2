"""live and its recording, on the simulated device and on the stand-in for the vendor's library: a session that a replay
repeats to the bit, every fault and signal with zero force and a readable file, and a program that is killed.

Usage: test_live.py BINARY STAND_IN_LIBHD LIMITS_TOML
"""
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from busy_machine import ended_well, settled  # noqa: E402
from started_program import run_program  # noqa: E402

BINARY, LIBHD, LIMITS = (os.path.abspath(argument) for argument in sys.argv[1:4])
os.environ["TOOTHPREP_LIBHD"] = LIBHD
BUR = "cylinder:D1.2xL3.0"
HAND = """start_mm = [0, 2, -3.4]
axis = [0, 1, 0]
[[segment]]
kind = "line"
to_mm = [0, -1, -3.4]
speed_mm_s = 8
[[segment]]
kind = "line"
to_mm = [0, -1, 3]
speed_mm_s = 2
"""


class Live(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="toothprep-live-")
        with open(cls.path("hand.toml"), "w") as f:
            f.write(HAND)
        cls.ok("specimen", "block", "-o", "block.vdb", "--size-mm", "4", "--enamel-mm", "2")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def start(cls, *args, settings=""):
        environment = {**os.environ, "TOOTHPREP_STANDIN_SET": settings}
        return subprocess.Popen([BINARY, *args], cwd=cls.folder, env=environment, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)

    @classmethod
    def run_tool(cls, *args, settings=""):
        def run():
            process = cls.start(*args, settings=settings)
            out, error = process.communicate(timeout=60)
            return subprocess.CompletedProcess(args, process.returncode, out, error)
        done = settled(run if settings else lambda: run_program(BINARY, args, cls.folder, 60), args, cls.folder)
        return done.returncode, done.stdout, done.stderr

    @classmethod
    def ok(cls, *args, settings=""):
        status, out, error = cls.run_tool(*args, settings=settings)
        assert status == 0, f"{args}: {status}\n{error}"
        return out

    def session(self, name, *args, settings=""):
        return self.run_tool("live", "--tooth", "block.vdb", "--bur", BUR, "-o", name, *args, settings=settings)

    def rows(self, name):
        return json.loads(self.ok("info", name, "--json"))["rows"]

    def begin(self, name, *args, rows=250):
        """A session of which that many rows stand in its file, however busy the machine is."""
        if os.path.exists(self.path(name)):
            os.remove(self.path(name))
        process = self.start("live", "--tooth", "block.vdb", "--bur", BUR, "-o", name, *args)
        for _ in range(3000):
            try:
                with h5py.File(self.path(name), "r", swmr=True) as recording:
                    if len(recording["/time"]) >= rows:
                        return process
            except OSError:  # not there yet
                self.assertIsNone(process.poll())
            time.sleep(0.01)
        process.kill()
        self.fail(f"{name}: {process.communicate()}")

    def assert_replay_is_the_same(self, name):
        self.ok("replay", "--tooth", "block.vdb", "--bur", BUR, "--trajectory", name, "-o", "again.h5", "--force")
        self.ok("export", name, "-o", "a.csv", "--force")
        self.ok("export", "again.h5", "-o", "b.csv", "--force")
        with open(self.path("a.csv")) as a, open(self.path("b.csv")) as b:
            self.assertEqual(a.read(), b.read())

    def test_a_session_is_recorded_and_replayed_to_the_bit(self):
        status, out, error = self.session("s.h5", "--hand", "hand.toml", "--duration-s", "3", "--json", "--prepared",
                                          "p.vdb", "--display-hz", "30")
        self.assertEqual(status, 0, error)
        figures = json.loads(out)
        self.assertEqual(figures["end_reason"], "duration")
        self.assertGreater(figures["ticks"], 1000)  # a busy machine loses some
        self.assertGreater(json.loads(self.ok("info", "s.h5", "--json"))["removed_mm3"]["enamel"], 0.1)
        self.assert_replay_is_the_same("s.h5")
        self.assertTrue(os.path.exists(self.path("p.vdb")))
        # An existing recording is not replaced by itself.
        status, _, error = self.session("s.h5", "--duration-s", "1")
        self.assertEqual(status, 1)
        self.assertIn("--force", error)

    def test_the_stand_in_of_the_vendors_library_is_driven_the_same_way(self):
        status, _, error = self.session("hd.h5", "--device", "openhaptics", "--duration-s", "1")
        self.assertEqual(status, 0, error)
        self.assertGreater(self.rows("hd.h5"), 300)
        self.assert_replay_is_the_same("hd.h5")

    def test_every_fault_ends_in_one_line_exit_1_and_a_readable_recording(self):
        for what in ("comm-error", "device-fault", "timer-error", "unplugged"):
            name = what + ".h5"
            status, _, error = self.session(name, "--device", "openhaptics", "--duration-s", "5", "--quiet",
                                            settings=f'[[fault]]\nwhat = "{what}"\nat_tick = 400\n')
            self.assertEqual(status, 1, f"{what}: {error}")
            last = error.strip().splitlines()[-1]
            self.assertTrue(last.startswith("toothprep: ") and name in last, error)
            self.assertGreater(self.rows(name), 100, what)

    def test_a_device_that_is_absent_or_not_calibrated_is_an_error_without_a_recording(self):
        for settings, words in (("present = false", "device"), ('calibration = "needs-manual-input"', "not calibrated")):
            status, _, error = self.session("none.h5", "--device", "openhaptics", "--duration-s", "1", settings=settings)
            self.assertEqual(status, 1, error)
            self.assertIn(words, error)
            self.assertFalse(os.path.exists(self.path("none.h5")))

    def test_warm_motors_only_withhold_the_force(self):
        status, _, error = self.session("warm.h5", "--device", "openhaptics", "--duration-s", "1", settings=
                                        '[[fault]]\nwhat = "warm-motors"\nat_tick = 200\nticks = 50\n')
        self.assertEqual(status, 0, error)

    def faulty(self, name, settings, *args, duration="2"):
        status, out, error = self.session(name, "--device", "openhaptics", "--duration-s", duration, "--json", "--quiet",
                                          *args, settings=settings)
        return status, json.loads(out) if out else {}, error

    def removed(self, name):
        return json.loads(self.ok("info", name, "--json"))["removed_mm3"]["enamel"]

    def test_a_reading_far_away_makes_no_step_and_the_session_goes_on(self):
        status, figures, error = self.faulty("jump.h5", '[[fault]]\nwhat = "pose-jump"\nat_tick = 1000\n')
        self.assertEqual(status, 0, error)
        self.assertEqual(figures["rejected_readings"], 1)
        self.assertIn("jumped as no hand does", error)
        self.assert_replay_is_the_same("jump.h5")

    def test_readings_that_stay_wrong_end_it_as_a_named_fault(self):
        for what, words in (("pose-jump", "jumped"), ("nan", "not finite")):
            name = f"stays-{what}.h5"
            status, figures, error = self.faulty(name, f'[[fault]]\nwhat = "{what}"\nat_tick = 700\nticks = 9000\n',
                                                 duration="5")
            self.assertEqual(status, 1, error)
            self.assertIn(words, error.splitlines()[-1])
            self.assertLess(figures["ticks"], 1500)
            self.assert_replay_is_the_same(name)

    def test_a_calibration_that_is_lost_ends_it(self):
        status, _, error = self.faulty("lost.h5", '[[fault]]\nwhat = "lost-calibration"\nat_tick = 500\nticks = 100000\n',
                                       duration="5")
        self.assertEqual(status, 1, error)
        self.assertIn("not calibrated", error)

    def test_a_driver_that_never_stops_is_given_up_and_the_recording_is_whole(self):
        for what, settings in (("stop", '[[fault]]\nwhat = "hanging-stop"\n'),
                               ("tick", '[[fault]]\nwhat = "hanging-tick"\nat_tick = 700\nticks = 3600000\n')):
            began = time.monotonic()
            status, _, error = self.faulty(f"hangs-{what}.h5", settings, duration="1.5")
            self.assertEqual(status, 1, error)
            self.assertLess(time.monotonic() - began, 15)
            self.assertIn("hangs" if what == "tick" else "does not come back", error)
            self.assertGreater(self.rows(f"hangs-{what}.h5"), 300)

    def test_what_ends_a_program_ends_it_in_order_and_a_crash_leaves_a_readable_file(self):
        for number, status in ((signal.SIGQUIT, 0), (signal.SIGUSR1, 0), (signal.SIGALRM, 0),
                               (signal.SIGABRT, -signal.SIGABRT), (signal.SIGSEGV, -signal.SIGSEGV)):
            process = self.begin("ends.h5")
            process.send_signal(number)
            _, error = process.communicate(timeout=20)
            self.assertTrue(process.returncode == status or status == 0 and ended_well(process.returncode, error),
                            f"{number}: {error}")
            self.assertGreater(self.rows("ends.h5"), 100, number)

    def test_a_reader_of_the_output_that_leaves_takes_nothing_with_it(self):
        process = self.start("live", "--tooth", "block.vdb", "--bur", BUR, "-o", "pipe.h5", "--prepared", "pipe.vdb",
                             "--duration-s", "1.5")
        time.sleep(0.5)
        process.stderr.close()
        process.stdout.close()
        process.wait(timeout=20)
        self.assertTrue(os.path.exists(self.path("pipe.vdb")))
        self.assertGreater(self.rows("pipe.h5"), 500)

    def test_output_that_is_not_read_or_closed_holds_nothing_up(self):
        command = [BINARY, "live", "--tooth", "block.vdb", "--bur", BUR, "--duration-s", "1", "-o"]
        subprocess.run(["sh", "-c", '"$@" 2>&-', "sh", *command, "closed.h5"], cwd=self.folder, timeout=30, check=True)
        self.assertGreater(self.rows("closed.h5"), 300)  # and no text of stderr's in it

    def test_ctrl_z_pauses_without_a_force_and_goes_on(self):
        process = self.begin("pause.h5", "--duration-s", "4")
        process.send_signal(signal.SIGTSTP)
        time.sleep(1)
        with open(f"/proc/{process.pid}/stat") as stat:
            self.assertEqual(stat.read().rsplit(")", 1)[1].split()[0], "T")
        process.send_signal(signal.SIGCONT)
        _, error = process.communicate(timeout=20)
        self.assertIn("paused", error)
        self.assertIn("goes on after", error)

    def test_what_means_nothing_together_is_refused(self):
        for args, words in ((("--pedal", "1", "--clutch", "1"), "same button"),
                            (("--device", "openhaptics", "--hand", "hand.toml"), "simulated"),
                            (("--mirror", "left"), "--mirror-hand"),
                            (("--start-mm", "0,-2,0"), "into the tooth")):
            status, _, error = self.session("refused.h5", "--duration-s", "1", *args)
            self.assertEqual(status, 1, error)
            self.assertIn(words, error)

    def test_implausible_numbers_are_refused_or_warned_of(self):
        for args in (("--duration-s", "nan"), ("--duration-s", "0"), ("--ramp-s", "0"), ("--ramp-s", "nan"),
                     ("--stale-s", "0.001"), ("--heat-time-s", "-1"), ("--vibration-time-s", "nan"), ("--frozen-s", "0"),
                     ("--speed-limit-mm-per-s", "1"), ("--driver-wait-s", "0"), ("--driver-wait-s", "inf")):
            status, _, error = self.session("refused.h5", *args)
            self.assertEqual(status, 2, f"{args}: {error}")
            self.assertIn(args[0], error)
        for translation, expected, words in (("[0.003, 0, 0]", 0, "is it in metres?"), ("[1e300, 0, 0]", 1, "within metres"),
                                             ("[20000, 0, 0]", 1, "within metres")):
            with open(self.path("r.toml"), "w") as f:
                f.write(f"translation_mm = {translation}\nfixed_axis = [0, 1, 0]\n")
            status, _, error = self.session("far.h5", "--registration", "r.toml", "--hand", "hand.toml", "--duration-s", "0.5",
                                            "--force")
            self.assertEqual(status, expected, error)
            self.assertIn(words, error)
        self.assertFalse(os.path.exists(self.path("refused.h5")))

    def test_elements_too_small_for_the_tick_are_warned_of_with_a_size_that_would_do(self):
        words = "engine.element_mm: with 0.005 mm the steps may take longer than the 1 ms that they have; use at least "
        with open(self.path("small.toml"), "w") as f:
            f.write("[engine]\nelement_mm = 0.005\n")
        arguments = ("--params", "small.toml", "--hand", "hand.toml", "--duration-s", "0.2", "--force")
        status, _, error = self.session("small.h5", *arguments)
        self.assertEqual(status, 0, error)
        self.assertIn(words, error)
        size = error.split(words)[1].split(" mm")[0]
        self.assertGreater(float(size), 0.005)
        with open(self.path("small.toml"), "w") as f:
            f.write(f"[engine]\nelement_mm = {size}\n")
        status, _, error = self.session("small.h5", *arguments)
        self.assertEqual(status, 0, error)
        self.assertNotIn("engine.element_mm", error)

    def test_limits_and_the_hand_at_the_start_are_recorded(self):
        status, _, error = self.session("limits.h5", "--device", "openhaptics", "--duration-s", "1", "--ramp-s", "0.5",
                                        "--stale-s", "0.2", "--vibration-limit-n", "2", "--vibration-time-s", "0.08",
                                        "--heat-time-s", "20", "--speed-limit-mm-per-s", "1500", "--frozen-s", "inf",
                                        "--ignore-safety-switch")
        self.assertEqual(status, 0, error)
        with h5py.File(self.path("limits.h5")) as f:
            expected = {"force_ramp_s": 0.5, "force_fade_s": 0.05, "stale_limit_s": 0.2, "frozen_limit_s": float("inf"),
                        "vibration_limit_n": 2, "vibration_time_s": 0.08, "heat_time_s": 20,
                        "speed_limit_mm_per_s": 1500, "safety_switch": "ignored"}
            self.assertEqual({name: f.attrs[name] for name in expected}, expected)
            hand = f["/device/position"][0]
            self.assertEqual(list(f.attrs["registration_hand_position_mm"]), list(hand))
            self.assertEqual(list(f.attrs["registration_hand_orientation"]), list(f["/device/orientation"][0]))
            laid = f.attrs["registration_position_mm"] + hand - f["/handle/position"][0]
            self.assertLess(abs(laid).max(), 1e-12)

    def test_a_driver_that_hangs_while_it_opens_is_given_up_and_ctrl_c_is_heard(self):
        hangs = '[[fault]]\nwhat = "hanging-open"\n'
        status, _, error = self.session("hangs.h5", "--device", "openhaptics", "--driver-wait-s", "0.5", settings=hangs)
        self.assertEqual(status, 1, error)
        self.assertIn("the driver hangs: for 0.5 s it has not come back while it opens the device", error)
        process = self.start("live", "--tooth", "block.vdb", "--bur", BUR, "-o", "hangs.h5", "--device", "openhaptics",
                             settings=hangs)
        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=5)
        self.assertEqual(process.returncode, 1, error)
        self.assertIn("asked to stop while the driver opens the device", error)
        self.assertFalse(os.path.exists(self.path("hangs.h5")))

    def test_a_check_of_the_device_is_as_safe_as_a_session(self):
        status, _, error = self.run_tool("live", "--device", "openhaptics", "--protocol",
                                         "stiffness-sweep 0.2..0.4 N/mm in 2 steps of 0.5 s", "-o", "sweep.h5", settings=
                                         '[[fault]]\nwhat = "pose-jump"\nat_tick = 1300\noffset_mm = [0, 15, 0]\n'
                                         '[[fault]]\nwhat = "let-go"\nat_tick = 1700\nticks = 50\n')
        self.assertEqual(status, 0, error)
        self.assertIn("jumped as no hand does", error)
        self.assertIn("nobody holds the stylus", error)
        with h5py.File(self.path("sweep.h5")) as f:
            rejected, flags = f["/reading_rejected"][:] != 0, f["/servo/flags"][:]
            force = abs(f["/servo/force_commanded"][:]).max(axis=1)
        self.assertEqual(rejected.sum(), 1)
        self.assertEqual(force[rejected | (flags & 1024 != 0)].max(), 0)
        self.assertGreater(force.max(), 0.05)

    def test_many_signals_in_quick_succession_end_it_in_order(self):
        for gap in (0, 0.005, 0.03, 0.06, 0.09):
            process = self.begin("signals.h5", "--force", "--prepared", "signals.vdb")
            for number in (signal.SIGINT, signal.SIGINT, signal.SIGTERM):
                process.send_signal(number)
                time.sleep(gap)
            _, error = process.communicate(timeout=20)
            self.assertTrue(ended_well(process.returncode, error), error)
            self.assertIn("asked to stop", error)

    def test_ctrl_c_and_termination_end_it_in_order(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            process = self.begin("signal.h5")
            process.send_signal(number)
            _, error = process.communicate(timeout=20)
            self.assertTrue(ended_well(process.returncode, error), error)
            self.assertIn("asked to stop", error)
            self.assertGreater(self.rows("signal.h5"), 100)

    def test_what_was_recorded_survives_a_kill(self):
        process = self.begin("killed.h5", rows=1000)
        process.kill()
        process.communicate()
        self.assertGreaterEqual(self.rows("killed.h5"), 1000)

    def test_protocols_are_recorded(self):
        for protocol in ("rest 1 s", "step 0.3 N for 1 s"):
            status, _, error = self.run_tool("live", "--protocol", protocol, "-o", "protocol.h5", "--force")
            self.assertEqual(status, 0, error)
            self.assertGreater(self.rows("protocol.h5"), 500)
        status, _, error = self.run_tool("live", "--protocol", "jump", "-o", "no.h5")
        self.assertEqual(status, 1)
        self.assertFalse(os.path.exists(self.path("no.h5")))

    def test_a_rig_is_judged_from_its_recording(self):
        status, _, error = self.session("rig.h5", "--hand", "hand.toml", "--duration-s", "2")
        self.assertEqual(status, 0, error)
        report = json.loads(self.ok("rig-check", "rig.h5", "--tooth", "block.vdb", "--json", "-o", "rig.json"))
        self.assertEqual(report["schema"], "toothprep-rig-check")
        with open(self.path("rig.json")) as f:
            self.assertEqual(json.load(f), report)
        # The recording replays to the bit, so no row differs; a limit that can't be kept fails it, with --strict only.
        self.assertEqual(report["replay_differing_rows"], 0)
        with open(LIMITS) as f:
            limits = f.read()
        with open(self.path("limits.toml"), "w") as f:
            f.write(limits.replace("step_cost_p999_us = { max = 200.0", "step_cost_p999_us = { max = 0.001"))
        for strict, expected in (((), 0), (("--strict",), 1)):
            status, _, error = self.run_tool("rig-check", "rig.h5", "--limits", "limits.toml", *strict)
            self.assertEqual(status, expected, error)
        # Another tooth, and what is no recording.
        self.ok("specimen", "block", "-o", "other.vdb", "--size-mm", "3", "--enamel-mm", "1")
        self.assertEqual(self.run_tool("rig-check", "rig.h5", "--tooth", "other.vdb")[0], 1)
        self.assertEqual(self.run_tool("rig-check", "block.vdb")[0], 1)

    def test_wrong_rates_and_registrations_are_refused(self):
        status, _, error = self.session("no.h5", "--time-step-s", "0.002", "--duration-s", "1")
        self.assertEqual(status, 1)
        self.assertIn("--rate-hz", error)
        with open(self.path("r.toml"), "w") as f:
            f.write("translation_mm = [0, 0, 0]\n")
        status, _, error = self.session("no.h5", "--registration", "r.toml", "--start-mm", "0,0,0")
        self.assertEqual(status, 1)
        status, _, _ = self.run_tool("live", "-o", "no.h5")
        self.assertEqual(status, 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
