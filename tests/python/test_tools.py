"""The long calls against the commands: the same figures, progress, files whole or not at all."""
import json
import os

import numpy as np
import toothprep
from module_test import CommandTest, main

BUR = "cylinder:D1.2xL3.0"


def without(figures, *keys):
    return {key: value for key, value in figures.items() if key not in keys}


class Tools(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "scan", "-o", "scan.nrrd", "--labels", "labels.nrrd", "--spacing-mm", "0.3")
        os.chdir(cls.folder)

    def test_voxelize_is_the_command(self):
        done = self.run_ok("voxelize", "scan.nrrd", "-o", "tooth.vdb", "--voxel-mm", "0.3", "--json")
        stages = []
        made = toothprep.voxelize("scan.nrrd", "python.vdb", voxel_mm=0.3,
                                  progress=lambda stage, part: stages.append((stage, part)))
        theirs = json.loads(done.stdout)
        self.assertEqual(without(made, "seconds", "tooth"), without(theirs, "seconds", "tooth"))
        self.assertEqual(made["tooth"], "python.vdb")
        self.assertEqual(self.read("python.vdb"), self.read("tooth.vdb"))
        self.assertEqual(made.tooth.sha256, theirs["tooth_sha256"])
        self.assertTrue(all(0 <= part <= 1 for _, part in stages))

    def test_voxelize_labels_is_the_command(self):
        done = self.run_ok("voxelize", "labels.nrrd", "--labels", "enamel=1,dentin=2,pulp=3", "-o", "l.vdb",
                           "--voxel-mm", "0.3", "--json")
        made = toothprep.voxelize("labels.nrrd", labels={"enamel": 1, "dentin": 2, "pulp": 3}, voxel_mm=0.3)
        self.assertEqual(without(made, "seconds", "tooth"), without(json.loads(done.stdout), "seconds", "tooth"))
        self.assertIsNone(made["tooth"])

    def test_of_several_teeth_one_is_taken_and_others_are_neighbours_as_the_command_has_it(self):
        labels = np.zeros((20, 20, 44), dtype=np.uint8)  # z, y, x
        labels[4:18, 4:16, 4:18] = 2
        labels[4:14, 4:16, 26:40] = 2
        self.write_volume("two.nrrd", labels, 0.3)
        command = ("voxelize", "two.nrrd", "--labels", "dentin=2", "--voxel-mm", "0.3")
        self.run_ok(*command, "--tooth", "2", "--neighbour", "37=1", "-o", "pair.vdb")
        self.run_ok(*command, "--tooth", "2", "-o", "one.vdb")
        for neighbours, file in (({"37": (3.3, 3, 3)}, "pair.vdb"), (None, "one.vdb")):
            with self.assertWarnsRegex(UserWarning, "took tooth 2 of 2"):
                made = toothprep.voxelize("two.nrrd", labels={"dentin": 2}, voxel_mm=0.3, tooth=2, neighbours=neighbours)
            theirs = toothprep.load(file)
            self.assertEqual(made.tooth.sha256, theirs.sha256)
            self.assertEqual(made.tooth.bodies, theirs.bodies)
        self.run_ok("mesh", "pair.vdb", "-o", "pair.stl")
        volume = toothprep.voxelize(meshes={"dentin": "pair.stl"}, tooth=2, voxel_mm=0.3)["volume_mm3"]["dentin"]
        self.assertAlmostEqual(volume, 10 * 12 * 14 * 0.3**3, delta=1.5)

    def test_voxelize_meshes_is_the_command(self):
        toothprep.block(size_mm=3, enamel_mm=1, voxel_mm=0.2).save("block.vdb")
        for tissue in ("enamel", "dentin"):
            self.run_ok("mesh", "block.vdb", "--tissue", tissue, "-o", f"{tissue}.stl", "--force")
        done = self.run_ok("voxelize", "--mesh", "enamel=enamel.stl", "--mesh", "dentin=dentin.stl", "-o", "m.vdb",
                           "--voxel-mm", "0.2", "--json")
        made = toothprep.voxelize(meshes={"enamel": "enamel.stl", "dentin": "dentin.stl"}, voxel_mm=0.2)
        self.assertEqual(without(made, "seconds", "tooth"), without(json.loads(done.stdout), "seconds", "tooth"))

    def test_voxelize_refuses_what_is_no_scan_and_writes_nothing(self):
        self.write("noise.nrrd", "NRRD0004\n")
        with self.assertRaises(toothprep.Error) as raised:
            toothprep.voxelize("noise.nrrd", "noise.vdb")
        self.assertEqual(raised.exception.file, "noise.nrrd")
        self.assertFalse(os.path.exists("noise.vdb"))

    def test_calibrate_is_the_command_and_finds_the_truth(self):
        tooth = toothprep.block(size_mm=6, enamel_mm=1)
        tooth.save("cal.vdb")
        time = np.arange(3000) * 0.001
        position = np.stack([-1.5 + time, -0.4 - 0.4 * time, 0.3 * np.sin(2 * time)], axis=1)
        half = np.sqrt(0.5)
        truth = {"handpiece": {"stall_torque_mnm": float("inf")},
                 "tissue": {"enamel": {"specific_energy_j_per_mm3": 0.5, "force_ratio": 0.3}}}
        session = toothprep.Session(tooth, BUR, truth, "direct", position[0], (-half, 0, 0, half))
        trace = session.run(time, position)
        trace["force/measured"] = trace["force/grinding"] + np.random.default_rng(1).normal(0, 0.01, (len(time), 3))
        trace.save("rig.h5")
        options = ["--rotation-rate-rev-s", "100", "--bootstrap", "100"]
        self.run_ok("calibrate", "--tooth", "cal.vdb", "--measured", "rig.h5", "--bur", BUR, "-o", "fit.json",
                    "--params-out", "fit.toml", *options)
        fit = toothprep.calibrate("cal.vdb", "rig.h5", BUR, rotation_rate_rev_s=100, bootstrap=100)
        self.assertEqual(fit, json.loads(self.read("fit.json")))
        self.assertEqual(fit.parameters_toml, self.read("fit.toml").decode())
        enamel = fit["tissues"]["enamel"]
        self.assertAlmostEqual(enamel["u_j_per_mm3"], 0.5, delta=0.01)
        self.assertAlmostEqual(enamel["alpha"], 0.3, delta=0.01)
        self.run_ok("calibrate", "--tooth", "cal.vdb", "--measured", "rig.h5", "--bur", BUR, "-o", "law.json",
                    "--params-out", "law.toml", "--law", "up-cutting", *options)
        by_law = toothprep.calibrate("cal.vdb", "rig.h5", BUR, rotation_rate_rev_s=100, bootstrap=100, law="up-cutting")
        self.assertEqual(by_law, json.loads(self.read("law.json")))
        self.assertEqual(by_law.parameters_toml, self.read("law.toml").decode())
        self.assertEqual([law["law"] for law in by_law["laws"]], ["paper", "up-cutting"])

    def test_score_is_the_command(self):
        tooth = toothprep.molar(voxel_mm=0.2)
        tooth.save("molar.vdb")
        session = toothprep.Session(tooth, BUR, {"handpiece": {"stall_torque_mnm": float("inf")}}, "direct",
                                    position=(6.1, 5.5, 20))
        z = np.linspace(20, 15, 400)
        for angle, height in zip(np.linspace(0, 25, 400), z):
            session.step((6.1 + 0.8 * np.sin(angle), 5.5 + 0.8 * np.cos(angle), height))
        for angle in np.linspace(0, 2 * np.pi, 400):
            session.step((6.1 + 0.8 * np.sin(angle), 5.5 + 0.8 * np.cos(angle), 15))
        session.finish()
        session.remaining().save("prepared.vdb")
        done = self.run_ok("score", "--original", "molar.vdb", "--prepared", "prepared.vdb", "-o", "score.json",
                           "--json", "--type", "class1")
        stages = []
        figures = toothprep.score("molar.vdb", "prepared.vdb", type="class1",
                                  progress=lambda stage, part: stages.append(part))
        self.assertEqual(figures, json.loads(done.stdout))
        self.assertTrue(figures["removed_mm3"]["total"] > 1)
        self.assertIn("points_percent", figures)

    def test_render_is_the_command(self):
        tooth = toothprep.block(size_mm=4, enamel_mm=1, voxel_mm=0.2)
        tooth.save("drawn.vdb")
        self.run_ok("render", "drawn.vdb", "-o", "command.png", "--size", "160x120", "--view", "buccal")
        drawn = toothprep.render(tooth, "python.png", size=(160, 120), view="buccal")
        self.assertEqual(self.read("python.png"), self.read("command.png"))
        self.assertEqual(drawn["image"].shape, (120, 160, 3))
        self.assertEqual(set(np.unique(drawn["tissue"])), {0, 1, 2})
        seen = np.isfinite(drawn["depth_mm"])
        self.assertAlmostEqual(seen.sum() * drawn["mm_per_pixel"]**2, 16, delta=0.5)  # a face of 4 x 4 mm

    def test_render_at_a_cut_is_the_command(self):
        tooth = toothprep.block(size_mm=4, enamel_mm=1, voxel_mm=0.2)
        tooth.save("cut.vdb")
        self.run_ok("render", "cut.vdb", "-o", "c.png", "--size", "160x120", "--cut", "buccal")
        toothprep.render("cut.vdb", "p.png", size=(160, 120), cut="buccal")
        self.assertEqual(self.read("p.png"), self.read("c.png"))


if __name__ == "__main__":
    main()
