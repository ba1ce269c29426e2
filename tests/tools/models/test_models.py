"""glTF and 3MF of a prepared molar, read by what the standards say, against the PLY of the same tooth.

Usage: test_models.py BINARY
"""
import io
import json
import os
import struct
import sys
import unittest
import xml.etree.ElementTree as xml
import zipfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest  # noqa: E402

TISSUES = {1: "enamel", 2: "dentin", 3: "pulp", 4: "other"}
CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
GL_FLOAT, GL_UNSIGNED_INT, GL_ARRAY_BUFFER, GL_ELEMENT_ARRAY_BUFFER, GL_TRIANGLES = 5126, 5125, 34962, 34963, 4


def ply(content):
    """Vertices, triangles, tissue of each triangle."""
    header, body = content.split(b"end_header\n", 1)
    counts = [int(line.split()[2]) for line in header.decode().splitlines() if line.startswith("element")]
    vertices = np.frombuffer(body, dtype=[("at", "<f4", 3), ("tissue", "u1"), ("colour", "u1", 3)], count=counts[0])
    faces = np.frombuffer(body, dtype=[("size", "u1"), ("corner", "<u4", 3), ("tissue", "u1")], count=counts[1],
                          offset=vertices.nbytes)
    return vertices["at"], faces["corner"], faces["tissue"]


def chunks(glb):
    """JSON and numbers of a binary glTF."""
    magic, version, length = struct.unpack_from("<4sII", glb)
    assert (magic, version, length) == (b"glTF", 2, len(glb)), (magic, version, length)
    found, offset = [], 12
    while offset < length:
        size, kind = struct.unpack_from("<I4s", glb, offset)
        assert size % 4 == 0
        found.append((kind, glb[offset + 8:offset + 8 + size]))
        offset += 8 + size
    assert [kind for kind, _ in found] == [b"JSON", b"BIN\0"]
    return json.loads(found[0][1]), found[1][1]


def volume(vertices, triangles):
    """By the divergence theorem."""
    a, b, c = (vertices[triangles[:, k]].astype(float) - vertices[0].astype(float) for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def is_closed(triangles):
    """Every edge is that of one triangle, and its opposite that of one other."""
    edges = [(a, b) for t in triangles.tolist() for a, b in zip(t, t[1:] + t[:1])]
    return len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)


def linear(srgb):
    """IEC 61966-2-1."""
    return srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4


def sets(triangles):
    return sorted(tuple(t) for t in triangles.tolist())


