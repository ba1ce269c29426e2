"""Trajectories and damaged traces as other programs make them.

Usage: make_foreign_files.py TRACE.h5 FOLDER. Writes good_*.h5 (to be read as trajectories) and
bad_*.h5 into FOLDER, and expected.txt: per line a bad file's name, which reader must refuse it (trace
or trajectory), and a part of the error; and same_*.h5, the trace stored in other ways, named by
same.txt, a line each.
"""
import shutil
import sys
import zlib

import h5py
import numpy as np

trace, folder = sys.argv[1:]
expected = open(folder + "/expected.txt", "w")
T = 50
time = np.arange(T) * 1e-3
position = np.stack([np.linspace(0, 1, T)] * 3, axis=1)


def unit(d, text):
    d.attrs["units"] = text


# A minimal trajectory: two datasets, h5py's own strings.
with h5py.File(folder + "/good_minimal.h5", "w") as f:
    unit(f.create_dataset("time", data=time), "s")
    unit(f.create_dataset("handle/position", data=position), "mm")

# MATLAB-like: columns of 1 x T, fixed-length strings, logical buttons, single precision, other data.
with h5py.File(folder + "/good_matlab.h5", "w") as f:
    unit(f.create_dataset("time", data=time[None, :]), np.bytes_("s"))
    unit(f.create_dataset("handle/position", data=position.astype("f4"), chunks=(7, 3)),
         np.bytes_("mm"))
    f.create_dataset("handle/orientation", data=np.tile([0.0, 0.0, 1.0002, 0.0], (T, 1)))
    f.create_dataset("handle/buttons", data=np.arange(T) % 2 == 0)
    unit(f.create_dataset("force/measured", data=np.arange(3 * T).reshape(T, 3)), "N")
    f.create_dataset("notes", data="nothing")
    f.attrs["schema"] = "some-other-lab"

# Big-endian, integer milliseconds are not seconds; but big-endian doubles and integer positions are.
with h5py.File(folder + "/good_bigendian.h5", "w") as f:
    unit(f.create_dataset("time", data=time.astype(">f8")), "s")
    unit(f.create_dataset("handle/position", data=np.arange(3 * T).reshape(T, 3)), "mm")


def bad(name, part, change, reader="trajectory"):
    """A copy of the trace with `change` done to it."""
    path = f"{folder}/bad_{name}.h5"
    shutil.copy(trace, path)
    with h5py.File(path, "r+") as f:
        change(f)
    expected.write(f"bad_{name}.h5\t{reader}\t{part}\n")


def replace(name, data, units=None, **options):
    def change(f):
        old = dict(f[name].attrs)
        del f[name]
        d = f.create_dataset(name, data=data, **options)
        for key, value in old.items():
            d.attrs[key] = value
        if units is not None:
            d.attrs["units"] = units
    return change


def edit(name, index, value):
    def change(f):
        f[name][index] = value
    return change


def claim(name, shape, chunks):
    def change(f):
        units = f[name].attrs["units"]
        del f[name]
        f.create_dataset(name, shape=shape, chunks=chunks, dtype="f8").attrs["units"] = units
    return change


def delete(name):
    return lambda f: f.__delitem__(name)


def attribute(name, key, value):
    return lambda f: f[name].attrs.__setitem__(key, value)


with h5py.File(trace, "r") as f:
    n = len(f["time"])
    q = f["handle/orientation"][:]
    p = f["handle/position"][:]

bad("no_time", "/time: is missing", delete("time"))
bad("no_position", "/handle/position: is missing", delete("handle/position"))
bad("no_handle", "/handle/position: is missing", delete("handle"))
bad("no_unit_time", "/time: has no attribute `units`", lambda f: f["time"].attrs.__delitem__("units"))
bad("no_unit_position", "/handle/position: has no attribute",
    lambda f: f["handle/position"].attrs.__delitem__("units"))
