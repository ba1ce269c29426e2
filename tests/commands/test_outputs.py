"""What a command writes, and what it must never touch: every command, every output that it has.

Usage: test_outputs.py BINARY SOURCE_DIR
"""
import itertools
import json
import os
import resource
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from busy_machine import settled  # noqa: E402
from started_program import run_program  # noqa: E402

BINARY = os.path.abspath(sys.argv[1])
SOURCE = os.path.abspath(sys.argv[2])
BUR = ["--bur", "ball:D1.2"]
LINE = ('start_mm = [0, 0.9, 0]\naxis = [0, 1, 0]\nrate_hz = 1000\n[[segment]]\nkind = "line"\n'
        'to_mm = [0, {depth}, 0]\nspeed_mm_s = {speed}\n')
EXPERIMENT = """kind = "plateaus"
drive = "direct"
bur = "ball:D1.2"
trajectory = "feed.toml"
[block]
size_mm = [3.0, 6.0, 3.0]
enamel_mm = 3.0
"""
PAIRS = "path_mm = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\ntooth_mm = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\n"
FEED = """start_mm = [0.0, 0.7, -0.6]
[[segment]]
kind = "line"
to_mm = [0.0, -5.2, -0.6]
speed_mm_s = 1.5
"""


class Command:
    """Its arguments, what it reads (names in the folder), and its outputs: (option, name, is a folder)."""

    def __init__(self, args, inputs, *outputs):
        self.args, self.inputs, self.outputs = args, inputs, outputs

    def line(self, **names):
        """With its outputs, or those given instead by option (without dashes)."""
        line = list(self.args)
        for option, name, _ in self.outputs:
            line += [option, names.get(option.lstrip("-"), name)]
        return line


