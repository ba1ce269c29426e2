"""What a file says, read without any code of the toolkit's: what an answer that changed is judged by.

Each reader gives a value that is equal for files that say the same, and raises for a file that is not well-formed.
Readers of scans and shells also give the volumes that follow (Volumes), within a tolerance.
"""
import csv as csv_module
import glob
import gzip
import hashlib
import io
import math
import os
import re
import struct
import tomllib
import zlib
from dataclasses import dataclass, field


class NotWellFormed(Exception):
    pass


def require(condition, what):
    if not condition:
        raise NotWellFormed(what)


def read(path):
    with open(path, "rb") as file:
        return file.read()


@dataclass
class Volumes:
    """A statement that volumes follow from: {figure: mm^3}, and what one voxel more or less is."""
    says: object
    volumes: dict
    voxels: object = field(default=None, compare=False)
    voxel_mm3: float = 1  # also of shells, which have none

    def tolerance(self, before):
        """mm^3 by which volumes may miss besides 10 %: ten voxels for each one that was changed, since interpolation
        carries an extreme value to its neighbours."""
        import numpy as np
        changed = 0
        if self.voxels is not None and before.voxels is not None and self.voxels.shape == before.voxels.shape:
            changed = int(np.count_nonzero(self.voxels != before.voxels))
        return 10 * changed * self.voxel_mm3


# ---- Tables and settings

