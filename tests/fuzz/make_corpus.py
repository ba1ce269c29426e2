#!/usr/bin/python3
"""Writes corpus/: for each reader small good files (good-*), some of them the toolkit's own output, and damage to them.

    make_corpus.py TOOTHPREP      run it again when a format changes, and look at what git says

scripts/fuzz starts from these files, and the ordinary tests read them all. Inputs that broke a reader are added by
hand, as found-*, and stay. Where a reader takes several formats a file's first byte chooses (see fuzz_*.cpp).
"""
import glob
import gzip
import os
import random
import struct
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "mutations"))
import kinds  # noqa: E402
import mutations  # noqa: E402

TOOL, DATA = os.path.abspath(sys.argv[1]), os.path.join(HERE, "..", "..", "data")
CORPUS, WORK = os.path.join(HERE, "corpus"), tempfile.mkdtemp(prefix="toothprep-corpus-")
VOLUMES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")
SHELLS = (".stl", ".ply", ".obj", ".off")
HDF5 = ("trace.h5", "session.h5", "path.h5", "rig.h5")


def run(*args):
    subprocess.run([TOOL, "--quiet", *args], cwd=WORK, check=True)


def write(target, name, content):
    """Packed by gzip if it is large: the readers of the corpus unpack it."""
    os.makedirs(os.path.join(CORPUS, target), exist_ok=True)
    if len(content) > 8000:
        name, content = name + ".gz", gzip.compress(content, 9, mtime=0)
    with open(os.path.join(CORPUS, target, name), "wb") as f:
        f.write(content)


def seed(target, name, content, formats=None, good="good"):
    """The file and damage to it. `good`: "odd" for one that is refused, but by a place that is not easily reached."""
    chosen = b""
    if formats:
        chosen = bytes([formats.index(next(e for e in formats if name.endswith(e)))])
    write(target, f"{good}-{name}", chosen + content)
    chance = random.Random(target + name)
    for i in range(6 if len(content) < 1500 else 2 if len(content) < 5000 else 1):
        how, damaged = mutations.mutated(content, chance)
        write(target, f"damaged-{name}-{i}-{how.replace(' ', '-')}", chosen + damaged)


def content(name, folder=WORK):
    with open(os.path.join(folder, name), "rb") as f:
        return f.read()


for old in glob.glob(os.path.join(CORPUS, "*", "[!f]*-*")):
    os.remove(old)


def element(tag, kind, value):
    """Explicit, little endian. A list is a sequence of items, each a list of elements."""
    if isinstance(value, list):
        value = b"".join(struct.pack("<HHI", 0xFFFE, 0xE000, len(i)) + i for i in (b"".join(i) for i in value))
    elif isinstance(value, str):
        value = value.encode() + (b"" if len(value) % 2 == 0 else b" ")
    head = struct.pack("<HH", tag >> 16, tag & 0xFFFF) + kind.encode()
    if kind in ("SQ", "OW", "OB", "UN"):
        return head + struct.pack("<HI", 0, len(value)) + value
    return head + struct.pack("<H", len(value)) + value


def multi_frame(frames):
    """An Enhanced CT of 4 x 4 pixels."""
    def number(value):
        return struct.pack("<H", value)
    meta = element(0x00020010, "UI", "1.2.840.10008.1.2.1\0")
    own = [[element(0x00209113, "SQ", [[element(0x00200032, "DS", f"0\\0\\{0.5 * f}")]])] for f in range(frames)]
    shared = [[element(0x00289110, "SQ", [[element(0x00280030, "DS", "0.5\\0.5")]]),
               element(0x00209116, "SQ", [[element(0x00200037, "DS", "1\\0\\0\\0\\1\\0")]]),
               element(0x00289145, "SQ", [[element(0x00281052, "DS", "-100"), element(0x00281053, "DS", "0.5")]])]]
    return b"\0" * 128 + b"DICM" + meta + b"".join([
        element(0x00080060, "CS", "CT"), element(0x0008103E, "LO", "series"), element(0x0020000E, "UI", "2.25.1\0"),
        element(0x00200011, "IS", "3"), element(0x00280002, "US", number(1)),
        element(0x00280004, "CS", "MONOCHROME2"), element(0x00280008, "IS", str(frames)),
        element(0x00280010, "US", number(4)), element(0x00280011, "US", number(4)),
        element(0x00280100, "US", number(16)), element(0x00280101, "US", number(12)),
        element(0x00280102, "US", number(11)), element(0x00280103, "US", number(1)),
        element(0x52009229, "SQ", shared), element(0x52009230, "SQ", own),
        element(0x7FE00010, "OW", bytes(32 * frames))])


