"""Damaged inputs of every kind: exit 1, one line that names the file, nothing left behind, soon and in little memory.

Usage: test_damaged_input.py BINARY
"""
import os
import random
import shutil
import struct
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import CommandTest


class DamagedInput(CommandTest):
    timeout_s = 60

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        for name in ("ct", "scan.nrrd", "scan.nii", "scan.nii.gz", "scan.mha"):
            cls.run_ok("specimen", "scan", "-o", name, "--spacing-mm", "0.9")
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "2", "--enamel-mm", "1", "--voxel-mm", "0.2")
        for extension in ("stl", "ply", "obj"):
            cls.run_ok("mesh", "block.vdb", "-o", "block." + extension)
        os.makedirs(cls.path("in"))  # where the damaged ones stand

    def assert_refused(self, name, content=None, *options):
        """`content` under `name` in in/, or what stands there already."""
        file = os.path.join("in", name)
        if content is not None:
            self.write(file, content)
        scan = ["--mesh", "enamel=" + file] if name.rsplit(".")[-1] in ("stl", "ply", "obj", "off") else [file]
        before = sorted((folder, *files) for folder, _, files in os.walk(self.folder))
        done = self.run_tool("voxelize", *scan, "-o", os.path.join("in", "no.vdb"), *options)
        error = done.stderr
        self.assertTrue(error.isascii(), f"{name}: {error}")
        self.assertEqual(done.returncode, 1, f"{name}: {error}")
        self.assertEqual(error.count("\n"), 1, f"{name}: {error}")
        self.assertTrue(error.startswith("toothprep: " + file), f"{name}: {error}")
        self.assertEqual(done.stdout, "", name)
        self.assertEqual(before, sorted((folder, *files) for folder, _, files in os.walk(self.folder)), name)

    def test_files_that_are_cut_off_empty_or_noise(self):
        for source in ("scan.nrrd", "scan.nii", "scan.nii.gz", "scan.mha", "block.stl", "block.ply", "block.obj"):
            whole = self.read(source)
            extension = source.split(".", 1)[1]
            for share in (0, 0.02, 0.3, 0.9):
                self.assert_refused(f"cut-{share}.{extension}", whole[:int(share * len(whole))])
            self.assert_refused("noise." + extension, bytes((37 * k * k) % 256 for k in range(2000)))
            self.assert_refused("text." + extension, b"no scan and no mesh here\n" * 20)
        self.assert_refused("cut.off", b"OFF\n8 12 0\n0 0 0\n4 0 0\n")
        self.assert_refused("scan.tif", self.read("scan.nrrd"))

    def test_folders_of_slices(self):
        slices = sorted(name for name in os.listdir(self.path("ct")) if name.endswith(".dcm"))
        for name, damage in (("cut", lambda b: b[:len(b) // 2]), ("head", lambda b: b[:200]),
                             ("noise", lambda b: b[:140] + bytes(255 - c for c in b[140:])),
                             ("gone", None),
                             ("rows", lambda b: b.replace(b"\x28\0\x10\0\2\0", b"\x28\0\x10\0\2\1"))):
            shutil.copytree(self.path("ct"), self.path("in/" + name))
            file = self.path(os.path.join("in", name, slices[4]))
            if damage is None:
                os.remove(file)
            else:
                with open(file, "rb") as f:
                    whole = f.read()
                self.assertNotEqual(damage(whole), whole, name)
                with open(file, "wb") as f:
                    f.write(damage(whole))
            self.assert_refused(name)
        os.makedirs(self.path("in/empty"))
        self.assert_refused("empty")
        shutil.copy(self.path(os.path.join("ct", slices[4])), self.path("in/one.dcm"))
        self.assert_refused("one.dcm")

    def test_headers_that_lead_nowhere(self):
        nrrd = ("NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 20 20 20\n"
                "space directions: (0.3,0,0) (0,0.3,0) (0,0,0.3)\nencoding: raw\nendian: little\ndata file: {}\n")
        meta = ("ObjectType = Image\nNDims = 3\nBinaryData = True\nElementSpacing = 0.3 0.3 0.3\nDimSize = 20 20 20\n"
                "ElementType = MET_SHORT\nElementDataFile = {}\n")
        for data in ("absent.raw", "..", "/dev/zero", "self"):
            self.assert_refused("self.nhdr", nrrd.format(data.replace("self", "self.nhdr")).encode())
            self.assert_refused("self.mhd", meta.format(data.replace("self", "self.mhd")).encode())

    def test_what_is_no_file(self):
        for extension in ("nrrd", "nii", "nii.gz", "mha", "stl", "ply", "obj", "off"):
            self.assert_refused("absent." + extension)
            os.makedirs(self.path("in/folder." + extension))
            self.assert_refused("folder." + extension)
            os.symlink("/dev/zero", self.path("in/zero." + extension))
            self.assert_refused("zero." + extension)
            os.mkfifo(self.path("in/pipe." + extension))
            self.assert_refused("pipe." + extension)

    def test_meshes_that_bound_nothing(self):
        for option in ((), ("--repair",)):
            self.assert_refused("huge.stl", bytes(80) + struct.pack("<I", 2**32 - 1), *option)
            self.assert_refused("list.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty int x\n"
                                b"property int y\nproperty int z\nelement face 1\n"
                                b"property list uint int vertex_indices\nend_header\n" + bytes(36) + b"\xff" * 4,
                                *option)
            self.assert_refused("open.obj", b"v 0 0 0\nv 4 0 0\nv 0 4 0\nf 1 2 3\n", *option)


class DamagedRecordings(CommandTest):
    """Teeth, traces, tables and parameters."""
    timeout_s = 20

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "2", "--enamel-mm", "1", "--voxel-mm", "0.2")
        with open(cls.path("path.csv"), "w") as f:
            f.write("time_s,x_mm,y_mm,z_mm\n" + "".join(f"{0.001 * i},0,{0.9 - 0.002 * i},0\n" for i in range(400)))
        cls.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "path.csv", "--bur", "ball:D1", "-o", "trace.h5")

    def assert_refused(self, *args):
        done = self.run_tool(*args, text=False)
        self.assertEqual(done.returncode, 1, f"{args}: {done.stderr}")
        errors = [line for line in done.stderr.splitlines() if not line.startswith(b"warning: ")]
        self.assertEqual(len(errors), 1, f"{args}: {done.stderr}")
        return errors[0]

    def test_inputs_that_are_no_regular_files_are_refused_at_once(self):
        os.mkfifo(self.path("pipe"))
        out = ["-o", "out.bin"]
        replay = {"--tooth": "block.vdb", "--trajectory": "path.csv", "--bur": "ball:D1"}
        calibrate = {"--tooth": "block.vdb", "--measured": "trace.h5", "--bur": "ball:D1"}
        score = {"--original": "block.vdb", "--prepared": "block.vdb"}
        cases = []
        for command, options, extra in (("replay", replay, {"--params": ".toml"}),
                                        ("calibrate", calibrate, {"--params": ".toml"}),
                                        ("specimen measurement", replay, {"--params": ".toml"}),
                                        ("score", score, {"--target": ".stl", "--trace": ".h5", "--rubric": ".toml"}),
                                        ("live", {"--tooth": "block.vdb", "--bur": "ball:D1"},
                                         {"--hand": ".csv", "--registration": ".toml", "--params": ".toml"})):
            kinds = {"--tooth": (".vdb",), "--trajectory": (".csv", ".toml", ".h5"), "--bur": (".toml",),
                     "--measured": (".csv", ".h5"), "--original": (".vdb", ".stl"), "--prepared": (".vdb", ".ply")}
            for option in [*options, *extra]:
                for end in kinds[option] if option in options else (extra[option],):
                    cases.append((command, {**options, option: "x" + end}, end))
        lines = [([*command.split(), *(x for pair in options.items() for x in pair), *out], end)
                 for command, options, end in cases]
        lines += [(["info", "x" + end], end) for end in (".vdb", ".h5", ".csv", ".toml", ".stl", ".ply", ".obj")]
        lines += [([command, "x" + end, *out], end) for command, end in
                  (("export", ".h5"), ("mesh", ".vdb"), ("render", ".vdb"), ("rig-check", ".h5"), ("batch", ".toml"))]
        for line, end in lines:
            for kind in ("pipe", "/dev/zero", "."):
                os.symlink(kind, self.path("x" + end))
                name = line[1] if line[0] == "specimen" else line[0]
                output = "out" + {"mesh": ".ply", "render": ".png", "measurement": ".csv", "replay": ".h5",
                                  "live": ".h5", "calibrate": ".json", "score": ".json", "export": ".csv"}.get(name, ".bin")
                command = [output if word == "out.bin" else word for word in line]
                error = self.assert_refused(*command)
                self.assertIn(b"x" + end.encode(), error, f"{command} {kind}")
                os.remove(self.path("x" + end))

    def test_damaged_traces_take_no_time_and_little_memory(self):
        with open(self.path("trace.h5"), "rb") as f:
            whole = f.read()
        generator = random.Random(1)
        refused = 0
        for n in range(60):
            broken = bytearray(whole)
            for _ in range(1 + n % 3):
                # Where the structure is: most of the file is data, whose damage the checksum of gzip finds.
                place = generator.randrange(len(broken)) if n % 2 else generator.randrange(8192)
                broken[place] = generator.choice((0, 255, generator.randrange(256)))
            with open(self.path("broken.h5"), "wb") as f:
                f.write(broken)
            done = self.run_tool("info", "broken.h5")
            self.assertIn(done.returncode, (0, 1), f"{n}: {done.stderr}")
            refused += done.returncode
            self.assertLess(done.cpu_s, 3, f"{n}: {done.stderr}")  # half a second on a quiet machine
            self.assertLess(done.peak_mb, 1500, f"{n}: {done.stderr}")
        self.assertGreater(refused, 10)

    def test_a_long_table_is_read_fast_and_one_that_is_too_long_refused_by_its_size(self):
        row = "{:.3f},0.123456789,0.123456789,0.123456789,0,0,0,1,1,0.5,0.25,0.125\n"
        header = "time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw,buttons,fx_N,fy_N,fz_N\n"
        with open(self.path("long.csv"), "w") as f:
            f.write(header)
            f.writelines(row.format(0.001 * i) for i in range(300_000))
        done = self.run_tool("info", "long.csv", anew=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertLess(done.cpu_s, 6)
        self.assertLess(done.peak_mb, 300)
        with open(self.path("endless.csv"), "w") as f:
            f.write(header + "\n" * 20_000_010)
        done = self.run_tool("info", "endless.csv", anew=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("more than 20000000 samples", done.stderr)
        self.assertLess(done.peak_mb, 100)
        os.remove(self.path("endless.csv"))
        os.remove(self.path("long.csv"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
