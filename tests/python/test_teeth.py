"""Teeth: what a notebook gets of their grids, and what keeps what alive."""
import gc
import sys
from pathlib import Path

import numpy as np
import toothprep
from module_test import CommandTest, main

GRIDS = ("tissue", "solid", "enamel", "dentin", "pulp")


class Teeth(CommandTest):
    def test_block_has_its_volumes(self):
        tooth = toothprep.block(size_mm=8, enamel_mm=2, voxel_mm=0.1)
        self.assertAlmostEqual(tooth.volume_mm3["enamel"], 8 * 8 * 2, places=3)
        self.assertAlmostEqual(tooth.volume_mm3["dentin"], 8 * 8 * 6, places=3)
        lower, upper = tooth.bounds_mm
        np.testing.assert_allclose(lower, (-4, -8, -4), atol=1e-6)
        np.testing.assert_allclose(upper, (4, 0, 4), atol=1e-6)

    def test_block_takes_three_sizes(self):
        tooth = toothprep.block(size_mm=(2, 3, 4), enamel_mm=1, voxel_mm=0.2)
        self.assertAlmostEqual(sum(tooth.volume_mm3.values()), 24, places=3)

    def test_dense_arrays_lie_where_origin_and_voxel_say(self):
        tooth = toothprep.block(size_mm=4, enamel_mm=1, voxel_mm=0.2)
        place = tooth.origin_mm + tooth.voxel_mm * np.stack(np.indices(tooth.shape), axis=-1)
        inside = np.all((place > (-2, -4, -2)) & (place < (2, 0, 2)), axis=-1)
        np.testing.assert_array_equal(tooth.solid < 0, inside)
        np.testing.assert_array_equal(tooth.tissue == 1, inside & (place[..., 1] > -1))
        # Depth below the top face, where that is the nearest one.
        band = inside & (place[..., 1] > -0.5) & (np.abs(place[..., 0]) < 1) & (np.abs(place[..., 2]) < 1)
        np.testing.assert_allclose(tooth.solid[band], place[..., 1][band], atol=1e-6)

    def test_bricks_and_tiles_make_the_dense_array(self):
        tooth = toothprep.molar(voxel_mm=0.4)
        for name in GRIDS:
            dense = getattr(tooth, name)
            made = np.full(tooth.shape, 0 if name == "tissue" else 3 * tooth.voxel_mm, dense.dtype)
            for (i, j, k), value in zip(*tooth.tiles(name)):
                made[i:i + 8, j:j + 8, k:k + 8] = value
            indices, values = tooth.bricks(name)
            self.assertEqual(values.shape, (len(indices), 8, 8, 8))
            for (i, j, k), brick in zip(indices, values):
                made[i:i + 8, j:j + 8, k:k + 8] = brick
            np.testing.assert_array_equal(made, dense, name)

    def test_bricks_are_views_at_the_same_address_and_dense_arrays_are_copies(self):
        tooth = toothprep.molar(voxel_mm=0.4)
        for name in GRIDS:
            first, second = tooth.bricks(name)[1], tooth.bricks(name)[1]
            self.assertEqual(first.ctypes.data, second.ctypes.data)
            self.assertTrue(first.flags.c_contiguous)
            self.assertFalse(first.flags.owndata)
            self.assertFalse(first.flags.writeable)
            with self.assertRaises(ValueError):
                first[0, 0, 0, 0] = 1
        self.assertNotEqual(tooth.solid.ctypes.data, tooth.bricks("solid")[1].ctypes.data)
        self.assertTrue(tooth.solid.flags.writeable)

    def test_a_view_keeps_its_tooth_alive(self):
        tooth = toothprep.block(size_mm=2, enamel_mm=1)
        values = tooth.bricks("solid")[1]
        before = values.copy()
        alive = sys.getrefcount(tooth)
        again = tooth.bricks("solid")[1]
        self.assertEqual(sys.getrefcount(tooth), alive + 1)
        del again, tooth
        gc.collect()
        [toothprep.block(size_mm=2, enamel_mm=0.5) for _ in range(20)]  # would reuse the memory
        np.testing.assert_array_equal(values, before)

    def test_a_session_leaves_the_views_of_its_tooth_as_they_are(self):
        tooth = toothprep.block(size_mm=4, enamel_mm=2)
        values = tooth.bricks("solid")[1]
        before, hashed = values.copy(), tooth.sha256
        session = toothprep.Session(tooth, "ball:D1.2", {"handpiece": {"stall_torque_mnm": float("inf")}}, "direct",
                                    position=(0, 1, 0))
        for y in np.linspace(1, -0.5, 100):
            session.step((0, y, 0))
        session.finish()
        left = session.remaining()
        self.assertLess(left.volume_mm3["enamel"], tooth.volume_mm3["enamel"] - 0.1)
        np.testing.assert_array_equal(values, before)
        self.assertEqual(tooth.sha256, hashed)

    def test_same_tooth_same_order_of_bricks(self):
        first, second = toothprep.molar(voxel_mm=0.4), toothprep.molar(voxel_mm=0.4)
        for name in GRIDS:
            np.testing.assert_array_equal(first.bricks(name)[0], second.bricks(name)[0])

    def test_dense_size_is_checked_first(self):
        tooth = toothprep.block(size_mm=4, enamel_mm=2)
        voxels = int(np.prod(tooth.shape))
        self.assertEqual(tooth.dense("solid", limit_bytes=4 * voxels).size, voxels)
        with self.assertRaises(toothprep.SizeError) as raised:
            tooth.dense("solid", limit_bytes=4 * voxels - 1)
        self.assertIsInstance(raised.exception, toothprep.Error)
        self.assertIsInstance(raised.exception, MemoryError)
        for part in [str(n) for n in tooth.shape] + ["solid", "bricks()"]:
            self.assertIn(part, str(raised.exception))

    def test_saved_file_is_the_commands(self):
        toothprep.block().save(self.path("python.vdb"))
        self.run_ok("specimen", "block", "-o", "command.vdb")
        self.assertEqual(self.read("python.vdb"), self.read("command.vdb"))

    def test_loaded_tooth_is_the_saved_one(self):
        tooth = toothprep.molar(voxel_mm=0.4)
        tooth.save(self.path("molar.vdb"))
        loaded = toothprep.load(Path(self.path("molar.vdb")))
        self.assertEqual(loaded.sha256, tooth.sha256)
        self.assertEqual(loaded.voxel_mm, tooth.voxel_mm)
        with self.assertRaises(toothprep.Error):
            tooth.save(self.path("molar.vdb"), overwrite=False)

    def test_mesh_is_closed_and_has_the_volume(self):
        tooth = toothprep.block(size_mm=4, enamel_mm=2)
        mesh = tooth.mesh()
        corners = mesh["vertices"][mesh["triangles"]].astype(float)
        volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
        self.assertAlmostEqual(volume, 64, delta=0.3)  # edges are rounded by half a voxel
        edges = np.sort(np.concatenate([mesh["triangles"][:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]), axis=1)
        self.assertTrue((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())
        self.assertEqual(set(np.unique(mesh["tissue"])), {1, 2})


if __name__ == "__main__":
    main()