run("specimen", "scan", "-o", "ct", "--spacing-mm", "3")
seed("dicom", "slice.dcm", content(sorted(glob.glob(os.path.join(WORK, "ct", "*.dcm")))[3]), good="odd")
seed("dicom", "multi.dcm", multi_frame(3))

for extension in (".nrrd", ".nii", ".nii.gz", ".mha"):
    run("specimen", "scan", "-o", "scan" + extension, "--spacing-mm", "3")
    seed("volume", "scan" + extension, content("scan" + extension), VOLUMES)
for encoding, data in (("raw", "\n"), ("ascii", "\n"), ("raw", "data file: beside.raw\n"),
                       ("gzip", "data file: beside.raw\n"), ("raw", "byte skip: -1\ndata file: beside.raw\n"),
                       ("raw", "data file: beside-%02d.raw 1 4 1\n"),
                       ("raw", "data file: LIST\nbeside.raw\n")):
    text = ("NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 3 4\n"
            "space directions: (0.3,0,0) (0,0.3,0) (0,0,0.3)\nspace units: \"mm\" \"mm\" \"mm\"\n"
            f"kinds: domain domain domain\nencoding: {encoding}\nendian: little\n{data}")
    name = f"{encoding}-{len(data)}" + (".nrrd" if data == "\n" else ".nhdr")
    seed("volume", name, text.encode() + (b"1 2 3 4 " * 6 if data == "\n" else b""), VOLUMES, "odd")
for data, name in (("LOCAL", "local.mha"), ("beside.raw", "beside.mhd"), ("LIST\nbeside.raw", "list.mhd"),
                   ("beside-%02d.raw 1 4 1", "pattern.mhd")):
    text = ("ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
            "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\nElementSpacing = 0.3 0.3 0.3\nDimSize = 2 3 4\n"
            f"HeaderSize = 0\nElementNumberOfChannels = 1\nElementType = MET_SHORT\nElementDataFile = {data}\n")
    seed("volume", name, text.encode() + bytes(48 if data == "LOCAL" else 0), VOLUMES, "odd")

POINTS = [(x, y, z) for z in (0, 4) for y in (0, 4) for x in (0, 4)]
QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
TRIANGLES = [t for q in QUADS for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]


def lines(rows):
    return "".join(" ".join(map(str, row)) + "\n" for row in rows)


text = "solid box\n" + "".join(
    "facet normal 0 0 0\nouter loop\n" + lines(("vertex", *POINTS[c]) for c in t) + "endloop\nendfacet\n"
    for t in TRIANGLES) + "endsolid box\n"
seed("shells", "text.stl", text.encode(), SHELLS)
binary = bytes(80) + struct.pack("<I", len(TRIANGLES))
for t in TRIANGLES:
    binary += bytes(12) + b"".join(struct.pack("<3f", *POINTS[c]) for c in t) + bytes(2)
seed("shells", "binary.stl", binary, SHELLS)
text = "# box\no box\n" + lines(("v", *p) for p in POINTS) + "vn 0 0 1\n"
text += lines(("f", *(f"{c + 1}//1" for c in q)) for q in QUADS[:3])
seed("shells", "box.obj", (text + lines(("f", *(c - 8 for c in q)) for q in QUADS[3:])).encode(), SHELLS)
seed("shells", "box.off", ("OFF # box\n8 6 0\n" + lines(POINTS) + lines((4, *q) for q in QUADS)).encode(), SHELLS)
seed("shells", "colours.off", ("COFF\n8 6 0\n" + lines((*p, 1, 2, 3) for p in POINTS) +
                               lines((4, *q, 9, 9, 9) for q in QUADS)).encode(), SHELLS)


def ply_header(form, scalar, count, index):
    return (f"ply\nformat {form} 1.0\ncomment box\nelement vertex 8\nproperty {scalar} x\nproperty {scalar} y\n"
            f"property {scalar} z\nproperty uchar tissue\nelement face 6\n"
            f"property list {count} {index} vertex_indices\nend_header\n").encode()


seed("shells", "text.ply", ply_header("ascii", "int", "uchar", "int") + (
    lines((*p, 1) for p in POINTS) + lines((4, *q) for q in QUADS)).encode(), SHELLS)
for name, mark, form in (("little.ply", "<", "binary_little_endian"), ("big.ply", ">", "binary_big_endian")):
    body = b"".join(struct.pack(mark + "3fB", *p, 1) for p in POINTS)
    body += b"".join(struct.pack(mark + "I4i", 4, *q) for q in QUADS)
    seed("shells", name, ply_header(form, "float", "uint", "int") + body, SHELLS)


