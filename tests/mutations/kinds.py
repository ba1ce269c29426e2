"""The kinds of files that are damaged, the command that gets each, and what its bytes may mean.

A kind is small enough for a run of about a tenth of a second.
"""
import os
import shutil
from dataclasses import dataclass
from typing import Callable

import statements

# Grey values of `specimen scan` between its tissues, so that nothing depends on the histogram.
THRESHOLDS = (950, 2050)
GREY = {"enamel": (THRESHOLDS[1], 1e9), "dentin": (THRESHOLDS[0], THRESHOLDS[1])}
LABELS = {"enamel": (1, 2), "dentin": (2, 3), "pulp": (3, 4)}
BUR = "cylinder:D1.2xL3.0"
REPLAY = ("replay", "--tooth", "block.vdb", "--drive", "direct", "--stall-torque-mnm", "inf", "-o", "out.h5", "--json")


@dataclass
class Kind:
    name: str
    file: str                 # what is damaged: a file, or one of the files of a folder
    command: tuple            # run where the files are
    outputs: tuple            # what it writes
    says: Callable            # the independent reader (statements.py)
    needs: tuple = ()         # other files
    repeats: bool = True      # the same input gives the same figures
    keeps: bool = False       # a run that fails leaves what it has


def kinds():
    def scan(name, file, reader, option=("--thresholds", "%g,%g" % THRESHOLDS), classes=None):
        command = ("voxelize", file, "-o", "out.vdb", "--voxel-mm", "0.6", *option, "--json")
        return Kind(name, file, command, ("out.vdb",), lambda path: reader(path, classes or GREY))

    labels = ("--labels", "enamel=1,dentin=2,pulp=3")
    result = [scan("NRRD, gzip", "scan.nrrd", statements.nrrd), scan("NRRD, raw", "raw.nrrd", statements.nrrd),
              scan("NIfTI", "scan.nii", statements.nifti), scan("NIfTI, gzip", "scan.nii.gz", statements.nifti),
              scan("MetaImage", "scan.mha", statements.metaimage), scan("DICOM", "ct", statements.dicom),
              scan("labels", "labels.nrrd", statements.nrrd, labels, LABELS)]
    for extension in ("stl", "ply", "obj"):
        result.append(Kind(extension.upper(), f"block.{extension}",
                           ("voxelize", "--mesh", f"enamel=block.{extension}", "-o", "out.vdb", "--voxel-mm", "0.3",
                            "--json"), ("out.vdb",), getattr(statements, extension)))
    replay = lambda name, file, says, *options, needs=(): Kind(
        name, file, (*REPLAY, *options), ("out.h5",), says, ("block.vdb", *needs))
    path, bur = ("--trajectory", "path.csv"), ("--bur", BUR)
    result += [
        Kind("tooth .vdb", "block.vdb", ("info", "block.vdb", "--json"), (), statements.vdb),
        Kind("tooth .vdb of others", "foreign.vdb", ("info", "foreign.vdb", "--json"), (), statements.vdb),
        replay("trajectory .csv", "path.csv", statements.csv, *path, *bur),
        replay("trajectory .toml", "path.toml", statements.toml, "--trajectory", "path.toml", *bur),
        replay("trajectory .h5", "trace.h5", statements.hdf5, "--trajectory", "trace.h5", *bur),
        replay("parameters", "rig.toml", statements.toml, *path, *bur, "--params", "rig.toml", needs=("path.csv",)),
        replay("bur profile", "bur.toml", statements.toml, *path, "--bur", "bur.toml", needs=("path.csv",)),
        Kind("trace, exported", "trace.h5", ("export", "trace.h5", "-o", "out.csv"), ("out.csv",), statements.hdf5),
        Kind("trace, scored", "trace.h5",
             ("score", "--original", "block.vdb", "--prepared", "prepared.vdb", "--trace", "trace.h5", "--type", "class1",
              "-o", "out.json", "--json"), ("out.json",), statements.hdf5, ("block.vdb", "prepared.vdb")),
        Kind("rubric", "class1.toml",
             ("score", "--original", "block.vdb", "--prepared", "prepared.vdb", "--type", "class1", "--rubric",
              "class1.toml", "-o", "out.json", "--json"), ("out.json",), statements.toml, ("block.vdb", "prepared.vdb")),
        Kind("manifest", "batch.toml", ("batch", "batch.toml", "-o", "out"), ("out",), statements.toml,
             ("block.vdb", "path.csv"), keeps=True),
        Kind("recording .csv", "rig.csv",
             ("calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", *bur, "-o", "out.json", "--json"),
             ("out.json",), statements.csv, ("block.vdb",)),
        Kind("recording .h5", "rig.h5",
             ("calibrate", "--tooth", "block.vdb", "--measured", "rig.h5", *bur, "-o", "out.json", "--json"),
             ("out.json",), statements.hdf5, ("block.vdb",)),
        Kind("live session", "session.h5",
             ("rig-check", "session.h5", "--no-plots", "-o", "out.json", "--json"), ("out.json",), statements.hdf5),
        Kind("rig limits", "limits.toml",
             ("rig-check", "session.h5", "--no-plots", "--limits", "limits.toml", "-o", "out.json", "--json"),
             ("out.json",), statements.toml, ("session.h5",)),
        Kind("registration", "registration.toml",
             ("live", "--device", "simulated", "--tooth", "block.vdb", *bur, "--duration-s", "0.05", "--no-real-time",
              "--registration", "registration.toml", "-o", "out.h5", "--json"), ("out.h5",), statements.toml,
             ("block.vdb",), repeats=False),
    ]
    return result


