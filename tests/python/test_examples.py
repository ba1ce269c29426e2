"""The example scripts as a user runs them."""
import csv
import os
import re
import subprocess
import sys

import numpy as np
import toothprep
from module_test import BINARY, SOURCE, CommandTest, main

from busy_machine import ended_well  # after module_test, which finds it

EXAMPLES = SOURCE / "data" / "examples" / "python"


class Examples(CommandTest):
    def example(self, name, *arguments):
        done = subprocess.run([sys.executable, EXAMPLES / name, *map(str, arguments)], cwd=self.folder,
                              capture_output=True, text=True, timeout=200)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def test_force_against_feed_is_the_closed_form(self):
        rows = self.example("force_against_feed.py").splitlines()[1:]
        self.assertEqual(len(rows), 4)
        for row in rows:
            self.assertAlmostEqual(float(row.split()[-1]), 1, delta=0.02, msg=row)

    def test_calibration_finds_its_truth(self):
        out = self.example("calibrate_tissue.py", self.folder)
        for line in out.splitlines()[1:3]:
            u, u_true, alpha, alpha_true = map(float, re.match(
                r"\w+ +([\d.]+) \+- [\d.]+ \(([\d.]+)\) +([\d.]+) \+- [\d.]+ \(([\d.]+)\)", line).groups())
            self.assertAlmostEqual(u / u_true, 1, delta=0.05, msg=line)
            self.assertAlmostEqual(alpha / alpha_true, 1, delta=0.05, msg=line)
        self.assertIn("enamel", toothprep.parameters(self.path("fit.toml"))["tissue"])

    def test_score_folder_writes_a_row_each(self):
        tooth = toothprep.molar(voxel_mm=0.3)
        tooth.save(self.path("molar.vdb"))
        os.mkdir(self.path("work"))
        for depth in (14.5, 15.5):
            session = toothprep.Session(tooth, "cylinder:D1.2xL3.0", {"handpiece": {"stall_torque_mnm": float("inf")}},
                                        "direct", position=(5.4, 5.5, 20))
            for z in np.linspace(20, depth, 200):
                session.step((5.4, 5.5, z))
            for x in np.linspace(5.4, 6.8, 150):
                session.step((x, 5.5, depth))
            session.finish()
            session.remaining().save(self.path(f"work/{depth}.vdb"))
        self.write("work/empty.stl", "solid nothing\nendsolid nothing\n")
        self.example("score_folder.py", "molar.vdb", "work", "scores.csv")
        with open(self.path("scores.csv"), newline="") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual([row["file"] for row in rows], ["14.5.vdb", "15.5.vdb", "empty.stl"])
        self.assertGreater(float(rows[0]["removed_mm3"]), float(rows[1]["removed_mm3"]))
        self.assertTrue(rows[2]["error"])

    def test_control_loop_meets_resistance_and_stays_stable(self):
        out = self.example("control_loop.py", 3)
        force, removed, ratio = map(float, re.search(
            r"largest force ([\d.]+) N; removed ([\d.]+) mm\^3; energy ratio ([\d.]+)", out).groups())
        self.assertTrue(0.1 < force < 3, out)
        self.assertGreater(removed, 0.05)
        self.assertAlmostEqual(ratio, 1, delta=0.1)  # what the energy audit takes for sound

    def test_follow_session_reads_a_session_to_its_end(self):
        toothprep.block().save(self.path("block.vdb"))
        with open(self.path("live.txt"), "w") as said:
            live = subprocess.Popen([BINARY, "live", "--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--device",
                                     "simulated", "--duration-s", "3", "-o", "session.h5"], cwd=self.folder,
                                    stdout=subprocess.DEVNULL, stderr=said)
        self.addCleanup(lambda: (live.kill(), live.wait()) if live.poll() is None else None)
        lines = self.example("follow_session.py", "session.h5").splitlines()
        status = live.wait(60)
        with open(self.path("live.txt")) as said:
            self.assertTrue(ended_well(status, said.read()), status)
        self.assertGreater(len(lines), 2)  # it grew while it was read
        rows = sum(int(line.split()[0]) for line in lines[:-1])
        self.assertEqual(rows, len(toothprep.load_trace(self.path("session.h5"))["time"]))
        self.assertTrue(lines[-1].startswith(f"closed after {rows} rows"), lines)


if __name__ == "__main__":
    main()
