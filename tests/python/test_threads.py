"""The GIL, several threads, and Ctrl-C."""
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import toothprep
from module_test import CommandTest, main, plunge_and_drag

BUR = "cylinder:D1.2xL3.0"


def run_of(tooth, drive="coupled"):
    clock, position, orientation, buttons = plunge_and_drag(seconds=2.0)
    session = toothprep.Session(tooth, BUR, drive=drive, position=position[0], orientation=orientation[0])
    return session.run(clock, position, orientation, buttons)


class Threads(CommandTest):
    def test_two_sessions_on_one_tooth_run_side_by_side(self):
        tooth = toothprep.block()
        alone = {drive: run_of(tooth, drive) for drive in ("coupled", "direct")}
        together, begun = {}, threading.Barrier(2)

        def work(drive):
            begun.wait()
            together[drive] = run_of(tooth, drive)

        threads = [threading.Thread(target=work, args=(drive,)) for drive in alone]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for drive, trace in alone.items():
            for name in trace:
                np.testing.assert_array_equal(together[drive][name], trace[name])

    def test_python_goes_on_while_a_session_runs(self):
        ticks, stop = [], threading.Event()

        def count():
            while not stop.is_set():
                ticks.append(time.monotonic())
                time.sleep(0.001)

        counter = threading.Thread(target=count)
        tooth = toothprep.block()
        counter.start()
        began = time.monotonic()
        run_of(tooth)
        ended = time.monotonic()
        stop.set()
        counter.join()
        during = sum(began < t < ended for t in ticks)
        self.assertGreater(during, 3)

    def test_one_session_serves_one_thread_at_a_time(self):
        tooth = toothprep.block()
        clock = np.arange(200_000) * 0.001
        position = np.stack([0.5 * np.sin(clock), -0.2 + 0 * clock, 0 * clock], axis=1)
        session = toothprep.Session(tooth, BUR, position=position[0])
        reached, release, raised = threading.Event(), threading.Event(), []

        def progress(stage, done):
            reached.set()
            if release.is_set():
                raise KeyError("enough")

        def work():
            try:
                session.run(clock, position, progress=progress)
            except KeyError as error:
                raised.append(error)

        thread = threading.Thread(target=work)
        thread.start()
        self.assertTrue(reached.wait(60))
        with self.assertRaisesRegex(RuntimeError, "another thread"):
            session.step(position[0])
        release.set()
        thread.join(60)
        self.assertEqual(len(raised), 1)  # what a callback raises ends the run
        self.assertLess(session.totals["steps"], 200_000)
        session.step(position[0])  # and it can be used again

    def interrupt(self, call):
        """Ctrl-C in a program that has begun `call`; the seconds until it has ended."""
        script = ("import numpy as np, sys, toothprep\n"
                  "def progress(stage, done):\n"
                  "    print('begun', flush=True)\n" + call)
        child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                 text=True, cwd=self.folder)
        self.assertEqual(child.stdout.readline(), "begun\n")
        sent = time.monotonic()
        child.send_signal(signal.SIGINT)
        _, errors = child.communicate(timeout=60)
        self.assertIn("KeyboardInterrupt", errors)
        self.assertNotEqual(child.returncode, 0)
        return time.monotonic() - sent

    def test_ctrl_c_ends_a_run(self):
        seconds = self.interrupt(
            "clock = np.arange(2_000_000) * 0.001\n"
            "position = np.stack([0.5 * np.sin(clock), -0.2 + 0 * clock, 0 * clock], axis=1)\n"
            f"session = toothprep.Session(toothprep.block(), '{BUR}', position=position[0])\n"
            "session.run(clock, position, progress=progress)\n")
        self.assertLess(seconds, 20)  # the whole run takes minutes

    def test_ctrl_c_ends_molar_and_render(self):
        self.assertLess(self.interrupt("toothprep.molar(0.03, progress=progress)\n"), 30)  # minutes, if it went on
        self.assertLess(self.interrupt("toothprep.render(toothprep.block(), size=(4000, 3000), samples=8, "
                                       "progress=progress)\n"), 30)

    def test_ctrl_c_ends_voxelize_and_leaves_nothing(self):
        self.run_ok("specimen", "scan", "-o", "scan.nrrd", "--spacing-mm", "0.12")
        self.interrupt("toothprep.voxelize('scan.nrrd', 'tooth.vdb', voxel_mm=0.05, progress=progress)\n")
        import os
        self.assertEqual(sorted(os.listdir(self.folder)), ["scan.nrrd"])


if __name__ == "__main__":
    main()