bad("metres", '/handle/position: is in "m", must be in "mm"', attribute("handle/position", "units", "m"))
bad("milliseconds", '/time: is in "ms"', attribute("time", "units", "ms"))
bad("unit_number", "attribute units: must be text", attribute("time", "units", 3.0))
bad("unit_list", "must hold one text", attribute("time", "units", ["s", "s"]))
bad("time_repeats", "/time, row 7: time does not increase", edit("time", 7, 0.006))
bad("time_nan", "/time, row 7: is not finite", edit("time", 7, np.nan))
bad("position_nan", "/handle/position, row 4: is not finite", edit("handle/position", (4, 1), np.nan))
bad("position_inf", "/handle/position, row 0: is not finite", edit("handle/position", (0, 0), np.inf))
bad("short", "/handle/position: has 10 rows where /time has",
    replace("handle/position", np.zeros((10, 3))))
bad("transposed", "transposed", replace("handle/position", p.T))
bad("two_columns", "must be T x 3", replace("handle/position", p[:, :2]))
bad("flat", "must be T x 3", replace("handle/position", p.ravel()))
bad("cube", "must be T x 3", replace("handle/position", np.zeros((n, 3, 1))))
bad("scalar", "/time: is a single value", replace("time", 1.0))
bad("null", "/time: is empty", replace("time", h5py.Empty("f8")))
bad("no_rows", "/time: holds no rows", replace("time", np.zeros(0)))
bad("one_row", "/time: holds fewer than two samples", replace("time", np.zeros(1)))
bad("text", "/time: must hold numbers", replace("time", np.array([b"0", b"1"])))
bad("compound", "/time: must hold numbers",
    replace("time", np.zeros(n, dtype=[("a", "f8"), ("b", "f8")])))
bad("complex", "/time: must hold numbers", replace("time", np.zeros(n, dtype=complex)))
bad("group", "/time: is not a dataset", lambda f: (f.__delitem__("time"), f.create_group("time")))
bad("soft_link", "/time: is missing",
    lambda f: (f.__delitem__("time"), f.__setitem__("time", h5py.SoftLink("/nowhere"))))
bad("loop", "/time: is missing",
    lambda f: (f.__delitem__("time"), f.__setitem__("time", h5py.SoftLink("/time"))))


def elsewhere(make):
    """/time taken away and made again by `make`, out of another file."""
    def change(f):
        del f["time"]
        make(f)
    return change


def external_storage(f):
    with open(folder + "/time.raw", "wb") as raw:
        raw.write(np.linspace(0, 1, n).tobytes())
    unit(f.create_dataset("time", (n,), "f8", external=[(folder + "/time.raw", 0, 8 * n)]), "s")


def virtual(f):
    layout = h5py.VirtualLayout((n,), "f8")
    layout[:] = h5py.VirtualSource(folder + "/good_minimal.h5", "time", (n,))
    unit(f.create_virtual_dataset("time", layout), "s")


def foreign_filter(f):
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_chunk((n,))
    creation.set_filter(32001, h5py.h5z.FLAG_OPTIONAL)  # Blosc, of a plug-in
    d = h5py.h5d.create(f.id, b"time", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((n,)), creation)
    d = h5py.Dataset(d)
    d[:] = np.linspace(0, 1, n)
    unit(d, "s")


bad("external_link", "/time: is a link to another file",
    elsewhere(lambda f: f.__setitem__("time", h5py.ExternalLink(folder + "/good_minimal.h5", "/time"))))
bad("external_group", "/handle: is a link to another file",
    lambda f: (f.__delitem__("handle"),
               f.__setitem__("handle", h5py.ExternalLink(folder + "/good_minimal.h5", "/handle"))))
bad("external_by_soft_link", "/time: is missing",
    elsewhere(lambda f: (f.__setitem__("far", h5py.ExternalLink(folder + "/good_minimal.h5", "/")),
                         f.__setitem__("time", h5py.SoftLink("/far/time")))))
