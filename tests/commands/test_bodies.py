"""Several bodies on one lattice: made, cut, reported by name, scored.

Usage: test_bodies.py BINARY
"""
import json
import sys
import unittest
from pathlib import Path

import h5py
import numpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import CommandTest  # noqa: E402

# From the outside of the contact through the distal marginal ridge of 36 into 37, 0.2 mm behind it (y = 10.7).
PATH = """start_mm = [6.1, 8.5, 19.5]
axis = [0, 0, 1]
[[segment]]
kind = "line"
to_mm = [6.1, 8.5, 15.8]
speed_mm_s = 4
[[segment]]
kind = "line"
to_mm = [6.1, {end}, 15.8]
speed_mm_s = 2
[[segment]]
kind = "line"
to_mm = [6.1, {end}, 21]
speed_mm_s = 10
"""


class Bodies(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "molar", "-o", "pair.vdb", "--neighbours", "1", "--gum", "--gap-mm", "0.2", "--voxel-mm", "0.2")
        cls.write("strong.toml", "[handpiece]\nstall_torque_mnm = inf\n")
        cls.write("into.toml", PATH.format(end=11.2))
        cls.write("short.toml", PATH.format(end=9.2))
        cls.into = cls.replay("into")
        cls.short = cls.replay("short")

    @classmethod
    def replay(cls, name):
        done = cls.run_ok("replay", "--tooth", "pair.vdb", "--bur", "cylinder:D1.2xL4.0", "--drive", "direct", "--trajectory",
                          name + ".toml", "--params", "strong.toml", "-o", name + ".h5", "--prepared", name + ".vdb", "--json")
        return json.loads(done.stdout), done.stderr

    def score(self, name):
        self.run_ok("score", "--original", "pair.vdb", "--prepared", name + ".vdb", "--type", "class2", "--trace", name + ".h5",
                    "-o", name + ".json", "--force")
        return json.loads(self.read(name + ".json"))

    def test_info_lists_them_by_name(self):
        for file in ("pair.vdb", "into.vdb"):
            bodies = json.loads(self.run_ok("info", file, "--json").stdout)["bodies"]
            self.assertEqual({name: body["kind"] for name, body in bodies.items()},
                             {"36": "tooth", "37": "neighbour", "gum": "gum"})
        self.assertGreater(bodies["37"]["volume_mm3"], 500)

    def test_a_cut_neighbour_is_named(self):
        report, talk = self.into
        self.assertIn("the neighbour 37 was cut from", talk)
        self.assertTrue(any("the neighbour 37 was cut" in text for text in report["outcome"]))
        neighbour = report["bodies"]["37"]
        self.assertGreater(neighbour["contact_steps"], 50)
        self.assertGreater(neighbour["removed_mm3"], 0.3)
        self.assertEqual(report["bodies"]["gum"]["removed_mm3"], 0)
        self.assertAlmostEqual(sum(body["removed_mm3"] for body in report["bodies"].values()),
                               sum(report["removed_mm3"].values()), places=6)
        refused = self.run_tool("replay", "--tooth", "pair.vdb", "--bur", "cylinder:D1.2xL4.0", "--drive", "direct",
                                "--params", "strong.toml", "--trajectory", "into.toml", "-o", "strict.h5", "--strict")
        self.assertEqual(refused.returncode, 1)

    def test_a_bur_that_stays_within_its_tooth_touches_none(self):
        report, talk = self.short
        self.assertNotIn("neighbour", talk)
        self.assertEqual(report["bodies"]["37"]["contact_steps"], 0)
        self.assertEqual(report["bodies"]["37"]["removed_mm3"], 0)
        self.assertGreater(report["bodies"]["36"]["removed_mm3"], 1)

    def test_the_trace_has_the_contact_of_each(self):
        with h5py.File(self.path("into.h5")) as trace:
            areas = trace["contact/body_area"]
            self.assertEqual(list(areas.attrs["bodies"]), ["36", "37", "gum"])
            self.assertEqual(areas.attrs["units"], "mm^2")
            numpy.testing.assert_allclose(areas[:].sum(axis=1), trace["contact/area"][:].sum(axis=1), rtol=1e-12, atol=1e-15)
            self.assertEqual(int((areas[:, 1] > 0).sum()), self.into[0]["bodies"]["37"]["contact_steps"])
        self.run_ok("export", "into.h5", "-o", "into.csv", "--force")
        self.assertIn("contact_body_37_mm2", self.read("into.csv").decode().split("\n", 1)[0])

    def test_a_file_without_bodies_has_neither_key_nor_dataset(self):
        self.run_ok("specimen", "molar", "-o", "alone.vdb", "--voxel-mm", "0.3")
        self.assertNotIn("bodies", json.loads(self.run_ok("info", "alone.vdb", "--json").stdout))
        done = self.run_ok("replay", "--tooth", "alone.vdb", "--bur", "cylinder:D1.2xL4.0", "--drive", "direct", "--trajectory",
                           "short.toml", "-o", "alone.h5", "--json")
        self.assertNotIn("bodies", json.loads(done.stdout))
        with h5py.File(self.path("alone.h5")) as trace:
            self.assertNotIn("body_area", trace["contact"])

    def test_score_reports_the_damage_of_each(self):
        sheet = self.score("into")
        removed = self.into[0]["bodies"]["37"]["removed_mm3"]
        self.assertAlmostEqual(sheet["body_removed_mm3"]["37"], removed, delta=0.01 * removed)
        self.assertEqual(sheet["neighbour_damage_mm3"], sheet["body_removed_mm3"]["37"])
        self.assertEqual(sheet["gum_damage_mm3"], 0)
        own = self.into[0]["bodies"]["36"]["removed_mm3"]
        self.assertAlmostEqual(sheet["removed_mm3"]["total"], own, delta=0.01 * own)
        # The cylinder's end goes to y = 11.2 + 0.6; the neighbour begins 0.2 mm behind 36, at about 10.9.
        self.assertAlmostEqual(sheet["neighbour_depth_mm"], 0.9, delta=0.3)
        steps = self.into[0]["bodies"]["37"]["contact_steps"]
        self.assertAlmostEqual(sheet["process"]["body_contact_s"]["37"], steps * 1e-3, places=6)
        self.assertAlmostEqual(sheet["process"]["neighbour_contact_s"], steps * 1e-3, places=6)
        self.assertEqual(self.score("short")["neighbour_damage_mm3"], 0)

    def test_a_class_2_is_planned_around_the_neighbour_and_a_crown_that_would_cut_it_refused(self):
        prepare = ("prepare", "--tooth", "pair.vdb", "--json", "--force", "-o")
        done = self.run_ok(*prepare, "box.toml", "--type", "class2", "--side", "distal", "--bur", "57")
        plan = json.loads(done.stdout)
        self.assertEqual(plan["nearest_other"], "37")
        self.assertAlmostEqual(plan["least_to_other_mm"], 0.1, delta=0.02)  # --clear-mm
        self.assertIn("0.10 mm stay between the bur and what must not be touched", "\n".join(plan["facts"]))
        near = json.loads(self.run_ok(*prepare, "box.toml", "--type", "class2", "--side", "distal", "--bur", "57", "--clear-mm",
                                      "0.02").stdout)
        self.assertAlmostEqual(near["least_to_other_mm"], 0.02, delta=0.02)
        refused = self.run_tool(*prepare, "crown.toml", "--type", "crown")
        self.assertEqual(refused.returncode, 1)
        self.assertRegex(refused.stderr, "this preparation would cut 37 at .* mm, by .* mm; .*--allow-contact")
        self.assertFalse(Path(self.path("crown.toml")).exists())
        warned = self.run_ok(*prepare, "crown.toml", "--type", "crown", "--allow-contact")
        self.assertIn("warning: pair.vdb: this preparation would cut 37 at", warned.stderr)

    def test_a_path_into_the_neighbour_is_warned_of(self):
        place = ("place", "--tooth", "pair.vdb", "--bur", "cylinder:D1.2xL4.0", "--from", "pair.vdb", "--json", "--trajectory")
        into = self.run_ok(*place, "into.toml")
        self.assertIn("the path cuts 37 at", into.stderr)
        # The cylinder's end goes to y = 11.2 + 0.6; the neighbour begins at about 10.9.
        self.assertAlmostEqual(json.loads(into.stdout)["least_to_other_mm"], -0.9, delta=0.3)
        self.assertNotIn("cuts", self.run_ok(*place, "short.toml").stderr)

    def test_bad_numbers_are_refused(self):
        for words in (["--neighbours", "14"], ["--neighbours", "1", "--gap-mm", "5"]):
            refused = self.run_tool("specimen", "molar", "-o", "no.vdb", *words)
            self.assertEqual(refused.returncode, 1)
            self.assertIn("not within", refused.stderr)

    def bodies_of(self, file):
        return json.loads(self.run_ok("info", file, "--json").stdout)["bodies"]

    def test_a_segmentation_says_whose_values_are_whose(self):
        labels = numpy.zeros((16, 20, 40), dtype=numpy.uint8)  # z, y, x
        for first, enamel, dentin in ((4, 2, 3), (22, 5, 6)):
            labels[4:12, 4:16, first:first + 14] = dentin
            labels[9:12, 4:16, first:first + 14] = enamel
        self.write_volume("labels.nrrd", labels, 0.25)
        values = "enamel=2,dentin=3,enamel=5,dentin=6"
        self.run_ok("voxelize", "labels.nrrd", "--labels", values, "--body", "37=5,6", "--voxel-mm", "0.25", "-o", "labels.vdb")
        bodies = self.bodies_of("labels.vdb")
        self.assertEqual({name: body["kind"] for name, body in bodies.items()}, {"tooth": "tooth", "37": "neighbour"})
        for body in bodies.values():
            self.assertAlmostEqual(body["volume_mm3"], 8 * 12 * 14 * 0.25**3, delta=0.6)  # rounded edges
        for wrong in ("37=7", "37", "37:crown=5", "37=5 --body gum=5"):
            refused = self.run_tool("voxelize", "labels.nrrd", "--labels", values, "--body", *wrong.split(), "-o", "no.vdb")
            self.assertEqual(refused.returncode, 2, wrong)
            self.assertIn("--body", refused.stderr)

    def test_neighbours_are_chosen_as_the_tooth_is(self):
        # Two teeth of the same values, the first a little longer: blocks of dentin with enamel on them.
        voxel, tall = 0.2, (40, 34)
        labels = numpy.zeros((48, 44, 88), dtype=numpy.uint8)  # z, y, x
        for first, top in zip((6, 48), tall):
            labels[4:top, 6:38, first:first + 32] = 3
            labels[top - 8:top, 6:38, first:first + 32] = 2
        volumes = [(top - 4) * 32 * 32 * voxel**3 for top in tall]
        self.write_volume("two.nrrd", labels, voxel)
        # A scan: greys between the classes at the borders, as a scanner's blur makes them.
        grey = numpy.array([20, 0, 210, 120])[labels].astype(float)
        for axis in range(3):
            for _ in range(2):
                grey = (numpy.roll(grey, 1, axis) + 2 * grey + numpy.roll(grey, -1, axis)) / 4
        noise = numpy.random.default_rng(1).normal(0, 2, grey.shape)
        self.write_volume("grey.nrrd", numpy.clip(grey + noise, 0, 255), voxel)
        of_labels = ("voxelize", "two.nrrd", "--labels", "enamel=2,dentin=3", "--voxel-mm", repr(voxel))
        of_greys = ("voxelize", "grey.nrrd", "--voxel-mm", repr(voxel))
        self.run_ok(*of_labels, "-o", "all.vdb")
        self.run_ok("mesh", "all.vdb", "-o", "arch.stl")
        of_mesh = ("voxelize", "--mesh", "arch.stl", "--enamel-mm", "0.8", "--voxel-mm", repr(voxel))
        place = "12.8,4.4,3"  # in the second one
        for n, command in enumerate((of_labels, of_greys, of_mesh)):
            for tooth, neighbour in (("1", "2"), (place, "1"), ("1", place)):
                self.run_ok(*command, "--tooth", tooth, "--neighbour", "37=" + neighbour, "-o", "two.vdb", "--force")
                bodies = self.bodies_of("two.vdb")
                self.assertEqual({name: body["kind"] for name, body in bodies.items()}, {"tooth": "tooth", "37": "neighbour"})
                expected = volumes if tooth == "1" else volumes[::-1]
                for name, volume in zip(("tooth", "37"), expected):
                    self.assertAlmostEqual(bodies[name]["volume_mm3"], volume, delta=0.03 * volume, msg=(n, tooth, name))
            same = self.run_tool(*command, "--tooth", place, "--neighbour", "37=2", "-o", "no.vdb")
            self.assertEqual(same.returncode, 1)
            self.assertIn("'37' is the same tooth as 'tooth'", same.stderr)
            self.assertFalse(Path(self.path("no.vdb")).exists())
        for wrong in ("37", "37=0", "37=1,2", "=2", "tooth=2"):
            refused = self.run_tool(*of_labels, "--tooth", "1", "--neighbour", wrong, "-o", "no.vdb")
            self.assertEqual(refused.returncode, 2, wrong)
            self.assertIn("--neighbour", refused.stderr)
        self.assertEqual(self.run_tool(*of_labels, "--neighbour", "37=2", "-o", "no.vdb").returncode, 2)  # no --tooth


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