SCRIPT = """start_mm = [0, 0.1, 0]
axis = [0, 1, 0]
rate_hz = 100
[[segment]]
kind = "line"
to_mm = [0, -0.4, 0]
speed_mm_s = 1
[[segment]]
kind = "line"
to_mm = [0.6, -0.4, 0]
speed_mm_s = 1
[[segment]]
kind = "arc"
center_mm = [0.3, -0.4, 0]
normal = [0, 1, 0]
angle_deg = 90
speed_mm_s = 1
"""
BUR_FILE = """name = "worn bur"
[[piece]]
kind = "line"
to_mm = [0.4, 0.0]
[[piece]]
kind = "arc"
to_mm = [0.6, 0.2]
radius_mm = 0.2
[[piece]]
kind = "polyline"
r_mm = [0.61, 0.60]
z_mm = [1.5, 3.0]
[shank]
diameter_mm = 1.0
top_mm = 9.0
"""
PARAMETERS = """preset = "paper"
[tissue.enamel]
specific_energy_j_per_mm3 = 0.31
force_ratio = 0.26
[tissue.dentin]
specific_energy_j_per_mm3 = 0.11
[handpiece]
rotation_rate_rev_s = 110
stall_torque_mnm = 1.3
[coupling]
stiffness_n_per_mm = 1.1
[step]
time_step_s = 0.004
"""
REGISTRATION = """rotation_xyzw = [0, 0, 0, 1]
translation_mm = [1, 2, 3]
stylus_to_bur_xyzw = [0, 0, 0, 1]
fixed_axis = [0, 1, 0]
"""
MANIFEST = """[defaults]
command = "replay"
arguments = { tooth = "block.vdb", bur = "ball:D1.2", drive = "direct" }
[[item]]
name = "one"
arguments = { trajectory = "path.csv" }
"""


def make_files(run, folder, data):
    """All undamaged files, into `folder`. `run` runs the toolkit there; `data` is the repository's data folder."""
    def path(name):
        return os.path.join(folder, name)

    def write(name, text):
        with open(path(name), "w", encoding="ascii") as file:
            file.write(text)

    for name in ("scan.nrrd", "scan.nii", "scan.nii.gz", "scan.mha", "ct"):
        labels = ("--labels", "labels.nrrd") if name == "scan.nrrd" else ()
        run("specimen", "scan", "-o", name, "--spacing-mm", "0.9", *labels)
    with open(path("scan.nrrd"), "rb") as file:
        head, _, body = file.read().partition(b"\n\n")
    raw = head.replace(b"encoding: gzip", b"encoding: raw").replace(b"encoding: gz", b"encoding: raw")
    with open(path("raw.nrrd"), "wb") as file:
        file.write(raw + b"\n\n" + statements.inflate(body))
    run("specimen", "block", "-o", "block.vdb", "--size-mm", "3", "--enamel-mm", "1.5", "--voxel-mm", "0.25")
    for extension in ("stl", "ply", "obj"):
        run("mesh", "block.vdb", "-o", "block." + extension)
    with open(path("block.vdb"), "rb") as file:
        block = bytearray(file.read())
    block[21 + 14] = ord("4")  # a random id, as other programs write it: no checksum
    with open(path("foreign.vdb"), "wb") as file:
        file.write(block)
    write("path.toml", SCRIPT)
    write("bur.toml", BUR_FILE)
    write("rig.toml", PARAMETERS)
    write("registration.toml", REGISTRATION)
    write("batch.toml", MANIFEST)
    shutil.copy(os.path.join(data, "rubrics", "class1.toml"), folder)
    shutil.copy(os.path.join(data, "rig", "limits.toml"), folder)
    trajectory = ("--tooth", "block.vdb", "--trajectory", "path.toml", "--bur", BUR, "--drive", "direct", "--stall-torque-mnm", "inf")
    run("replay", *trajectory, "--time-step-s", "0.004", "-o", "trace.h5", "--prepared", "prepared.vdb")
    import h5py
    with h5py.File(path("trace.h5")) as trace, open(path("path.csv"), "w", encoding="ascii") as file:
        file.write("time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw\n")
        for row in zip(trace["time"], trace["handle/position"], trace["handle/orientation"]):
            file.write(",".join(f"{float(x):.9g}" for x in (row[0], *row[1], *row[2])) + "\n")
    for name in ("rig.csv", "rig.h5"):
        run("specimen", "measurement", *trajectory, "--noise-percent", "5", "--params", "rig.toml", "-o", name)
    run("live", "--device", "simulated", "--tooth", "block.vdb", "--bur", BUR, "--duration-s", "0.2", "--no-real-time",
        "-o", "session.h5")