bad("external_storage", "/time: is stored in other files", elsewhere(external_storage))
bad("virtual", "/time: is stored in other files", elsewhere(virtual))
bad("foreign_filter", "/time: is packed by the filter 32001", elsewhere(foreign_filter))
bad("claims_1e12", "/time: claims 1000000000000 rows", claim("time", (10**12,), (1000,)))
bad("claims_2e15", "/time: claims", claim("time", (2**51,), (2**20,)))
bad("claims_1e7", "/time: holds no data", claim("time", (10**7,), (1000,)))
bad("position_claims", "/handle/position: claims 1000000000000 rows",
    claim("handle/position", (10**12, 3), (1000, 3)))
bad("huge_chunk", "chunks of more than 256 MB",
    lambda f: (f.__delitem__("time"),
               f.create_dataset("time", shape=(n,), maxshape=(None,), chunks=(2**27,), dtype="f8",
                                compression="gzip").attrs.__setitem__("units", "s")))
bad("zero_quaternion", "/handle/orientation, row 0: is not a unit quaternion",
    edit("handle/orientation", 0, 0))
bad("scaled_quaternion", "/handle/orientation, row 0: is not a unit quaternion",
    replace("handle/orientation", 1.01 * q))
bad("buttons", "/handle/buttons, row 0: must be a whole number",
    replace("handle/buttons", np.full(n, 0.5)))
bad("negative_buttons", "/handle/buttons, row 0: must be a whole number",
    replace("handle/buttons", np.full(n, -1)))
bad("measured_no_unit", "/force/measured: has no attribute `units`",
    lambda f: f.create_dataset("force/measured", data=np.zeros((n, 3))))
bad("newer", "schema_version: is 3", lambda f: f.attrs.__setitem__("schema_version", 3))
bad("no_events", "event_burs: is missing", lambda f: f.attrs.__setitem__("schema_version", 2))
bad("version_text", "schema_version: must be one number",
    lambda f: f.attrs.__setitem__("schema_version", "1"))

bad("no_schema", "schema: is missing", lambda f: f.attrs.__delitem__("schema"), "trace")
bad("other_schema", "is 'x', not 'toothprep-trace'", lambda f: f.attrs.__setitem__("schema", "x"),
    "trace")
bad("schema_number", "must be text", lambda f: f.attrs.__setitem__("schema", 1), "trace")
bad("no_version", "schema_version: is missing", lambda f: f.attrs.__delitem__("schema_version"),
    "trace")
bad("no_parameters", "parameters: is missing", lambda f: f.attrs.__delitem__("parameters"), "trace")
bad("no_audit", "energy_ratio: is missing", lambda f: f.attrs.__delitem__("energy_ratio"), "trace")
bad("no_force", "/force/device: is missing", delete("force/device"), "trace")
bad("force_unit", '/force/device: is in "kN"', attribute("force/device", "units", "kN"), "trace")
bad("no_force_unit", "/force/grinding: has no attribute",
    lambda f: f["force/grinding"].attrs.__delitem__("units"), "trace")
bad("torque_unit", '/torque: is in "N*m"', attribute("torque", "units", "N*m"), "trace")
bad("stalled_two", "/stalled, row 3: must be 0 or 1", edit("stalled", 3, 2), "trace")
bad("no_tissues", "/contact/area, attribute tissues: is missing",
    lambda f: f["contact/area"].attrs.__delitem__("tissues"), "trace")
bad("tissue_names", "unknown tissue 'bone'",
    attribute("contact/area", "tissues", ["enamel", "dentin", "pulp", "bone"]), "trace")
bad("tissue_twice", "names 'pulp' twice",
    attribute("removed/volume", "tissues", ["enamel", "dentin", "pulp", "pulp"]), "trace")
bad("tissue_count", "/removed/volume: is",
    attribute("removed/volume", "tissues", ["enamel", "dentin"]), "trace")
bad("tissue_many", "must hold 1 to 4 texts",
    attribute("removed/volume", "tissues", ["enamel"] * 5), "trace")
