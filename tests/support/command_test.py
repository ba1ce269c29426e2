"""What tests of commands share: a folder of their own, in which the program runs as a user runs it.

A test script gets the program as its first argument and puts this folder on its path:

    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
    from command_test import CommandTest
"""
import os
import shutil
import sys
import tempfile
import unittest

from busy_machine import settled
from started_program import run_program

BINARY = os.path.abspath(sys.argv[1])


class CommandTest(unittest.TestCase):
    """One folder for all tests of a class."""
    timeout_s = 300

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix=f"toothprep-{cls.__name__.lower()}-")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def write(cls, name, content):
        """Text or bytes; folders on the way are made."""
        os.makedirs(os.path.dirname(cls.path(name)), exist_ok=True)
        with open(cls.path(name), "wb") as file:
            file.write(content if isinstance(content, bytes) else content.encode())

    @classmethod
    def write_volume(cls, name, values, voxel):
        """An array of unsigned bytes, indexed z, y, x, as .nrrd; voxel in mm, the first one's centre at 0."""
        head = ("NRRD0004\ntype: uint8\ndimension: 3\nsizes: {2} {1} {0}\nspace: left-posterior-superior\n"
                "space directions: ({3},0,0) (0,{3},0) (0,0,{3})\nspace origin: (0,0,0)\nencoding: raw\n\n")
        cls.write(name, head.format(*values.shape, voxel).encode() + values.astype("uint8").tobytes())

    @classmethod
    def read(cls, name):
        with open(cls.path(name), "rb") as file:
            return file.read()

    @classmethod
    def run_tool(cls, *args, **more):
        return settled(lambda: run_program(BINARY, args, cls.folder, cls.timeout_s, **more), args, cls.folder)

    @classmethod
    def run_ok(cls, *args, **more):
        done = cls.run_tool(*args, **more)
        assert done.returncode == 0, f"{args}: {done.returncode}\n{done.stderr}"
        return done
