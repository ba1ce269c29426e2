"""Writes the seeds of scripts/fuzz: small files of every format, of which some are the tools' own output.

Usage: fuzz_seeds.py TOOTHPREP FOLDER      makes FOLDER/dicom, FOLDER/volume, FOLDER/shells
The seeds of the last two begin with a byte that chooses the format (see the targets).
"""
import os
import struct
import subprocess
import sys

TOOL, FOLDER = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
VOLUMES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")
SHELLS = (".stl", ".ply", ".obj", ".off")


def run(*args):
    subprocess.run([TOOL, "--quiet", *args, "--force"], cwd=FOLDER, check=True)


def seed(target, name, content, formats=None):
    if formats:
        content = bytes([formats.index(next(e for e in formats if name.endswith(e)))]) + content
    with open(os.path.join(FOLDER, target, name), "wb") as f:
        f.write(content)


def content(name):
    with open(os.path.join(FOLDER, name), "rb") as f:
        return f.read()


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


for folder in ("dicom", "volume", "shells"):
    os.makedirs(os.path.join(FOLDER, folder), exist_ok=True)

run("specimen", "scan", "-o", "ct", "--spacing-mm", "3")
for name in ("slice_0001.dcm", "slice_0002.dcm"):
    seed("dicom", name, content(os.path.join("ct", name)))
seed("dicom", "multi.dcm", multi_frame(3))

for extension in (".nrrd", ".nii", ".nii.gz", ".mha"):
    run("specimen", "scan", "-o", "scan" + extension, "--spacing-mm", "3")
    seed("volume", "scan" + extension, content("scan" + extension), VOLUMES)
for encoding, data in (("raw", "\n"), ("ascii", "\n"), ("raw", "data file: fuzz-volume.raw\n"),
                       ("gzip", "data file: fuzz-volume.raw\n"), ("raw", "byte skip: -1\ndata file: fuzz-volume.raw\n"),
                       ("raw", "data file: fuzz-volume-%02d.raw 1 4 1\n"),
                       ("raw", "data file: LIST\nfuzz-volume.raw\n")):
    text = ("NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 2 3 4\n"
            "space directions: (0.3,0,0) (0,0.3,0) (0,0,0.3)\nspace units: \"mm\" \"mm\" \"mm\"\n"
            f"kinds: domain domain domain\nencoding: {encoding}\nendian: little\n{data}")
    name = f"{encoding}-{len(data)}" + (".nrrd" if data == "\n" else ".nhdr")
    seed("volume", name, text.encode() + (b"1 2 3 4 " * 6 if data == "\n" else b""), VOLUMES)
for data, name in (("LOCAL", "local.mha"), ("fuzz-volume.raw", "beside.mhd"), ("LIST\nfuzz-volume.raw", "list.mhd"),
                   ("fuzz-volume-%02d.raw 1 4 1", "pattern.mhd")):
    text = ("ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
            "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\nElementSpacing = 0.3 0.3 0.3\nDimSize = 2 3 4\n"
            f"HeaderSize = 0\nElementNumberOfChannels = 1\nElementType = MET_SHORT\nElementDataFile = {data}\n")
    seed("volume", name, text.encode() + bytes(48 if data == "LOCAL" else 0), VOLUMES)

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