class Models(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        # The pulp is opened, so that all three tissues lie in the surface.
        cls.run_ok("specimen", "molar", "--voxel-mm", "0.3", "-o", "molar.vdb")
        cls.write("path.toml", 'start_mm = [6.2, 5.4, 19.5]\naxis = [0, 0, 1]\nrate_hz = 100\n[[segment]]\nkind = "line"\n'
                               'to_mm = [6.2, 5.4, 10]\nspeed_mm_s = 10\n')
        cls.write("free.toml", "[handpiece]\nstall_torque_mnm = inf\n")
        cls.run_ok("replay", "--tooth", "molar.vdb", "--trajectory", "path.toml", "--bur", "cylinder:D1.6xL9", "--drive",
                   "direct", "--params", "free.toml", "--prepared", "cut.vdb", "-o", "trace.h5")
        for extension in ("ply", "glb", "3mf"):
            cls.run_ok("mesh", "cut.vdb", "-o", "cut." + extension)
        cls.vertices, cls.triangles, cls.labels = ply(cls.read("cut.ply"))

    def by_tissue(self):
        """The PLY's triangles by their tissue."""
        return {TISSUES[label]: self.triangles[self.labels == label] for label in np.unique(self.labels)}

    def array(self, gltf, numbers, index):
        """An accessor's values, as the standard lays them out."""
        accessor = gltf["accessors"][index]
        view = gltf["bufferViews"][accessor["bufferView"]]
        kind, size = {GL_FLOAT: ("<f4", 4), GL_UNSIGNED_INT: ("<u4", 4)}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        self.assertEqual(view["byteOffset"] % size, 0)
        self.assertEqual(view["byteLength"], accessor["count"] * width * size)
        self.assertLessEqual(view["byteOffset"] + view["byteLength"], gltf["buffers"][0]["byteLength"])
        values = np.frombuffer(numbers, kind, accessor["count"] * width, view["byteOffset"]).reshape(-1, width)
        if "min" in accessor:
            self.assertEqual(accessor["min"], values.min(axis=0).astype(float).tolist())
            self.assertEqual(accessor["max"], values.max(axis=0).astype(float).tolist())
        return values, view["target"]

    def test_a_replay_writes_the_mesh_of_what_it_prepared(self):
        for extension in ("ply", "glb"):
            with self.subTest(extension):
                self.run_ok("replay", "--tooth", "molar.vdb", "--trajectory", "path.toml", "--bur", "cylinder:D1.6xL9", "--drive",
                            "direct", "--params", "free.toml", "--mesh", "at-once." + extension, "-o", "again.h5", "--force")
                self.assertEqual(self.read("at-once." + extension), self.read("cut." + extension))

    def test_of_a_tooth_that_is_cut_away_a_replay_leaves_no_mesh_and_no_other_output(self):
        self.run_ok("specimen", "block", "--size-mm", "0.8,0.8,0.8", "--enamel-mm", "0.4", "--voxel-mm", "0.1", "-o", "crumb.vdb")
        self.write("away.toml", 'start_mm = [0, 2, -1]\nrate_hz = 1000\n[[segment]]\nkind = "line"\nto_mm = [0, -2, -1]\n'
                                'speed_mm_s = 10\n')
        replay = ("replay", "--tooth", "crumb.vdb", "--trajectory", "away.toml", "--bur", "cylinder:D2xL3", "--drive", "direct",
                  "--params", "free.toml", "--prepared", "nothing.vdb", "-o", "away.h5")
        before = set(os.listdir(self.folder))
        refused = self.run_tool(*replay, "--mesh", "nothing.ply")
        self.assertEqual(refused.returncode, 1, refused.stderr)
        self.assertIn("--mesh: nothing remains of the tooth, so there is no surface; leave the option out", refused.stderr)
        self.assertEqual(set(os.listdir(self.folder)), before)
        self.run_ok(*replay)
        self.assertEqual(set(os.listdir(self.folder)), before | {"nothing.vdb", "away.h5"})

    def test_the_specimen_shows_three_tissues(self):
        self.assertEqual(set(self.by_tissue()), {"enamel", "dentin", "pulp"})
        self.assertTrue(is_closed(self.triangles))

    def test_gltf_holds_the_surface_of_the_ply_in_a_mesh_for_each_tissue(self):
        gltf, numbers = chunks(self.read("cut.glb"))
        self.assertEqual(gltf["asset"]["version"], "2.0")
        self.assertEqual(len(gltf["buffers"]), 1)
        self.assertNotIn("uri", gltf["buffers"][0])
        self.assertLess(len(numbers) - gltf["buffers"][0]["byteLength"], 4)
        root = gltf["nodes"][gltf["scenes"][gltf["scene"]]["nodes"][0]]
        found = {}
        for child in root["children"]:
            node = gltf["nodes"][child]
            (primitive,) = gltf["meshes"][node["mesh"]]["primitives"]
            self.assertEqual(primitive["mode"], GL_TRIANGLES)
            self.assertEqual(gltf["materials"][primitive["material"]]["name"], node["name"])
            vertices, target = self.array(gltf, numbers, primitive["attributes"]["POSITION"])
            self.assertEqual(target, GL_ARRAY_BUFFER)
            self.assertIn("min", gltf["accessors"][primitive["attributes"]["POSITION"]])
            np.testing.assert_array_equal(vertices, self.vertices)
            indices, target = self.array(gltf, numbers, primitive["indices"])
            self.assertEqual(target, GL_ELEMENT_ARRAY_BUFFER)
            found[node["name"]] = indices.reshape(-1, 3)
        expected = self.by_tissue()
        self.assertEqual(list(found), list(expected))
        for name, triangles in expected.items():
            np.testing.assert_array_equal(found[name], triangles)
        together = np.concatenate(list(found.values()))
        self.assertTrue(is_closed(together))
        self.assertAlmostEqual(volume(self.vertices, together) / volume(self.vertices, self.triangles), 1, places=9)

    def test_gltf_is_in_metres_with_superior_up_and_anterior_in_front(self):
        gltf, _ = chunks(self.read("cut.glb"))
        root = gltf["nodes"][gltf["scenes"][gltf["scene"]]["nodes"][0]]
        x, y, z, w = root["rotation"]
        self.assertAlmostEqual(x * x + y * y + z * z + w * w, 1, places=12)
        turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                         [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                         [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
        left, posterior, superior = np.eye(3)
        placed = 0.001 * np.eye(3)  # 1 mm to the left, upward, forward
        self.assertEqual(root["scale"], [0.001] * 3)
        for vector, expected in zip((left, superior, -posterior), placed):
            np.testing.assert_allclose(turn @ (np.array(root["scale"]) * vector), expected, atol=1e-15)

    def test_3mf_holds_the_surface_of_the_ply_with_a_material_for_each_tissue(self):
        with zipfile.ZipFile(io.BytesIO(self.read("cut.3mf"))) as package:
            self.assertIsNone(package.testzip())
            self.assertEqual(package.namelist(), ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"])
            types, relations, model = (xml.fromstring(package.read(name)) for name in package.namelist())
        self.assertEqual({child.get("Extension") for child in types}, {"rels", "model"})
        self.assertEqual([child.get("Target") for child in relations], ["/3D/3dmodel.model"])
        self.assertEqual(model.tag, CORE + "model")
        self.assertEqual(model.get("unit"), "millimeter")
        (item,) = model.findall(f"{CORE}build/{CORE}item")
        self.assertIsNone(item.get("transform"))
        (body,) = model.findall(f"{CORE}resources/{CORE}object")
        self.assertEqual(item.get("objectid"), body.get("id"))
        (materials,) = model.findall(f"{CORE}resources/{CORE}basematerials")
        self.assertEqual(body.get("pid"), materials.get("id"))
        names = [base.get("name") for base in materials]
        vertices = np.array([[np.float32(v.get(axis)) for axis in "xyz"] for v in body.iter(CORE + "vertex")])
        np.testing.assert_array_equal(vertices, self.vertices)
        rows = np.array([[int(t.get(key)) for key in ("v1", "v2", "v3", "p1")] for t in body.iter(CORE + "triangle")])
        np.testing.assert_array_equal(rows[:, :3], self.triangles)
        self.assertEqual({t.get("pid") for t in body.iter(CORE + "triangle")}, {materials.get("id")})
        expected = self.by_tissue()
        self.assertEqual(names, list(expected))
        for index, name in enumerate(names):
            np.testing.assert_array_equal(rows[rows[:, 3] == index, :3], expected[name])

    def test_both_have_the_same_colours(self):
        gltf, _ = chunks(self.read("cut.glb"))
        with zipfile.ZipFile(io.BytesIO(self.read("cut.3mf"))) as package:
            model = xml.fromstring(package.read("3D/3dmodel.model"))
        colours = {base.get("name"): bytes.fromhex(base.get("displaycolor")[1:]) for base in model.iter(CORE + "base")}
        for material in gltf["materials"]:
            pbr = material["pbrMetallicRoughness"]
            self.assertEqual(pbr["metallicFactor"], 0)
            self.assertEqual(pbr["baseColorFactor"][3], 1)
            for factor, level in zip(pbr["baseColorFactor"], colours.pop(material["name"])):
                low, high = linear(max(level - 0.51, 0) / 255), linear(min(level + 0.51, 255) / 255)  # 8 bits
                self.assertTrue(low <= factor <= high, (material["name"], factor, level))
        self.assertEqual(colours, {})

    def test_bytes_are_the_same_in_any_time_zone(self):
        for extension in ("glb", "3mf"):
            for zone in ("UTC-14", "UTC+12"):
                self.run_ok("mesh", "cut.vdb", "-o", "again." + extension, "--force",
                            env={**os.environ, "TZ": zone, "LC_ALL": "de_DE.UTF-8"})
                self.assertEqual(self.read("again." + extension), self.read("cut." + extension))
        with zipfile.ZipFile(io.BytesIO(self.read("cut.3mf"))) as package:
            self.assertEqual({entry.date_time for entry in package.infolist()}, {(1980, 1, 1, 0, 0, 0)})

    def test_obj_and_vtk_hold_the_triangles_of_each_tissue(self):
        for extension in ("obj", "vtk"):
            self.run_ok("mesh", "cut.vdb", "-o", "cut." + extension, "--force")
        found, name = {}, None
        for line in self.read("cut.obj").decode().splitlines():
            words = line.split()
            if words[0] == "g":
                name = words[1]
            elif words[0] == "f":
                found.setdefault(name, []).append([int(word) - 1 for word in words[1:]])
        expected = self.by_tissue()
        self.assertEqual(list(found), list(expected))
        for tissue, triangles in expected.items():
            np.testing.assert_array_equal(found[tissue], triangles)
        data = self.read("cut.vtk").split(b"CELL_DATA %d\n" % len(self.triangles), 1)[1]
        data = data.split(b"LOOKUP_TABLE default\n", 1)[1]
        np.testing.assert_array_equal(np.frombuffer(data, "u1", len(self.triangles)), self.labels)

    def test_lines_are_the_margin_the_line_angles_and_the_borders_of_tissues(self):
        self.run_ok("mesh", "cut.vdb", "-o", "with.ply", "--lines", "lines.obj")
        self.assertEqual(self.read("with.ply"), self.read("cut.ply"))
        points, lines, name = [], {}, None
        for line in self.read("lines.obj").decode().splitlines():
            words = line.split()
            if words[0] == "v":
                points.append([np.float32(word) for word in words[1:]])
            elif words[0] == "g":
                name = words[1]
            elif words[0] == "l":
                lines.setdefault(name, []).append([int(word) - 1 for word in words[1:]])
        self.assertEqual(list(lines), ["margin", "line_angles", "enamel_dentin", "dentin_pulp"])
        of_mesh = {tuple(at) for at in self.vertices.tolist()}
        self.assertTrue({tuple(np.array(at).tolist()) for at in points} <= of_mesh)
        for closed in ("margin", "enamel_dentin", "dentin_pulp"):
            for line in lines[closed]:
                self.assertEqual(line[0], line[-1], closed)
        # One bur's width around a straight hole.
        margin = np.array(points)[lines["margin"][0]]
        self.assertAlmostEqual(np.hypot(margin[:, 0] - 6.2, margin[:, 1] - 5.4).mean(), 0.8, delta=0.05)
        refused = self.run_tool("mesh", "cut.vdb", "-o", "no.ply", "--lines", "no.obj", "--tissue", "enamel")
        self.assertEqual(refused.returncode, 1)
        self.assertIn("--tissue", refused.stderr)

    def test_one_tissue_is_one_closed_mesh(self):
        self.run_ok("mesh", "cut.vdb", "--tissue", "enamel", "-o", "enamel.ply")
        self.run_ok("mesh", "cut.vdb", "--tissue", "enamel", "-o", "ENAMEL.GLB")
        vertices, triangles, _ = ply(self.read("enamel.ply"))
        gltf, numbers = chunks(self.read("ENAMEL.GLB"))
        self.assertEqual(gltf["accessors"][0]["count"], len(vertices))
        together = np.concatenate([self.array(gltf, numbers, mesh["primitives"][0]["indices"])[0].reshape(-1, 3)
                                   for mesh in gltf["meshes"]])
        self.assertTrue(is_closed(together))
        self.assertEqual(sets(together), sets(triangles))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
