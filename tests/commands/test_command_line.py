"""The command line about itself: help, answers to what was mistyped, the manual for man, completion in shells."""
import os
import re
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import BINARY, CommandTest  # noqa: E402

NESTED = ("block", "molar", "scan", "measurement", "cavity")


def commands(help_text):
    """The names under "Subcommands:"."""
    listed = help_text.split("Subcommands:")[1].split("\n\n")[0]
    return re.findall(r"^  (\S+)", listed, re.MULTILINE)


def long_options(help_text):
    return set(re.findall(r"^ +(?:-\w,)?(--[\w-]+)", help_text, re.MULTILINE))


class Help(CommandTest):
    def test_help_of_the_program_and_of_a_command_is_that_of_the_option(self):
        for path in ((), ("replay",), ("specimen",), ("specimen", "cavity")):
            by_command = self.run_ok("help", *path).stdout
            by_option = self.run_ok(*path, "--help").stdout
            self.assertEqual(by_command, by_option.replace(BINARY, "toothprep"), path)

    def test_help_lists_every_command_once(self):
        names = commands(self.run_ok("help").stdout)
        self.assertEqual(len(names), len(set(names)))
        for name in ("specimen", "voxelize", "replay", "live", "help", "completion"):
            self.assertIn(name, names)


class Starts(CommandTest):
    def test_a_run_from_the_loaded_program_is_like_a_start_of_its_own(self):
        """Tests run the program from where its libraries are loaded (support/started_program.py)."""
        self.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "2", "--voxel-mm", "0.5")
        for args in ((), ("--version",), ("repaly",), ("info", "block.vdb", "--json"), ("info", "caf\udce9 '\n\".vdb"),
                     ("replay", "--bur", "list")):
            own = subprocess.run([BINARY, *args], cwd=self.folder, capture_output=True, text=True, timeout=60)
            loaded = self.run_tool(*args)
            self.assertEqual((loaded.returncode, loaded.stdout, loaded.stderr), (own.returncode, own.stdout, own.stderr), args)


class WrongUsage(CommandTest):
    def refused(self, line, says):
        done = self.run_tool(*line.split())
        self.assertEqual((done.returncode, done.stdout), (2, ""), line)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn(says, done.stderr, line)
        return done.stderr

    def test_mistyped_command_is_answered_with_the_nearest(self):
        self.refused("repaly --tooth t.vdb", "no command 'repaly'; did you mean 'replay'? ('toothprep help' lists them)")
        self.refused("specimen moler -o m.vdb",
                     "toothprep specimen: no command 'moler'; did you mean 'molar'? ('toothprep help specimen' lists")
        self.refused("help rig_check", "did you mean 'rig-check'?")
        self.refused("help specimen cavty", "did you mean 'cavity'?")
        self.refused("rig", "did you mean 'rig-check'?")
        self.refused("--quiet --threads 2 voxelise scan.nrrd", "did you mean 'voxelize'?")

    def test_help_of_a_command_that_there_is_not_is_wrong_usage(self):
        self.refused("repaly --help", "did you mean 'replay'?")

    def test_far_from_every_command_nothing_is_guessed(self):
        self.assertNotIn("did you mean", self.refused("qqqqqqqqqqqq", "no command 'qqqqqqqqqqqq'; 'toothprep help'"))

    def test_mistyped_option_is_answered_with_the_nearest_of_the_command_and_of_the_program(self):
        self.refused("replay --tooht t.vdb", "toothprep replay: no option '--tooht'; did you mean '--tooth'? ("
                                             "'toothprep help replay' lists them)")
        self.refused("replay --stall-torque=3", "no option '--stall-torque'; did you mean '--stall-torque-mnm'?")
        self.refused("specimen cavity --otput c.vdb", "did you mean '--output'?")
        self.refused("specimen cavity -o c.vdb --taper 3", "did you mean '--taper-deg'?")
        self.refused("info t.vdb --thread 2", "did you mean '--threads'?")
        self.refused("--quite info t.vdb", "toothprep info: no option '--quite'; did you mean '--quiet'?")
        self.assertNotIn("did you mean", self.refused("info t.vdb --xyzzyxyzzy", "no option '--xyzzyxyzzy'; "))

    def test_a_mistyped_option_is_named_before_what_is_missing(self):
        self.refused("calibrate --toth t.vdb", "did you mean '--tooth'?")

    def test_names_cannot_write_to_the_terminal(self):
        self.assertNotIn("\x1b", self.run_tool("\x1b[31mred").stderr)