# ---- Text, and what the toolkit writes
os.makedirs(os.path.join(WORK, "small"))
kinds.make_files(lambda *args: subprocess.run([TOOL, "-q", *args], cwd=os.path.join(WORK, "small"), check=True),
                 os.path.join(WORK, "small"), DATA)
for target, name in (("trajectory_csv", "path.csv"), ("script", "path.toml"), ("recording_csv", "rig.csv"),
                     ("bur_profile", "bur.toml"), ("parameters", "rig.toml"), ("registration", "registration.toml"),
                     ("rubric", "class1.toml")):
    text = content(name, os.path.join(WORK, "small"))
    seed(target, name, b"\n".join(text.split(b"\n")[:60]) + b"\n" if name.endswith(".csv") else text)
seed("trajectory_csv", "forces.csv", b"time_s,fx_N,fy_N,fz_N,x_mm,y_mm,z_mm,buttons\n" + lines(
    (f"{0.001 * i:.3f},0.1,{i},-0.5,{0.1 * i},0,0,1",) for i in range(8)).encode())
for folder, names, target in (("trajectories", ("class1-molar", "calibration"), "script"), ("rig", ("limits",), "rig_limits"),
                              ("scans", ("hounsfield",), "hounsfield"), ("rubrics", ("crown",), "rubric")):
    for name in names:
        seed(target, name + ".toml", content(name + ".toml", os.path.join(DATA, folder)))
for name in ("figure-10", "figure-15", "figure-16"):
    seed("experiment", name + ".toml", content("experiment.toml", os.path.join(DATA, "figures", name)))
for i, text in enumerate(("rest", "step 0.5 N for 2 s", "stiffness-sweep 0.2..2 N/mm in 10 steps of 2 s",
                          "damping-sweep 1..100 N*s/m in 9 geometric steps of 2 s", "wall 1 N/mm travel 3 mm for 10 s")):
    seed("protocol", f"{i}.txt", text.encode())
seed("manifest", "batch.toml", b"""[defaults]
command = "replay"
arguments = { tooth = "beside.raw", bur = "ball:D1.2", drive = "direct" }
[[item]]
name = "one"
arguments = { trajectory = "beside.raw", prepared = true }
[[item]]
name = "two"
command = "score"
arguments = { original = "beside.raw", prepared = "beside.raw", tooth = false, bur = false, drive = false }
""")
seed("figures_json", "score.json", b'{"removed_mm3": {"enamel": 1.5}, "walls": [{"key": "mesial", "taper_deg": 6}], '
     b'"passed": true, "type": "class1", "time_s": null}\n')

# A trace and a live session of few rows, each under the names that it can have.
with open(os.path.join(WORK, "short.toml"), "w", encoding="ascii") as f:
    f.write("start_mm = [0, 0.1, 0]\naxis = [0, 1, 0]\nrate_hz = 50\n[[segment]]\nkind = \"line\"\n"
            "to_mm = [0, -0.1, 0]\nspeed_mm_s = 2\n")
run("specimen", "block", "-o", "block.vdb", "--size-mm", "1.6", "--enamel-mm", "0.8", "--voxel-mm", "0.4")
short = ("--tooth", "block.vdb", "--trajectory", "short.toml", "--bur", kinds.BUR)
run("replay", *short, "--time-step-s", "0.02", "-o", "trace.h5", "--prepared", "prepared.vdb")
with open(os.path.join(WORK, "step.toml"), "w", encoding="ascii") as f:
    f.write("[step]\ntime_step_s = 0.02\n")
run("specimen", "measurement", *short, "--params", "step.toml", "-o", "rig.h5")
run("live", "--device", "simulated", "--tooth", "block.vdb", "--bur", kinds.BUR, "--duration-s", "0.01",
    "--no-real-time", "-o", "session.h5")
seed("hdf5", "trace.h5", content("trace.h5"), HDF5)
write("hdf5", "good-as-path.h5", b"\2" + content("trace.h5"))
seed("hdf5", "rig.h5", content("rig.h5"), HDF5)
seed("hdf5", "session.h5", content("session.h5"), HDF5)
tooth = bytearray(content("block.vdb"))
write("tooth_vdb", "damaged-checksum.vdb", bytes(tooth[:-1]) + b"\1")
for name, file in ("of-others.vdb", "block.vdb"), ("prepared-of-others.vdb", "prepared.vdb"):
    tooth = bytearray(content(file))
    tooth[21 + 14] = ord("4")  # a random id, as other programs write it: no checksum
    seed("tooth_vdb", name, bytes(tooth))
