"""What the tests of the Python module share: a folder, the program to compare with, and a cut."""
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import BINARY, CommandTest  # noqa: F401

SOURCE = Path(sys.argv[2])


def plunge_and_drag(step_s=0.001, seconds=2.0):
    """A motion into the block's top face and along it, turning a little: time, position, orientation, buttons."""
    time = np.arange(int(seconds / step_s)) * step_s
    depth = np.minimum(time * 1.0, 0.6)
    position = np.stack([np.maximum(time - 0.8, 0) * 2.0, 0.3 - depth, 0.1 * np.sin(3 * time)], axis=1)
    half = 0.5 * (-np.pi / 2 + 0.2 * np.sin(2 * time))  # about x: B's z to W's y
    orientation = np.stack([np.sin(half), 0 * half, 0 * half, np.cos(half)], axis=1)
    buttons = np.where((time > 1.2) & (time < 1.3), 0, 1)
    return time, position, orientation, buttons


def write_csv(path, time, position, orientation, buttons):
    """The motion as a trajectory file, every number with all its bits."""
    with open(path, "w") as file:
        file.write("time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw,buttons\n")
        for t, p, q, b in zip(time, position, orientation, buttons):
            file.write(",".join([repr(float(v)) for v in (t, *p, *q)] + [str(int(b))]) + "\n")


def main():
    """Runs the tests of the calling script."""
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=0)