TEETH = ["--original", "whole.vdb", "--prepared", "cut.vdb"]
MEASURED = ["--tooth", "block.vdb", *BUR]
COMMANDS = {
    "block": Command(["specimen", "block", "--size-mm", "2", "--voxel-mm", "0.2", "--enamel-mm", "1"], [],
                     ("-o", "new.vdb", False)),
    "molar": Command(["specimen", "molar", "--voxel-mm", "0.5"], [], ("-o", "new.vdb", False)),
    "scan nrrd": Command(["specimen", "scan", "--spacing-mm", "0.9"], [],
                         ("-o", "new.nrrd", False), ("--labels", "labels.mha", False)),
    "scan nii": Command(["specimen", "scan", "--spacing-mm", "0.9"], [],
                        ("-o", "new.nii", False), ("--labels", "labels.nii.gz", False)),
    "scan nii.gz": Command(["specimen", "scan", "--spacing-mm", "0.9"], [], ("-o", "new.nii.gz", False)),
    "scan mha": Command(["specimen", "scan", "--spacing-mm", "0.9"], [], ("-o", "new.mha", False)),
    "scan DICOM": Command(["specimen", "scan", "--spacing-mm", "0.9"], [],
                          ("-o", "series", True), ("--labels", "labels.nrrd", False)),
    "measurement h5": Command(["specimen", "measurement", *MEASURED, "--trajectory", "path.toml"],
                              ["block.vdb", "path.toml"], ("-o", "new.h5", False)),
    "measurement csv": Command(["specimen", "measurement", *MEASURED, "--trajectory", "path.toml"],
                               ["block.vdb", "path.toml"], ("-o", "new.csv", False)),
    "cavity": Command(["specimen", "cavity", "--voxel-mm", "0.4"], [],
                      ("-o", "new.vdb", False), ("--original", "original.vdb", False),
                      ("--target", "target.vdb", False), ("--truth", "truth.json", False)),
    "voxelize scan": Command(["voxelize", "scan.nrrd", "--voxel-mm", "0.4"], ["scan.nrrd"],
                             ("-o", "new.vdb", False), ("--report", "report", True)),
    "voxelize DICOM": Command(["voxelize", "dicom", "--voxel-mm", "0.5"], ["dicom"], ("-o", "new.vdb", False)),
    "voxelize labels": Command(["voxelize", "truth.nrrd", "--labels", "enamel=1,dentin=2,pulp=3", "--voxel-mm", "0.5"],
                               ["truth.nrrd"], ("-o", "new.vdb", False)),
    "voxelize mesh": Command(["voxelize", "--mesh", "enamel=block.stl", "--voxel-mm", "0.2"], ["block.stl"],
                             ("-o", "new.vdb", False)),
    "orient": Command(["orient", "block.vdb"], ["block.vdb"], ("-o", "new.vdb", False), ("--picture", "new.png", False)),
    "place": Command(["place", "--tooth", "block.vdb", *BUR, "--trajectory", "path.toml", "--at", "pairs.toml"],
                     ["block.vdb", "path.toml", "pairs.toml"], ("-o", "new.h5", False), ("--picture", "new.png", False)),
    "prepare": Command(["prepare", "--type", "class1", "--tooth", "molar.vdb", "--bur", "57", "--drive", "direct"],
                       ["molar.vdb"], ("-o", "new.toml", False), ("--picture", "new.png", False)),
    "replay": Command(["replay", "--tooth", "block.vdb", *BUR, "--trajectory", "path.toml", "--params", "model.toml"],
                      ["block.vdb", "path.toml", "model.toml"], ("-o", "new.h5", False), ("--prepared", "new.vdb", False),
                      ("--mesh", "new.ply", False)),
    "export": Command(["export", "trace.h5"], ["trace.h5"], ("-o", "new.csv", False)),
    "mesh ply": Command(["mesh", "block.vdb"], ["block.vdb"], ("-o", "new.ply", False)),
    "mesh stl": Command(["mesh", "block.vdb"], ["block.vdb"], ("-o", "new.stl", False)),
    "mesh obj": Command(["mesh", "block.vdb"], ["block.vdb"], ("-o", "new.obj", False)),
    "mesh glb": Command(["mesh", "block.vdb"], ["block.vdb"], ("-o", "new.glb", False)),
    "mesh 3mf": Command(["mesh", "block.vdb"], ["block.vdb"], ("-o", "new.3mf", False)),
    "mesh lines": Command(["mesh", "cut.vdb"], ["cut.vdb"], ("-o", "new.ply", False), ("--lines", "new.obj", False)),
    "mesh fewer": Command(["mesh", "block.vdb", "--max-error-mm", "0.05"], ["block.vdb"], ("-o", "new.ply", False)),
    "render png": Command(["render", "block.vdb", "--size", "160x120", "--samples", "1", "--reference", "block.stl"],
                          ["block.vdb", "block.stl"], ("-o", "new.png", False)),
    "render exr": Command(["render", "block.vdb", "--size", "160x120", "--samples", "1"], ["block.vdb"],
                          ("-o", "new.exr", False)),
    "render turntable": Command(["render", "block.vdb", "--size", "80x60", "--samples", "1", "--turntable", "3"],
                                ["block.vdb"], ("-o", "turntable", True)),
    "figures": Command(["figures", "--experiments", "mine", "--voxel-mm", "0.3", "--no-plots", "--engine", "voxel"],
                       ["mine"], ("-o", "figures", True)),
    "calibrate": Command(["calibrate", *MEASURED, "--measured", "rig.h5", "--bootstrap", "50", "--no-plots"],
                         ["block.vdb", "rig.h5"], ("-o", "new.json", False), ("--report", "report", True),
                         ("--params-out", "new.toml", False)),
    "score": Command(["score", *TEETH, "--type", "class1", "--rubric", "none"], ["whole.vdb", "cut.vdb"],
                     ("-o", "new.json", False), ("--report", "report", True)),
    "rig-check": Command(["rig-check", "session.h5", "--no-plots"], ["session.h5"],
                         ("-o", "new.json", False), ("--report", "report", True)),
    "live": Command(["live", "--tooth", "block.vdb", *BUR, "--duration-s", "0.3", "--no-real-time"], ["block.vdb"],
                    ("-o", "new.h5", False), ("--prepared", "new.vdb", False)),
}


def small_files_only(size):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    return limit


