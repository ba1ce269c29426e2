"""A tooth file as a Python user meets it. Arguments: FILE VOXEL_MM VOLUME_MM3 SHA256."""
import sys

import numpy as np
import pyopenvdb as vdb

path, voxel, volume, sha256 = sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), sys.argv[4]
meta = vdb.readMetadata(path)
assert meta["toothprep_schema"] == "toothprep-tooth", meta
assert meta["toothprep_schema_version"] == 1, meta
assert meta["tooth_sha256"] == sha256, meta
assert meta["source_sha256"] == "a" * 64, meta

for name in ("solid", "enamel", "dentin", "pulp"):
    grid = vdb.read(path, name)
    assert grid.gridClass == vdb.GridClass.LEVEL_SET, (name, grid.gridClass)
    assert np.allclose(grid.transform.voxelSize(), voxel, rtol=1e-12), name
    assert grid["toothprep_schema"] == "toothprep-tooth"
    assert abs(grid.background - 3 * voxel) < 1e-6

# The volume of the solid, by the same second-order sum over voxels, from the dense array.
grid = vdb.read(path, "solid")
low, high = (np.array(c) for c in grid.evalActiveVoxelBoundingBox())
phi = np.empty(high - low + 1, np.float32)
grid.copyToArray(phi, ijk=tuple(int(c) for c in low))
found = voxel ** 3 * np.clip(0.5 - phi.astype(float) / voxel, 0, 1).sum()
assert abs(found - volume) < 1e-6 * volume, (found, volume)
