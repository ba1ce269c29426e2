"""Runs `toothprep render` as a user does: kinds of pictures, refusals, the same bytes whatever the threads.

Usage: test_render_command.py BINARY
"""
import os
import struct
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest

SMALL = ("--size", "120x90", "--samples", "2")


class Render(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        for args in (("specimen", "molar", "--voxel-mm", "0.3", "-o", "molar.vdb"),
                     ("mesh", "molar.vdb", "-o", "molar.ply"), ("mesh", "molar.vdb", "-o", "molar.stl")):
            cls.run_ok(*args)

    def draw(self, source, output, *args):
        done = self.run_tool("render", source, "-o", output, *SMALL, *args)
        self.assertEqual(done.returncode, 0, done.stderr)
        path = os.path.join(self.folder, output)
        if os.path.isdir(path):
            return sorted(name for name in os.listdir(path) if name != ".toothprep-folder")
        with open(path, "rb") as file:
            return file.read()

    def assert_size(self, png, width, height):
        self.assertEqual(png[:8], b"\x89PNG\r\n\x1a\n")
        self.assertEqual(struct.unpack(">II", png[16:24]), (width, height))

    def test_teeth_and_meshes_become_pictures(self):
        self.assert_size(self.draw("molar.vdb", "vdb.png"), 120, 90)
        self.assert_size(self.draw("molar.ply", "ply.png", "--view", "occlusal"), 120, 90)
        self.assert_size(self.draw("molar.stl", "stl.png", "--cut", "buccal"), 120, 90)
        self.assert_size(self.draw("molar.vdb", "pair.png", "--before", "molar.stl"), 120, 90)
        self.assert_size(self.draw("molar.vdb", "deviation.png", "--color", "deviation", "--reference", "molar.stl",
                                   "--ghost", "molar.stl"), 120, 90)
        self.assertEqual(self.draw("molar.vdb", "turn", "--turntable", "2"), ["frame_000.png", "frame_001.png"])

    def test_same_bytes_whatever_the_threads(self):
        for extension in ("png", "exr"):
            one = self.draw("molar.vdb", "one." + extension, "--cut", "mesial", "--threads", "1")
            two = self.draw("molar.vdb", "two." + extension, "--cut", "mesial", "--threads", "3")
            self.assertEqual(one, two)

    def test_numbers_that_are_not_finite_are_wrong_usage(self):
        for option, value in (("--zoom", "nan"), ("--range-mm", "nan"), ("--centre", "1,2,inf"), ("--view", "nan,0,1")):
            done = self.run_tool("render", "molar.vdb", "-o", "x.png", option, value)
            self.assertEqual(done.returncode, 1 if option == "--view" else 2, f"{option} {value}: {done.stderr}")
            self.assertIn(option.strip("-").removesuffix("-mm"), done.stderr)
            self.assertFalse(os.path.exists(os.path.join(self.folder, "x.png")))

    def test_what_is_wrong_is_told_and_leaves_nothing(self):
        before = set(os.listdir(self.folder))
        for args, says in ((("molar.vdb", "-o", "x.jpg"), "x.jpg"),
                           (("molar.vdb", "-o", "x.png", "--size", "10x10"), "16 to 16384"),
                           (("molar.vdb", "-o", "x.png", "--size", "20000x20"), "16 to 16384"),
                           (("molar.vdb", "-o", "x.png", "--size", "1e3"), "WIDTHxHEIGHT"),
                           (("molar.vdb", "-o", "x.png", "--cut", "1,2,3"), "cut"),
                           (("molar.vdb", "-o", "x.png", "--color", "deviation"), "--reference"),
                           (("molar.vdb", "-o", "x.exr", "--before", "molar.stl"), "--before"),
                           (("molar.vdb", "-o", "x.png", "--turntable", "3"), "folder"),
                           (("missing.stl", "-o", "x.png"), "missing.stl"),
                           (("molar.vdb", "-o", "nowhere/x.png"), "nowhere"),
                           (("molar.vdb", "-o", "molar.ply"), "molar.ply")):
            done = self.run_tool("render", *args)
            self.assertEqual(done.returncode, 1, f"{args}: {done.stderr}")
            self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
            self.assertIn(says, done.stderr)
            self.assertEqual(set(os.listdir(self.folder)), before, args)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
