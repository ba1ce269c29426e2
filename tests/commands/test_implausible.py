"""Inputs that are readable and implausible: numbers that are none, units taken for others, names that harm.

Usage: test_implausible.py BINARY SOURCE_DIR
"""
import json
import os
import re
import sys
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import BINARY, CommandTest
from started_program import run_program

SOURCE = os.path.abspath(sys.argv[2])
CYLINDER = "cylinder:D1.2xL3.0"


class Folder(CommandTest):
    @classmethod
    def run_tool(cls, *args):
        return super().run_tool(*args, text=False)

    @classmethod
    def run_ok(cls, *args):
        done = cls.run_tool(*args)
        assert done.returncode == 0, f"{args}: {done.returncode}\n{done.stderr.decode(errors='replace')}"
        return done


def commands(*words):
    """Every command that the help lists, with its subcommands, and its help."""
    text = run_program(BINARY, [*words, "--help"], "/", 60).stdout
    yield list(words), text
    listed = text.partition("\nSubcommands:\n")[2].partition("\n\n")[0]
    for name in re.findall(r"^  ([a-z][a-z-]*)", listed, re.MULTILINE):
        yield from commands(*words, name)


class NumbersOnTheCommandLine(Folder):
    def test_every_numeric_option_refuses_what_is_no_decimal_number(self):
        cases = []
        for words, text in commands():
            # "  --name FLOAT ..." or "  -n,--name INT:INT in [1 - 2] ..."; several values are given as a list.
            for option, kind in re.findall(r"^ +(?:-\w,)?(--[\w-]+)(?:,-\w)? ((?:FLOAT|INT|UINT)\S*)", text, re.MULTILINE):
                count = re.search(re.escape(option) + r" \S+(?: in \[[^]]*\])? x (\d)", text)
                # Each takes a process of its own: `nan` for all, and of the others one in turn.
                for bad in ("nan", ("inf", "-inf", "1e400", "0x10")[len(cases) // 2 % 4]):
                    if bad == "inf" and kind.startswith("FLOAT|inf"):
                        continue
                    value = ",".join(["1"] * (int(count[1]) - 1 if count else 0) + [bad])
                    cases.append([*words, f"{option}={value}"])
        self.assertGreater(len(cases), 2 * 100)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for args, done in zip(cases, pool.map(lambda args: self.run_tool(*args), cases)):
                error = done.stderr.decode()
                self.assertEqual(done.returncode, 2, f"{args}: {error}")
                self.assertIn(args[-1].partition("=")[0], error, args)
                self.assertRegex(error, "not a finite decimal number|not a whole number|not in range", args)
        self.assertEqual(os.listdir(self.folder), [])

    def test_lists_of_numbers_in_a_text_are_held_to_the_same(self):
        for bad in ("nan,0,0", "0x10,0,0", "1e400,0,0", "1,2", "1,2,3,4", "1,2,3x"):
            done = self.run_tool("calibrate", "--tooth", "no.vdb", "--measured", "no.csv", "--bur", CYLINDER,
                                 "-o", "fit.json", "--bias", bad)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn(b"--bias", done.stderr)


class Replays(Folder):
    """A slot 1 mm deep into a block, and what can be wrong with it."""

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        for name, voxel in (("block.vdb", "0.2"), ("fine.vdb", "0.1")):
            cls.run_ok("specimen", "block", "-o", name, "--size-mm", "4,3,4", "--enamel-mm", "1.5", "--voxel-mm", voxel)

    def write_path(self, name, *, seconds=1.0, mm=1.0, rate=1000, damage=None, turn=None):
        """At 1 mm/s from 0.9 mm above the block; a unit of time and of length is so long."""
        rows = []
        for i in range(int(1.4 * rate) + 1):
            t = i / rate
            q = turn(t) if turn else (0, 0, 0, 1)
            rows.append([t / seconds, 0.0, (0.9 - t) / mm, -0.4 / mm, *q])
        if damage:
            damage(rows)
        with open(self.path(name), "w") as f:
            f.write("time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw\n")
            f.writelines(",".join(map(repr, row)) + "\n" for row in rows)

    def replay(self, *extra, path="path.csv", tooth="block.vdb"):
        drive = [] if "--drive" in extra else ["--drive", "direct"]
        return self.run_tool("replay", "--tooth", tooth, "--trajectory", path, "--bur", CYLINDER, *drive,
                             "--stall-torque-mnm", "inf", "-o", "trace.h5", "--prepared", "prepared.vdb", "--force",
                             "--json", *extra)

    def assert_found(self, kind, says, *extra, path="path.csv"):
        """A warning that names the cause, in words and in the JSON; with --strict exit 1 and no outputs."""
        done = self.replay(*extra, path=path)
        error = done.stderr.decode()
        self.assertEqual(done.returncode, 0, error)
        figures = json.loads(done.stdout)
        self.assertFalse(figures["plausible"], error)
        self.assertIn(kind, [f["kind"] for f in figures["findings"]], error)
        warnings = [line for line in error.splitlines() if line.startswith("warning: ")]
        self.assertTrue(any(says in line for line in warnings), error)
        os.remove(self.path("trace.h5"))
        os.remove(self.path("prepared.vdb"))
        before = os.listdir(self.folder)
        strict = self.replay("--strict", *extra, path=path)
        self.assertEqual(strict.returncode, 1, strict.stderr)
        self.assertIn(b"--strict", strict.stderr)
        self.assertEqual(strict.stdout, b"")
        self.assertEqual(os.listdir(self.folder), before)
        return figures

    def write_params(self, text):
        with open(self.path("params.toml"), "w") as f:
            f.write(text)
        return "--params", "params.toml"

    def test_a_sound_replay_is_plausible_and_strict_lets_it_pass(self):
        self.write_path("path.csv")
        for engine in ("levelset", "voxel"):
            done = self.replay("--strict", "--engine", engine, tooth="fine.vdb")
            self.assertEqual(done.returncode, 0, done.stderr)
            figures = json.loads(done.stdout)
            self.assertEqual(figures["energy_audit"], "within")
            self.assertTrue(figures["plausible"])
            self.assertEqual(figures["findings"], [])
            self.assertNotIn(b"warning", done.stderr)

    def test_milliseconds_taken_for_seconds(self):
        self.write_path("path.csv", seconds=1e-3, rate=50)
        refused = self.replay()
        self.assertEqual(refused.returncode, 1)
        self.assertIn(b"milliseconds", refused.stderr)
        self.assert_found("time_step", "milliseconds", "--allow-gaps", "--time-step-s", "0.02")

    def test_a_spinning_quaternion(self):
        import math
        self.write_path("path.csv", turn=lambda t: (math.sin(800 * t), 0.0, 0.0, math.cos(800 * t)))
        self.assert_found("turning", "quaternion")

    def test_a_sample_far_away(self):
        def damage(rows):
            rows[1200][1] = 1e20
        self.write_path("path.csv", damage=damage)
        figures = self.assert_found("position", "damaged")
        self.assertIn("speed", [f["kind"] for f in figures["findings"]])

    def test_specific_energy_in_joules_per_cubic_metre(self):
        self.write_path("path.csv")
        for drive in ("direct", "coupled"):
            self.assert_found("specific_energy", "J/m^3: it would be 0.3 J/mm^3", "--drive", drive,
                              *self.write_params("[tissue.enamel]\nspecific_energy_j_per_mm3 = 3e8\n"))

    def test_a_force_ratio_of_nearly_nothing(self):
        self.write_path("path.csv")
        for drive in ("direct", "coupled"):
            self.assert_found("force_ratio", "alpha", "--drive", drive,
                              *self.write_params("[tissue.enamel]\nforce_ratio = 1e-9\n"))

    def test_metres_taken_for_millimetres(self):
        self.write_path("path.csv", mm=1e3)
        self.assert_found("extent", "metres read as millimetres")

    def test_a_handle_faster_than_a_hand(self):
        self.write_path("path.csv", seconds=1000, rate=10)  # 1 m/s
        figures = self.assert_found("speed", "another unit", "--time-step-s", "0.0001")
        self.assertGreater(figures["peak_force_n"], 50)

    def test_a_removed_volume_is_never_nothing(self):
        self.write_path("path.csv")
        done = self.replay(*self.write_params("[tissue.enamel]\nspecific_energy_j_per_mm3 = 0\n"))
        self.assertEqual(done.returncode, 0, done.stderr)
        figures = json.loads(done.stdout)
        self.assertGreater(figures["removed_mm3"]["enamel"], 0.5)
        self.assertEqual(figures["energy_audit"], "not judged")
        self.assertIn(b"the specific energy of what was removed is 0", done.stderr)
        self.assertNotIn(b"nothing was removed", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