class Manual(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("help", "--man-pages", "man")
        cls.pages = sorted(n for n in os.listdir(cls.path("man")) if n.endswith(".1"))

    def rendered(self, page, *options):
        """Without overstriking: plain text."""
        return subprocess.run(["groff", "-man", "-Tutf8", "-P-c", "-P-b", "-P-u", *options, self.path(f"man/{page}")],
                              capture_output=True, text=True, timeout=60)

    def test_there_is_a_page_for_the_program_and_for_each_command(self):
        names = ["toothprep"] + [f"toothprep-{name}" for name in commands(self.run_ok("help").stdout)]
        names += [f"toothprep-specimen-{name}" for name in NESTED]
        self.assertEqual(self.pages, sorted(f"{name}.1" for name in names))

    def test_pages_are_without_warnings(self):
        for page in self.pages:
            done = self.rendered(page, "-ww", "-rLL=100n")
            self.assertEqual((done.returncode, done.stderr), (0, ""), page)

    def test_page_has_every_option_that_help_has(self):
        for page in self.pages:
            path = page[:-2].replace("rig-check", "rig_check").split("-")[1:]
            options = long_options(self.run_ok("help", *(p.replace("_", "-") for p in path)).stdout)
            plain = self.rendered(page).stdout
            self.assertGreater(len(options), 0, page)
            self.assertEqual({o for o in options if not re.search(re.escape(o) + r"\b", plain)}, set(), page)

    def test_page_gives_values_defaults_and_ranges(self):
        plain = self.rendered("toothprep-live.1", "-rLL=200n").stdout
        self.assertIn("--device openhaptics|simulated", plain)
        self.assertIn("[default simulated]", plain)
        self.assertIn("[100 to 10000]", plain)
        self.assertIn("--start-mm FLOAT,FLOAT,FLOAT", plain)

    def test_existing_folder_is_kept_without_force(self):
        self.assertEqual(self.run_tool("help", "--man-pages", "man").returncode, 1)
        self.run_ok("help", "--man-pages", "man", "--force")


class Bash(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.write("toothprep.bash", cls.run_ok("completion", "bash").stdout)
        cls.write("my tooth.vdb", "")
        cls.write("teeth/one.vdb", "")

    def completed(self, *words):
        """What the last of `words` is completed to, as bash asks for it."""
        quoted = " ".join("'" + w + "'" for w in ("toothprep", *words))
        script = (f"source ./toothprep.bash; COMP_WORDS=({quoted}); COMP_CWORD={len(words)}; _toothprep; "
                  "printf '%s\\n' \"${COMPREPLY[@]}\"")
        done = subprocess.run(["bash", "--norc", "-c", script], cwd=self.folder, capture_output=True, text=True, timeout=60)
        self.assertEqual((done.returncode, done.stderr), (0, ""), words)
        return done.stdout.split("\n")[:-1] if done.stdout.strip() else []

    def test_it_is_registered(self):
        done = subprocess.run(["bash", "--norc", "-c", "source ./toothprep.bash; complete -p toothprep"], cwd=self.folder,
                              capture_output=True, text=True, timeout=60)
        self.assertEqual((done.stdout, done.stderr), ("complete -F _toothprep toothprep\n", ""))

    def test_commands(self):
        self.assertEqual(sorted(self.completed("")), sorted(commands(self.run_ok("help").stdout)))
        self.assertEqual(self.completed("rep"), ["replay"])
        self.assertEqual(self.completed("--threads", "2", "rep"), ["replay"])
        self.assertEqual(sorted(self.completed("specimen", "")), sorted(NESTED))
        self.assertEqual(self.completed("help", "voxe"), ["voxelize"])

    def test_options_of_the_command_and_of_the_program(self):
        self.assertEqual(self.completed("replay", "--stall"), ["--stall-torque-mnm"])
        self.assertEqual(self.completed("specimen", "cavity", "--floor-tilt-u"), ["--floor-tilt-u-deg"])
        self.assertEqual(self.completed("replay", "--tooth", "t.vdb", "--thr"), ["--threads"])
        options = long_options(self.run_ok("help", "live").stdout) | {"--threads", "--quiet"}
        self.assertEqual(options - set(self.completed("live", "--")), set())

    def test_values(self):
        self.assertEqual(self.completed("replay", "--drive", ""), ["coupled", "direct", "load"])
        self.assertEqual(self.completed("replay", "--drive", "=", "co"), ["coupled"])
        self.assertEqual(self.completed("replay", "--drive", "="), ["coupled", "direct", "load"])
        self.assertEqual(self.completed("completion", ""), ["bash", "zsh", "fish"])
        self.assertEqual(self.completed("replay", "--time-step-s", ""), [])
        self.assertEqual(self.completed("replay", "--threads", ""), [])

    def test_files(self):
        self.assertEqual(self.completed("replay", "--tooth", "my"), ["my tooth.vdb"])
        self.assertEqual(self.completed("info", "tee"), ["teeth"])
        self.assertEqual(self.completed("info", "teeth/"), ["teeth/one.vdb"])


class OtherShells(CommandTest):
    def run_shell(self, *line):
        done = subprocess.run(line, cwd=self.folder, capture_output=True, text=True, timeout=60)
        self.assertEqual((done.returncode, done.stderr), (0, ""), line)
        return done.stdout

    @unittest.skipUnless(shutil.which("fish"), "there is no fish here")
    def test_fish_completes(self):
        self.write("toothprep.fish", self.run_ok("completion", "fish").stdout)

        def completed(line):
            out = self.run_shell("fish", "--no-config", "-c", f"source toothprep.fish; complete -C '{line}'")
            return {entry.split("\t")[0] for entry in out.splitlines()}

        self.assertEqual(completed("toothprep repl"), {"replay"})
        self.assertEqual(completed("toothprep specimen "), set(NESTED))
        self.assertEqual(completed("toothprep replay --drive "), {"coupled", "direct", "load"})
        self.assertEqual(completed("toothprep specimen cavity --floor-tilt-u"), {"--floor-tilt-u-deg"})
        self.assertIn("toothprep.fish", completed("toothprep replay --tooth tooth"))

    @unittest.skipUnless(shutil.which("zsh"), "there is no zsh here")
    def test_zsh_takes_the_script_and_knows_the_commands(self):
        self.write("_toothprep", self.run_ok("completion", "zsh").stdout)
        self.run_shell("zsh", "-f", "-n", "_toothprep")
        out = self.run_shell("zsh", "-f", "-c", "autoload -U compinit; compinit -D -u; source ./_toothprep; "
                                                "print $_comps[toothprep]; print ${(ok)functions[(I)_toothprep*]}")
        self.assertIn("_toothprep\n", out)
        self.assertIn("_toothprep_specimen_cavity", out)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