class Outputs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.inputs = tempfile.mkdtemp(prefix="toothprep-inputs-")
        cls.folder = cls.inputs
        os.mkdir(cls.path("mine"))
        os.mkdir(cls.path("mine/small"))
        for name, text in (("path.toml", LINE.format(depth=-0.9, speed=4)), ("slow.toml", LINE.format(depth=-0.9, speed=0.02)),
                           ("model.toml", 'preset = "paper"\n'), ("pairs.toml", PAIRS), ("mine/small/experiment.toml", EXPERIMENT),
                           ("mine/small/feed.toml", FEED)):
            with open(cls.path(name), "w") as f:
                f.write(text)
        for args in (("specimen", "molar", "-o", "molar.vdb", "--voxel-mm", "0.4"),
                     ("specimen", "block", "-o", "block.vdb", "--size-mm", "3", "--voxel-mm", "0.15", "--enamel-mm", "1"),
                     ("specimen", "cavity", "-o", "cut.vdb", "--original", "whole.vdb", "--voxel-mm", "0.3"),
                     ("specimen", "scan", "-o", "scan.nrrd", "--labels", "truth.nrrd", "--spacing-mm", "0.4"),
                     ("specimen", "scan", "-o", "dicom", "--spacing-mm", "0.4"),
                     ("mesh", "block.vdb", "-o", "block.stl"),
                     ("replay", "--tooth", "block.vdb", *BUR, "--trajectory", "path.toml", "-o", "trace.h5"),
                     ("specimen", "measurement", *MEASURED, "--trajectory", "path.toml", "-o", "rig.h5"),
                     ("live", "--tooth", "block.vdb", *BUR, "--duration-s", "1", "--no-real-time", "-o", "session.h5")):
            done = cls.run_tool(*args)
            assert done.returncode == 0, f"{args}: {done.stderr}"

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.inputs)

    def setUp(self):
        """A folder with the inputs of one command."""
        type(self).folder = tempfile.mkdtemp(prefix="toothprep-outputs-")

    def tearDown(self):
        shutil.rmtree(self.folder)

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def run_tool(cls, *args, **more):
        return settled(lambda: run_program(BINARY, ["-q", *args], cls.folder, 120, text=False, stdin=subprocess.DEVNULL, **more),
                       args, cls.folder)

    def each(self, *names):
        """Every command, and a subtest in a folder of its own that holds the command's inputs."""
        for name in names or COMMANDS:
            shutil.rmtree(self.folder)
            os.mkdir(self.folder)
            self.bring(COMMANDS[name].inputs)
            yield COMMANDS[name], self.subTest(command=name)

    def bring(self, names):
        for name in names:
            copy = shutil.copytree if os.path.isdir(os.path.join(self.inputs, name)) else shutil.copy
            copy(os.path.join(self.inputs, name), self.path(name))

    def everything(self):
        """Name -> content of all files, hidden ones too, and None for folders."""
        found = {}
        for folder, folders, files in os.walk(self.folder):
            for name in folders:
                found[os.path.relpath(os.path.join(folder, name), self.folder)] = None
            for name in files:
                path = os.path.join(folder, name)
                if os.path.isfile(path):
                    with open(path, "rb") as f:
                        found[os.path.relpath(path, self.folder)] = f.read()
        return found

    def assert_refused(self, line, *says, **more):
        before = self.everything()
        done = self.run_tool(*line, **more)
        error = done.stderr.decode(errors="replace")
        self.assertEqual(done.returncode, 1, f"{line}: {error}")
        errors = [text for text in error.splitlines() if not text.startswith(("warning: ", "note: "))]
        self.assertEqual(len(errors), 1, f"{line}: {error}")
        self.assertTrue(errors[0].startswith("toothprep: "), error)
        self.assertNotIn(".toothprep-part", error)
        for text in says:
            self.assertIn(text, errors[0], line)
        self.assertEqual(done.stdout, b"", line)
        self.assertEqual(set(self.everything()), set(before), f"{line} left something, or took it away: {error}")
        self.assertEqual(self.everything(), before, line)

    def make(self, command, *more):
        done = self.run_tool(*command.line(), *more)
        self.assertEqual(done.returncode, 0, f"{command.args}: {done.stderr}")
        return done

    # ---- Refused before anything runs

    def test_an_output_is_never_an_input(self):
        links = itertools.cycle((os.link, os.symlink))
        for command, subtest in self.each():
            with subtest:
                for option, name, folder in command.outputs:
                    for source in command.inputs:
                        link = "link" + os.path.splitext(name)[1]
                        if folder or os.path.isdir(self.path(source)):
                            os.symlink(source, self.path(link))
                            self.assert_refused([*command.line(**{option.lstrip("-"): link}), "--force"], link + ": ")
                            self.assert_refused([*command.line(**{option.lstrip("-"): source}), "--force"], source + ": ")
                            os.remove(self.path(link))
                            continue
                        next(links)(self.path(source), self.path(link))
                        self.assert_refused([*command.line(**{option.lstrip("-"): link}), "--force"],
                                            link + ": is read as an input, too")
                        os.remove(self.path(link))

    def test_a_slice_of_the_series_that_is_read_is_not_replaced(self):
        for command, subtest in self.each("voxelize DICOM"):
            with subtest:
                os.rename(self.path("dicom/slice_0001.dcm"), self.path("dicom/slice_0001.vdb"))
                self.assert_refused([*command.line(o="dicom/slice_0001.vdb"), "--force"], "'dicom', which is read")

    def test_devices_other_formats_and_twice_the_same_name_are_refused(self):
        specials = itertools.cycle(("/dev/null", "fifo"))
        for command, subtest in self.each():
            with subtest:
                os.mkfifo(self.path("fifo"))
                for option, name, folder in command.outputs:
                    key = option.lstrip("-")
                    special = next(specials)
                    self.assert_refused([*command.line(**{key: special}), "--force"], special + ": ")
                    self.assert_refused(command.line(**{key: "absent/" + name}), "'absent' does not exist")
                    if not folder:
                        self.assert_refused(command.line(**{key: "thesis.docx"}), "thesis.docx: ")
                    for other, its, other_folder in command.outputs:
                        if other != option and (folder, os.path.splitext(name)[1]) == (other_folder, os.path.splitext(its)[1]):
                            self.assert_refused(command.line(**{key: "./" + its}), "is named for two outputs")
        self.assertTrue(stat.S_ISCHR(os.stat("/dev/null").st_mode))

    def test_a_folder_that_is_not_ours_is_never_replaced(self):
        for command, subtest in self.each():
            with subtest:
                for option, name, folder in command.outputs:
                    if not folder:
                        continue
                    os.mkdir(self.path(name))
                    with open(self.path(name + "/photograph.jpg"), "w") as f:
                        f.write("mine")
                    self.assert_refused(command.line(), "exists already; give --force")
                    self.assert_refused([*command.line(), "--force"],
                                        name + ": holds 'photograph.jpg' and was not written by this program")
                    self.assert_refused([*command.line(**{option.lstrip("-"): "."}), "--force"], ".: holds '")
                    shutil.rmtree(self.path(name))

    # ---- What appears

    def sizes(self, command):
        """Of all files that it wrote."""
        for _, name, folder in command.outputs:
            for place, _, files in os.walk(self.path(name)) if folder else [("", "", [self.path(name)])]:
                yield from (os.path.getsize(os.path.join(place, file)) for file in files)

    def test_all_appear_are_replaced_only_with_force_and_stay_when_the_disk_is_full(self):
        """A full disk: no file beyond so many bytes, none or one less than the command writes."""
        for command, subtest in self.each():
            with subtest:
                grows = "live" in command.args  # its recording, at its place
                if not grows:
                    self.assert_refused(command.line(), preexec_fn=small_files_only(0))
                self.make(command)
                names = set(command.inputs) | {name for _, name, _ in command.outputs}
                self.assertEqual(set(os.listdir(self.folder)), names)
                for _, name, folder in command.outputs:
                    marked = os.path.exists(self.path(os.path.join(name, ".toothprep-folder")))
                    self.assertEqual(marked, folder)
                self.assert_refused(command.line(), "exists already; give --force to replace it")
                if not grows:
                    self.assert_refused([*command.line(), "--force"], preexec_fn=small_files_only(max(self.sizes(command)) - 1))
                self.make(command, "--force")
                self.assertEqual(set(os.listdir(self.folder)), names)
                for _, name, folder in command.outputs:
                    if folder:
                        with open(self.path(name + "/notes.txt"), "w") as f:
                            f.write("mine")
                        self.assert_refused([*command.line(), "--force"], "holds 'notes.txt', which this program did not write")

    def test_a_file_system_that_is_really_full(self):
        """A small tmpfs; as root only."""
        mounted = self.path("disk")
        os.mkdir(mounted)
        self.bring(["block.vdb", "path.toml", "model.toml", "trace.h5", "whole.vdb", "cut.vdb", "scan.nrrd"])
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", mounted], capture_output=True).returncode:
            self.skipTest("needs the right to mount a file system")
        try:
            for name in ("block", "scan nrrd", "scan nii", "scan mha", "scan DICOM", "replay", "export", "mesh ply",
                         "render png", "render exr", "render turntable", "score", "voxelize scan"):
                command = COMMANDS[name]
                line = command.line(**{option.lstrip("-"): "disk/" + its for option, its, _ in command.outputs})
                if name == "block":  # 2 mm of it would fit
                    line[line.index("2")] = "6"
                with self.subTest(command=name):
                    self.assert_refused(line)
        finally:
            subprocess.run(["umount", mounted], check=True)

    def test_what_appears_during_the_run_stays(self):
        self.bring(["block.vdb", "slow.toml"])
        child = subprocess.Popen([BINARY, "replay", "--tooth", "block.vdb", *BUR, "--trajectory", "slow.toml", "-o", "new.h5",
                                  "--prepared", "new.vdb"], cwd=self.folder, stderr=subprocess.PIPE, text=True)
        self.wait_for_parts()
        with open(self.path("new.h5"), "w") as f:
            f.write("mine")
        _, said = child.communicate(timeout=120)
        self.assertEqual(child.returncode, 1, said)
        self.assertIn("new.h5: appeared while the command ran, so it is not replaced", said)
        self.assertEqual(set(os.listdir(self.folder)), {"block.vdb", "slow.toml", "new.h5"})
        with open(self.path("new.h5")) as f:
            self.assertEqual(f.read(), "mine")

    # ---- Signals

    def parts(self):
        return [n for n in os.listdir(self.folder) if n.startswith(".toothprep-part-")]

    def wait_for_parts(self, count=1):
        for _ in range(3000):
            if len(self.parts()) >= count:
                return
            time.sleep(0.005)
        self.fail("no part appeared")

    def test_a_signal_leaves_nothing(self):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            for command, subtest in self.each("replay", "figures", "scan DICOM", "voxelize scan", "score", "calibrate"):
                with subtest:
                    child = subprocess.Popen([BINARY, *command.line()], cwd=self.folder, stderr=subprocess.DEVNULL)
                    self.wait_for_parts()
                    time.sleep(0.05)
                    child.send_signal(number)
                    self.assertIn(child.wait(timeout=60), (-number, 0))
                    self.assertEqual([n for n in os.listdir(self.folder) if n.startswith(".toothprep")], [])

    def test_what_a_killed_run_left_is_removed_by_the_next(self):
        for command, subtest in self.each("replay"):
            with subtest:
                self.bring(["slow.toml"])
                line = ["slow.toml" if word == "path.toml" else word for word in command.line()]
                child = subprocess.Popen([BINARY, *line], cwd=self.folder, stderr=subprocess.DEVNULL)
                self.wait_for_parts(len(command.outputs))
                child.kill()
                child.wait()
                self.assertEqual(len(self.parts()), len(command.outputs))
                self.make(command)
                self.assertEqual([n for n in os.listdir(self.folder) if n.startswith(".")], [])

    # ---- After the output

    def test_any_name_survives_json(self):
        self.bring(["block.vdb", "path.toml", "whole.vdb", "cut.vdb", "scan.nrrd", "rig.h5", "session.h5", "block.stl"])

        odd = b"caf\xe9 \x01\"'"

        def named(extension, source=None):
            name = odd + source.encode() + b"." + extension.encode() if source else odd + b"new." + extension.encode()
            if source:
                shutil.copy(self.path(source), os.path.join(self.folder.encode(), name))
            return name

        tooth, path = named("vdb", "block.vdb"), named("toml", "path.toml")
        for line in ((b"replay", b"--tooth", tooth, *BUR, b"--trajectory", path, b"-o", named("h5")),
                     (b"voxelize", named("nrrd", "scan.nrrd"), b"--voxel-mm", b"0.5", b"-o", named("vdb")),
                     (b"voxelize", b"--mesh", b"enamel=" + named("stl", "block.stl"), b"-o", b"mesh.vdb"),
                     (b"calibrate", b"--tooth", tooth, *BUR, b"--measured", named("h5", "rig.h5"), b"--bootstrap", b"50",
                      b"--no-plots", b"-o", named("json"), b"--report", odd),
                     (b"score", b"--original", named("vdb", "whole.vdb"), b"--prepared", b"cut.vdb", b"--type", b"class1",
                      b"-o", named("json")),
                     (b"rig-check", named("h5", "session.h5"), b"-o", named("json")),
                     (b"info", tooth),
                     (b"live", b"--tooth", tooth, *BUR, b"--duration-s", b"0.3", b"--no-real-time", b"-o", named("h5"))):
            with self.subTest(line=line[0]):
                done = self.run_tool(*line, b"--json", *([] if line[0] == b"info" else [b"--force"]))
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertIsInstance(json.loads(done.stdout), dict)

    def test_a_stdout_that_cannot_be_written_is_an_error(self):
        self.bring(["block.vdb", "path.toml"])
        with open("/dev/full", "w") as full:
            done = subprocess.run([BINARY, "replay", "--tooth", "block.vdb", *BUR, "--trajectory", "path.toml", "-o", "new.h5",
                                   "--json", "-q"], cwd=self.folder, stdout=full, stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("stdout cannot be written", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
