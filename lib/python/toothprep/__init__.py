"""Grinding force, virtual coupling and removal of layered teeth, from Python.

    import toothprep
    tooth = toothprep.block(enamel_mm=2)
    session = toothprep.Session(tooth, "cylinder:D1.2xL3.0", position=(0, 0.5, 0))
    record = session.step((0, 0.49, 0))
    record.force_device, session.totals["energy_ratio"]

Units: mm, s, N; mN m for torques, W for power. Frames: W, the scan's physical frame (LPS), of every position and
force; B, the bur's (tip at the origin, +z to the shank). Quaternions are x, y, z, w and take B to W.
Errors are toothprep.Error; wrong arguments are TypeError, ValueError or OverflowError.
"""
from ._core import Bur, Record, Session, Tooth, block, burs, load, molar, parameters
from ._core import version as __version__
from ._errors import Error, SizeError
from ._data import data_folder
from ._tools import Fit, Voxelized, calibrate, render, score, set_threads, voxelize
from ._trace import Trace, load_trace, load_trajectory

__all__ = ["Bur", "Error", "Fit", "Record", "Session", "SizeError", "Tooth", "Trace", "Voxelized", "block", "burs",
           "calibrate", "data_folder", "load", "load_trace", "load_trajectory", "molar", "parameters", "render", "score",
           "set_threads", "voxelize"]

for _public in (Bur, Error, Fit, Record, Session, SizeError, Tooth, Trace, Voxelized):
    _public.__module__ = "toothprep"