bad("volume_nan", "/removed/volume, row 2: is not finite", edit("removed/volume", (2, 1), np.nan),
    "trace")


def scramble(f):
    """Overwrites the compressed bytes of a chunk."""
    d = f["force/grinding"].id
    info = d.get_chunk_info(0)
    d.write_direct_chunk(info.chunk_offset, b"\x55" * info.size)


bad("chunk", "/force/grinding: cannot be read: the file is damaged", scramble, "trace")


def repacked(change, name="force/grinding"):
    """Gives the only chunk of a dataset the packed bytes that `change` makes of its own."""
    def do(f):
        d = f[name].id
        mask, packed = d.read_direct_chunk((0, 0))
        d.write_direct_chunk((0, 0), change(packed), mask)
    return do


for name, change in (("cut", lambda packed: packed[:len(packed) // 2]),
                     ("sum", lambda packed: packed[:-1] + bytes([packed[-1] ^ 1])),
                     ("head", lambda packed: b"\x79" + packed[1:]),
                     ("empty", lambda packed: b"\x78")):
    bad("chunk_" + name, "/force/grinding: cannot be read: the file is damaged", repacked(change), "trace")

same_files = open(folder + "/same.txt", "w")


def same(name, store, **options):
    """The trace with its datasets made by `store`; no reader may notice."""
    with h5py.File(trace, "r") as a, h5py.File(f"{folder}/same_{name}.h5", "w", **options) as b:
        for key, value in a.attrs.items():
            b.attrs[key] = value

        def copy(path, given):
            if isinstance(given, h5py.Dataset):
                d = store(b, path, given[()])
                for key, value in given.attrs.items():
                    d.attrs[key] = value
        a.visititems(copy)
    same_files.write(f"same_{name}.h5\n")


def packed(rows=None, columns=None, **options):
    def store(f, path, data):
        chunk = (rows or len(data),) + tuple(min(w, columns or w) for w in data.shape[1:])
        return f.create_dataset(path, data=data, chunks=chunk, **{"compression": "gzip", "shuffle": True, **options})
    return store


def growing(f, path, data):
    return packed(rows=5000, maxshape=(None,) + data.shape[1:])(f, path, data)


def unpacked_chunk(f, path, data):
    d = packed()(f, path, data)
    d.id.write_direct_chunk((0,) * data.ndim, data.tobytes(), filter_mask=3)
    return d


def longer_chunk(f, path, data):
    d = packed(shuffle=False)(f, path, data)
    d.id.write_direct_chunk((0,) * data.ndim, zlib.compress(data.tobytes() + b"\0" * 100))
    return d


same("contiguous", lambda f, path, data: f.create_dataset(path, data=data))
same("small_chunks", packed(rows=300))
same("one_large_chunk", growing)
same("columns_apart", packed(rows=300, columns=1))
same("no_shuffle", packed(rows=300, shuffle=False))
same("no_gzip", packed(rows=300, compression=None))
same("fletcher", packed(rows=300, fletcher32=True))
same("big_endian", lambda f, path, data: packed(rows=300)(f, path, data.astype(data.dtype.newbyteorder(">"))))
same("wide_integers", lambda f, path, data: packed(rows=300)(f, path, data.astype("i8") if data.dtype.kind == "u" else data))
same("user_block", packed(rows=300), userblock_size=512)
same("new_format", packed(rows=300), libver="latest")
same("unpacked_chunk", unpacked_chunk)
same("longer_chunk", longer_chunk)
same_files.close()

# A tissue order of its own is no damage.
shutil.copy(trace, folder + "/good_order.h5")
with h5py.File(folder + "/good_order.h5", "r+") as f:
    for name in ("contact/area", "removed/volume"):
        data = f[name][:][:, [1, 0]]
        units = f[name].attrs["units"]
        del f[name]
        d = f.create_dataset(name, data=data)
        d.attrs["units"] = units
        d.attrs["tissues"] = ["dentin", "enamel"]
    del f["handle/buttons"], f["contact/shank_area"]