def number(text):
    """As strict as a table should be: plain decimals, finite."""
    require(re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", text), f"'{text}' is no number")
    value = float(text)
    require(math.isfinite(value), f"'{text}' is not finite")
    return value


def csv(path):
    text = read(path).decode("utf-8-sig")
    require("\0" not in text, "holds a zero byte")
    rows = [row for row in csv_module.reader(io.StringIO(text)) if row]
    require(rows, "is empty")
    header = [name.strip() for name in rows[0]]
    require(len(set(header)) == len(header), "a column twice")
    table = {}
    for row in rows[1:]:
        require(len(row) == len(header), "a row of another length")
        for name, cell in zip(header, row):
            table.setdefault(name, []).append(number(cell.strip()))
    return table


def toml(path):
    return tomllib.loads(read(path).decode())


def hdf5(path):
    """Values and attributes. Damaged files can crash the library: call it in a process of its own."""
    import h5py
    import numpy as np
    says = {}

    def note(name, thing):
        for key, value in thing.attrs.items():
            says[f"{name}@{key}"] = str(np.asarray(value).tolist())
        if isinstance(thing, h5py.Dataset):
            values = thing[...]
            require(values.dtype.kind not in "f" or np.all(np.isfinite(values)), f"{name} is not finite")
            says[name] = (str(values.dtype), values.shape, hashlib.sha256(values.tobytes()).hexdigest())

    with h5py.File(path) as file:
        note("/", file)
        file.visititems(note)
    return says


def vdb(path):
    raise NotWellFormed("every byte counts: its checksum covers all of it")


# ---- Scans

def spacing_of(columns):
    """Voxel volume; for a grid whose directions are rectangular and of a size that a scan has."""
    import numpy as np
    columns = np.asarray(columns, dtype=float)
    require(columns.shape == (3, 3) and np.all(np.isfinite(columns)), "directions")
    lengths = np.linalg.norm(columns, axis=1)
    require(np.all((lengths >= 1e-3) & (lengths <= 5)), f"spacing {lengths}")
    unit = columns / lengths[:, None]
    require(np.allclose(unit @ unit.T, np.eye(3), atol=1e-2), "directions are not at right angles")
    return float(np.prod(lengths))


def scan(voxels, directions, origin, classes):
    """`classes`: {figure: (low, high)}, grey values from low to below high."""
    import numpy as np
    voxel = spacing_of(directions)
    require(voxels.ndim == 3 and np.all(np.isfinite(voxels)), "voxels")
    require(np.all(np.isfinite(np.asarray(origin, dtype=float))), "origin")
    volumes = {key: voxel * float(np.count_nonzero((voxels >= low) & (voxels < high)))
               for key, (low, high) in classes.items()}
    says = (voxels.shape, np.asarray(directions).tolist(), np.asarray(origin).tolist(),
            hashlib.sha256(np.ascontiguousarray(voxels, dtype=float).tobytes()).hexdigest())
    return Volumes(says, volumes, voxels, voxel)


NRRD_TYPES = {"short": "i2", "int16": "i2", "signed short": "i2", "unsigned char": "u1", "uchar": "u1", "uint8": "u1"}


def inflate(data):
    """Every checksum counts."""
    unpacked = gzip.decompress(data) if data[:2] == b"\x1f\x8b" else zlib.decompress(data)
    return unpacked


def nrrd(path, classes):
    import numpy as np
    data = read(path)
    head, separator, body = data.partition(b"\n\n")
    require(separator, "no end of the header")
    lines = head.decode("ascii").splitlines()
    require(re.fullmatch(r"NRRD000[1-6]", lines[0]), "magic")
    fields = {}
    for text in lines[1:]:
        if text.startswith("#") or ":=" in text:
            continue
        key, colon, value = text.partition(": ")
        require(colon and key not in fields, f"line '{text}'")
        fields[key] = value.strip()
    require(fields["dimension"] == "3", "dimension")
    require(fields["space"] in ("left-posterior-superior", "LPS"), "space")
    require(set(fields) <= {"type", "dimension", "space", "sizes", "space directions", "kinds", "endian", "encoding",
                            "space origin", "space units"}, "a field that is not known here")
    sizes = [int(s) for s in fields["sizes"].split()]
    require(len(sizes) == 3 and min(sizes) > 1, "sizes")
    vectors = [[float(x) for x in v.split(",")] for v in re.findall(r"\(([^)]*)\)", fields["space directions"])]
    origin = [float(x) for x in fields.get("space origin", "(0,0,0)").strip("()").split(",")]
    kind = np.dtype(NRRD_TYPES[fields["type"]]).newbyteorder("<" if fields.get("endian") != "big" else ">")
    if fields["encoding"] in ("gzip", "gz"):
        body = inflate(body)
    else:
        require(fields["encoding"] == "raw", "encoding")
    require(len(body) == math.prod(sizes) * kind.itemsize, "size of the data")
    return scan(np.frombuffer(body, kind).reshape(sizes[::-1]), vectors, origin, classes)


def metaimage(path, classes):
    import numpy as np
    data = read(path)
    match = re.search(rb"ElementDataFile *= *LOCAL\n", data)
    require(match, "no data of its own")
    fields = {}
    for text in data[:match.start()].decode("ascii").splitlines():
        key, equals, value = text.partition("=")
        require(equals and key.strip() not in fields, f"line '{text}'")
        fields[key.strip()] = value.strip()
    sizes = [int(s) for s in fields["DimSize"].split()]
    spacing = [float(s) for s in fields["ElementSpacing"].split()]
    turn = np.array([float(s) for s in fields["TransformMatrix"].split()]).reshape(3, 3)
    origin = [float(s) for s in fields["Offset"].split()]
    require(fields["NDims"] == "3" and len(sizes) == len(spacing) == 3, "dimensions")
    kind = np.dtype({"MET_SHORT": "<i2", "MET_UCHAR": "u1"}[fields["ElementType"]])
    if fields.get("BinaryDataByteOrderMSB", "False") == "True":
        kind = kind.newbyteorder(">")
    body = data[match.end():]
    if fields.get("CompressedData", "False") == "True":
        body = zlib.decompress(body)
    require(len(body) == math.prod(sizes) * kind.itemsize, "size of the data")
    return scan(np.frombuffer(body, kind).reshape(sizes[::-1]), turn * np.array(spacing)[:, None], origin, classes)


def nifti(path, classes):
    import numpy as np
    data = read(path)
    if path.endswith(".gz"):
        data = inflate(data)
    require(struct.unpack_from("<i", data, 0)[0] == 348 and data[344:348] == b"n+1\0", "magic")
    dim = struct.unpack_from("<8h", data, 40)
    kind = np.dtype({4: "<i2", 2: "u1", 512: "<u2", 8: "<i4", 16: "<f4"}[struct.unpack_from("<h", data, 70)[0]])
    pixdim = struct.unpack_from("<8f", data, 76)
    start, slope, intercept = struct.unpack_from("<3f", data, 108)
    quaternion, straight = struct.unpack_from("<2h", data, 252)
    require(dim[0] == 3 and start >= 348 and start == int(start), "dimensions")
    body = data[int(start):]
    require(len(body) == math.prod(dim[1:4]) * kind.itemsize, "size of the data")
    rows = np.array(struct.unpack_from("<12f", data, 280)).reshape(3, 4)
    if straight > 0:
        lengths = np.linalg.norm(rows[:, :3], axis=0)
        require(quaternion == 0 or np.allclose(lengths, pixdim[1:4], rtol=1e-3), "two spacings")
        directions, origin = rows[:, :3].T, rows[:, 3]
    else:
        directions, origin = np.diag(pixdim[1:4]), struct.unpack_from("<3f", data, 268)
    values = np.frombuffer(body, kind).reshape(dim[3:0:-1]).astype(float)
    if slope != 0 and math.isfinite(slope):
        values = values * slope + intercept
    return scan(values, directions, [*origin, *struct.unpack_from("<6f", data, 256)], classes)


def dicom(folder, classes):
    """A series: regular, complete, of one kind."""
    import numpy as np
    import pydicom
    slices = []
    for path in sorted(glob.glob(os.path.join(folder, "*.dcm"))):
        d = pydicom.dcmread(path)
        values = d.pixel_array * float(d.RescaleSlope) + float(d.RescaleIntercept)
        slices.append((float(d.ImagePositionPatient[2]), [float(x) for x in d.ImagePositionPatient],
                       [float(x) for x in d.PixelSpacing], [float(x) for x in d.ImageOrientationPatient],
                       str(d.SeriesInstanceUID), values))
    slices.sort(key=lambda s: s[0])
    first = slices[0]
    require(all(s[2:5] == first[2:5] and s[5].shape == first[5].shape for s in slices), "slices differ")
    steps = np.diff([s[0] for s in slices])
    require(np.all(np.abs(steps - np.median(steps)) < 0.01 * np.median(steps)), "slices are not regular")
    require(all(np.allclose(s[1][:2], first[1][:2], atol=1e-3) for s in slices), "slices are shifted")
    row, column = np.array(first[3][:3]), np.array(first[3][3:])
    directions = [row * first[2][1], column * first[2][0], [0, 0, float(np.median(steps))]]
    return scan(np.stack([s[5] for s in slices]), directions, first[1], classes)


# ---- Shells

def shell(triangles):
    """Of an (n, 3, 3) array: closed (each edge as often one way as the other), and its volume."""
    import numpy as np
    triangles = np.asarray(triangles, dtype=float)
    require(triangles.ndim == 3 and len(triangles) and np.all(np.isfinite(triangles)), "triangles")
    rounded = [tuple(map(tuple, t)) for t in np.round(triangles, 5).tolist()]
    edges = {}
    for t in rounded:
        for a, b in ((0, 1), (1, 2), (2, 0)):
            if t[a] != t[b]:
                edges[t[a], t[b]] = edges.get((t[a], t[b]), 0) + 1
    require(all(count == edges.get(edge[::-1]) for edge, count in edges.items()), "is not closed")
    moved = triangles - triangles.mean(axis=(0, 1))
    volume = float(np.einsum("ij,ij->i", moved[:, 0], np.cross(moved[:, 1], moved[:, 2])).sum()) / 6
    size = np.ptp(triangles.reshape(-1, 3), axis=0).max()
    require(0.5 <= size <= 200, "size")
    return Volumes(sorted(rounded), {"enamel": abs(volume)})


def stl(path):
    import numpy as np
    data = read(path)
    count = struct.unpack_from("<I", data, 80)[0]
    require(len(data) == 84 + 50 * count, "size of the data")
    records = np.frombuffer(data, np.dtype([("n", "<3f"), ("v", "<9f"), ("a", "<u2")]), count, 84)
    return shell(records["v"].reshape(-1, 3, 3))


def obj(path):
    points, triangles = [], []
    for text in read(path).decode("ascii").splitlines():
        words = text.split("#")[0].split()
        if not words:
            continue
        require(words[0] in ("v", "f", "vn", "g", "o", "s", "usemtl", "mtllib"), f"line '{text}'")
        if words[0] == "v":
            require(len(words) == 4, f"line '{text}'")
            points.append([number(w) for w in words[1:]])
        elif words[0] == "f":
            corners = [int(w.split("/")[0]) for w in words[1:]]
            require(len(corners) == 3 and all(0 < c <= len(points) for c in corners), f"line '{text}'")
            triangles.append([points[c - 1] for c in corners])
    return shell(triangles)


def ply(path):
    import numpy as np
    data = read(path)
    head, separator, body = data.partition(b"end_header\n")
    require(separator, "no end of the header")
    vertices = int(re.search(rb"element vertex (\d+)\n", head).group(1))
    faces = int(re.search(rb"element face (\d+)\n", head).group(1))
    kinds = {b"float": "<f4", b"uchar": "u1", b"uint8": "u1", b"float32": "<f4"}
    of_points, of_faces = (np.dtype([(name.decode(), kinds[kind]) for kind, name in re.findall(
        rb"property (\w+) (\w+)\n", part)]) for part in head.split(b"element face"))
    point = of_points
    face = np.dtype([("n", "u1"), ("v", "<i4", 3)] + of_faces.descr)
    require(b"format binary_little_endian 1.0\n" in head, "format")
    require(len(body) == vertices * point.itemsize + faces * face.itemsize, "size of the data")
    points = np.frombuffer(body, point, vertices)
    corners = np.frombuffer(body, face, faces, vertices * point.itemsize)
    require(np.all(corners["n"] == 3) and corners["v"].min() >= 0 and corners["v"].max() < vertices, "faces")
    places = np.stack([points["x"], points["y"], points["z"]], axis=1)
    return shell(places[corners["v"]])
