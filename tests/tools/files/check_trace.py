"""Reads a trace as any h5py user would, and checks what the file format promises.

Usage: check_trace.py TRACE.h5. Prints nothing and exits 0 if all is as promised.
"""
import sys

import h5py
import numpy as np

UNITS = {  # dataset: (columns, unit)
    "/time": (0, "s"),
    "/handle/position": (3, "mm"),
    "/handle/orientation": (4, "1"),
    "/handle/buttons": (0, "1"),
    "/reading_rejected": (0, "1"),
    "/bur/position": (3, "mm"),
    "/bur/velocity": (3, "mm/s"),
    "/bur/orientation": (4, "1"),
    "/force/grinding": (3, "N"),
    "/force/device": (3, "N"),
    "/torque": (0, "mN*m"),
    "/torque_trial": (0, "mN*m"),
    "/power": (0, "W"),
    "/rotation_rate": (0, "rev/s"),
    "/stalled": (0, "1"),
    "/stalled_fraction": (0, "1"),
    "/contact/area": (4, "mm^2"),
    "/contact/shank_area": (0, "mm^2"),
    "/removed/volume": (4, "mm^3"),
}

with h5py.File(sys.argv[1], "r") as f:
    rows = len(f["/time"])
    names = []
    f.visit(names.append)
    datasets = ["/" + name for name in names if isinstance(f[name], h5py.Dataset)]
    assert sorted(datasets) == sorted(UNITS), set(datasets) ^ set(UNITS)
    for name, (columns, unit) in UNITS.items():
        d = f[name]
        assert d.shape == ((rows, columns) if columns else (rows,)), (name, d.shape)
        assert d.attrs["units"] == unit, (name, d.attrs["units"])
        kind = h5py.h5a.open(d.id, b"units").get_type()
        assert kind.get_cset() == h5py.h5t.CSET_ASCII, name
        assert d.compression == "gzip" and d.shuffle, name
    assert np.all(np.diff(f["/time"][:]) > 0)
    for name in ("/contact/area", "/removed/volume"):
        assert list(f[name].attrs["tissues"]) == ["enamel", "dentin", "pulp", "other"]
    assert f["/time"].dtype == "<f8" and f["/stalled"].dtype == "u1"
    assert f["/handle/buttons"].dtype == "<u4"
    a = f.attrs
    assert a["schema"] == "toothprep-trace" and a["schema_version"] == 1
    assert a["schema_version"].dtype.kind == "i"
    assert "stall_torque_mnm = 1.2" in a["parameters"]
    for name in ("toothprep_version", "tooth_sha256", "bur", "drive", "engine"):
        assert isinstance(a[name], str) and a[name], name
    for name in ("torque_work_mJ", "removed_energy_mJ", "energy_ratio", "initial_overlap_mm3"):
        assert a[name].dtype == "f8", name
    # Values, by the formulas of synthetic_trace.h.
    t = f["/time"][:]
    assert np.array_equal(t, np.arange(rows) * 1e-3)
    assert np.allclose(f["/handle/position"][:, 1], 4 - 0.5 * t, rtol=0, atol=1e-15)
    turning = f["/rotation_rate"][:] > 0
    assert np.allclose(f["/power"][turning],  # W = 2 pi (rev/s) (mN*m) / 1000
                       2 * np.pi * 100 * f["/torque"][turning] * 1e-3, rtol=1e-12)
    q = f["/handle/orientation"][:]  # x, y, z, w: axis (1, 2, 3), w = cos of half the angle
    assert np.allclose(q[0, :3] / q[0, 0], [1, 2, 3]) and np.isclose(q[0, 3], np.cos(0.15))
