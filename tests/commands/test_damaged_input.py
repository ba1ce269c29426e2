"""voxelize on damaged inputs of every kind: exit 1, one line that names the file, nothing left behind.

Usage: test_damaged_input.py BINARY
"""
import os
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


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
