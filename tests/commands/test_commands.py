"""Runs the toothprep binary as a user does: the chain from CT to mesh, exit codes, refusals, repeatability.

Usage: test_commands.py BINARY SOURCE_DIR
"""
import json
import os
import re
import shutil
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from command_test import CommandTest

SOURCE = os.path.abspath(sys.argv[2])
CYLINDER = "cylinder:D1.2xL3.0"


class Commands(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--size-mm", "5,4,5", "--enamel-mm", "1.5")
        for name, speed in (("slot.toml", 1), ("quick.toml", 10)):
            cls.write(name, 'start_mm = [0, 0.9, -0.4]\naxis = [0, 0, 1]\nrate_hz = 1000\n'
                      f'[[segment]]\nkind = "line"\nto_mm = [0, -2.2, -0.4]\nspeed_mm_s = {speed}\n')

    def assert_refused(self, *args, output, says):
        """Exit 1, one line that names the problem, nothing on stdout, no output file or remains of one."""
        before = set(os.listdir(self.folder))
        done = self.run_tool(*args)
        self.assertEqual(done.returncode, 1, f"{args}: {done.stderr}")
        errors = [line for line in done.stderr.splitlines() if not line.startswith("warning: ")]
        self.assertEqual(len(errors), 1, f"{args}: {done.stderr}")
        self.assertIn(says, errors[0])
        self.assertEqual(done.stdout, "")
        self.assertEqual(set(os.listdir(self.folder)), before, f"{args} left something behind")
        if output:
            self.assertFalse(os.path.exists(self.path(output)))

    def replay(self, output, *extra):
        return self.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "slot.toml", "--bur", CYLINDER,
                           "-o", output, "--json", *extra)

    def test_chain_from_ct_to_mesh(self):
        self.run_ok("specimen", "scan", "-o", "ct", "--spacing-mm", "0.3", "--labels", "labels.nrrd")
        self.run_ok("voxelize", "ct", "-o", "tooth.vdb", "--voxel-mm", "0.2")
        info = json.loads(self.run_ok("info", "tooth.vdb", "--json").stdout)
        # The molar's own volumes (specimen molar --voxel-mm 0.1): 246, 599 and 46 mm^3; a 0.3 mm scan keeps
        # the hard tissues to a few per cent.
        self.assertAlmostEqual(info["volume_mm3"]["enamel"], 246, delta=20)
        self.assertAlmostEqual(info["volume_mm3"]["dentin"], 599, delta=30)
        self.assertAlmostEqual(info["voxel_mm"], 0.2)
        self.run_ok("voxelize", "labels.nrrd", "-o", "from_labels.vdb", "--voxel-mm", "0.2", "--labels",
                    "enamel=1,dentin=2,pulp=3")
        done = self.run_ok("replay", "--tooth", "tooth.vdb", "--trajectory",
                           os.path.join(SOURCE, "data/trajectories/class1-molar.toml"), "--bur", CYLINDER,
                           "--prepared", "prepared.vdb", "-o", "cavity.h5", "--json")
        figures = json.loads(done.stdout)
        for key in ("steps", "seconds_simulated", "realtime_factor", "step_us_p50", "step_us_p99", "step_us_max",
                    "peak_force_n", "stalled_steps", "removed_mm3", "energy_ratio"):
            self.assertIn(key, figures)
        self.assertAlmostEqual(figures["energy_ratio"], 1, delta=0.06)  # 1.013 with voxels of 0.1 mm, 1.006 of 0.05 mm
        removed = figures["removed_mm3"]
        self.assertGreater(removed["enamel"], 5)
        self.assertGreater(removed["dentin"], 1)
        self.assertEqual(removed["pulp"], 0)
        # What is gone from the tooth file is what the trace says was removed.
        after = json.loads(self.run_ok("info", "prepared.vdb", "--json").stdout)
        for tissue in ("enamel", "dentin"):
            gone = info["volume_mm3"][tissue] - after["volume_mm3"][tissue]
            self.assertAlmostEqual(gone, removed[tissue], delta=0.03 * sum(removed.values()))
        self.run_ok("export", "cavity.h5", "-o", "cavity.csv")
        with open(self.path("cavity.csv")) as f:
            header = f.readline().strip().split(",")
            self.assertEqual(sum(1 for _ in f), figures["steps"] + 1)
        for column in ("time_s", "handle_x_mm", "force_device_x_N"):
            self.assertIn(column, header)
        for name in ("prepared.ply", "prepared.stl", "prepared.obj"):
            self.run_ok("mesh", "prepared.vdb", "-o", name)
            self.assertGreater(os.path.getsize(self.path(name)), 10000)

    def test_layered_slot_gives_the_closed_forms_on_both_plateaus(self):
        # u v L/(4 alpha N) in enamel at 1 mm/s with 2.9 mm of the 3 mm head inside (z from -0.4 to 2.5).
        self.replay("direct.h5", "--drive", "direct", "--stall-torque-mnm", "inf")
        with h5py.File(self.path("direct.h5")) as f:
            y = f["bur/position"][:, 1]
            force = f["force/grinding"][:, 1]
            self.assertEqual(f["force/grinding"].attrs["units"], "N")
        length = 2.9
        enamel = 300 * 1.0 * length / (4 * 0.25 * 100)
        self.assertAlmostEqual(force[(y < -0.05) & (y > -0.85)].mean() / enamel, 1, delta=0.01)
        self.assertAlmostEqual(force[y < -1.6 - 0.55].mean() / (enamel / 3), 1, delta=0.01)

    def test_same_inputs_give_the_same_bytes_whatever_the_threads(self):
        for threads in ("1", "2"):
            self.run_ok("--threads", threads, "specimen", "molar", "-o", f"molar{threads}.vdb", "--voxel-mm", "0.3")
            self.run_ok("--threads", threads, "replay", "--tooth", "block.vdb", "--trajectory", "slot.toml",
                        "--bur", CYLINDER, "-o", f"trace{threads}.h5", "--prepared", f"prepared{threads}.vdb")
            self.run_ok("--threads", threads, "mesh", f"prepared{threads}.vdb", "-o", f"prepared{threads}.ply")
            self.run_ok("--threads", threads, "mesh", f"prepared{threads}.vdb", "-o", f"fewer{threads}.ply",
                        "--max-error-mm", "0.02")
        for pattern in ("molar{}.vdb", "trace{}.h5", "prepared{}.vdb", "prepared{}.ply", "fewer{}.ply"):
            with open(self.path(pattern.format(1)), "rb") as a, open(self.path(pattern.format(2)), "rb") as b:
                self.assertEqual(a.read(), b.read(), pattern)

    def test_mesh_of_fewer_triangles_in_every_format(self):
        self.run_ok("specimen", "block", "-o", "cube.vdb", "--size-mm", "3", "--enamel-mm", "1")
        for name in ("ply", "stl", "obj", "vtk", "glb", "3mf"):
            self.run_ok("mesh", "cube.vdb", "-o", f"all.{name}")
            said = self.run_ok("mesh", "cube.vdb", "-o", f"few.{name}", "--max-error-mm", "0.02").stderr
            after, before = (int(n) for n in re.findall(r"(\d+) triangles", said))
            self.assertLess(after, before / 4, said)
            self.assertRegex(said, r"within 0\.02 mm of them everywhere, both ways \(greatest distance found 0\.0[01]\d\d mm")
            self.assertLess(os.path.getsize(self.path(f"few.{name}")), os.path.getsize(self.path(f"all.{name}")) / 2)
        info = json.loads(self.run_ok("info", "few.stl", "--json").stdout)
        self.assertEqual((info["closed"], info["triangles"]), (True, after))

    def test_a_bound_without_sense_is_refused(self):
        for bound in ("0", "-0.01", "0.0009", "1.1", "nan", "inf", "few"):
            refused = self.run_tool("mesh", "block.vdb", "-o", "no.ply", "--max-error-mm", bound)
            self.assertEqual(refused.returncode, 2, bound)
            self.assertIn("--max-error-mm", refused.stderr)
            self.assertFalse(os.path.exists(self.path("no.ply")))

    def test_a_trace_replays_with_its_handle_to_the_same_forces(self):
        self.replay("first.h5")
        self.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "first.h5", "--bur", CYLINDER, "-o", "again.h5")
        with h5py.File(self.path("first.h5")) as a, h5py.File(self.path("again.h5")) as b:
            for name in ("force/grinding", "force/device", "bur/position", "torque", "removed/volume"):
                np.testing.assert_array_equal(a[name][:], b[name][:], name)

    def test_existing_output_is_kept_without_force(self):
        with open(self.path("kept.vdb"), "w") as f:
            f.write("mine")
        self.assert_refused("specimen", "block", "-o", "kept.vdb", output=None, says="--force")
        with open(self.path("kept.vdb")) as f:
            self.assertEqual(f.read(), "mine")
        self.run_ok("specimen", "block", "-o", "kept.vdb", "--force")
        os.remove(self.path("kept.vdb"))

    def test_wrong_usage_is_exit_2_and_help_is_0(self):
        for args in ((), ("frobnicate",), ("replay",), ("mesh", "block.vdb"), ("replay", "--drive", "sideways")):
            self.assertEqual(self.run_tool(*args).returncode, 2, args)
        self.assertRegex(self.run_ok("--version").stdout, r"^toothprep \d+\.\d+\.\d+\n$")
        for command in ("specimen block", "specimen molar", "specimen scan", "voxelize", "info", "replay", "export",
                        "mesh"):
            done = self.run_tool(*command.split(), "--help")
            self.assertEqual(done.returncode, 0, command)
            self.assertIn("Example", done.stdout, command)

    def test_results_say_which_program_made_them(self):
        version = json.loads(self.run_ok("--version", "--json").stdout)
        self.assertEqual("toothprep " + version["toothprep_version"], self.run_ok("--version").stdout.strip())
        self.assertEqual(version["build"], ", ".join(filter(None, map(version.get, ("build_type", "compiler", "commit")))))
        self.assertGreaterEqual(set(version["libraries"]), {"OpenVDB", "HDF5", "ITK", "CGAL", "TBB", "Eigen3", "OpenSSL"})
        for number in version["libraries"].values():
            self.assertRegex(number, r"^\d+\.\d+")
        self.write("way.csv", "time_s,x_mm,y_mm,z_mm\n0,0,9,0\n0.01,0,9,0\n")
        self.run_ok("specimen", "block", "--size-mm", "2", "--enamel-mm", "1", "-o", "made.vdb")
        self.run_ok("specimen", "cavity", "--kind", "box", "--original", "before.vdb", "-o", "after.vdb", "--truth", "truth.json")
        replayed = self.run_ok("replay", "--tooth", "made.vdb", "--trajectory", "way.csv", "--bur", "ball:D1", "-o", "made.h5",
                               "--json")
        info = self.run_ok("info", "made.vdb", "--json")
        scored = self.run_ok("score", "--original", "before.vdb", "--prepared", "after.vdb", "-o", "made.json", "--json")
        for text in (replayed.stdout, info.stdout, scored.stdout, self.read("truth.json")):
            result = json.loads(text)
            self.assertEqual((result["toothprep_version"], result["build"]), (version["toothprep_version"], version["build"]))

    def test_library_of_burs_is_listed_and_every_one_can_be_used(self):
        names = [line.split()[0] for line in self.run_ok("replay", "--bur", "list").stdout.splitlines()]
        self.assertGreater(len(names), 15)
        for name in names:
            self.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "quick.toml", "--bur", name, "-o", "bur.h5",
                        "--force")
        os.remove(self.path("bur.h5"))

    def test_bad_inputs_are_refused_with_one_line(self):
        replay = ["replay", "--tooth", "block.vdb", "--trajectory", "slot.toml", "--bur", CYLINDER, "-o", "no.h5",
                  "--prepared", "no.vdb"]

        def with_option(option, value):
            changed = list(replay)
            changed[changed.index(option) + 1] = value
            return changed

        self.assert_refused(*with_option("--tooth", "absent.vdb"), output="no.h5", says="absent.vdb")
        self.assert_refused(*with_option("--trajectory", "absent.toml"), output="no.h5", says="absent.toml")
        self.assert_refused(*with_option("--bur", "cylinder:D1.2"), output="no.h5", says="L")
        self.assert_refused(*with_option("--bur", "ball:D0.1"), output="no.h5", says="two voxels")
        self.assert_refused(*with_option("-o", "nowhere/no.h5"), output=None, says="nowhere")
        self.assert_refused(*replay, "--stiffness-n-per-mm", "-1", output="no.h5", says="stiffness")
        self.assert_refused(*replay, "--rotation-rate-rev-s", "0", output="no.h5", says="rotation_rate")
        self.assert_refused(*with_option("--bur", "ball:D0.2"), "--engine", "voxel", output="no.h5", says="interior")

        with open(self.path("block.vdb"), "rb") as f:
            whole = f.read()
        damaged = {"empty.vdb": b"", "cut.vdb": whole[:len(whole) // 2], "text.vdb": b"not a tooth\n" * 100}
        flipped = bytearray(whole)
        flipped[len(flipped) // 2] ^= 0xFF
        damaged["flipped.vdb"] = bytes(flipped)
        for name, content in damaged.items():
            with open(self.path(name), "wb") as f:
                f.write(content)
            for args in (with_option("--tooth", name), ["mesh", name, "-o", "no.ply"], ["info", name]):
                self.assert_refused(*args, output=None, says=name)

        texts = {
            "empty.csv": "",
            "header.csv": "t,x,y,z\n0,0,0,0\n",
            "nan.csv": "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n0.001,nan,0,0\n",
            "back.csv": "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n0,1,0,0\n",
            "gap.csv": "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n5,1,0,0\n",
            "key.toml": "start_mm = [0,0,0]\naxis=[0,0,1]\nrate_hz=1000\nspeed = 3\n",
            "endless.toml": 'start_mm = [0,0,0]\naxis=[0,0,1]\nrate_hz=1000\n[[segment]]\nkind="hold"\nduration_s=1e12\n',
            "cut.h5": "\x89HDF\r\n\x1a\n",
        }
        for name, content in texts.items():
            with open(self.path(name), "w", encoding="latin-1") as f:
                f.write(content)
            self.assert_refused(*with_option("--trajectory", name), output="no.h5", says=name)
        with open(self.path("bad-params.toml"), "w") as f:
            f.write("[tissue.enamel]\nforce_ration = 0.25\n")
        self.assert_refused(*replay, "--params", "bad-params.toml", output="no.h5", says="force_ratio")
        for name in ("empty.nrrd", "text.nrrd", "empty.nii.gz", "text.mha"):
            with open(self.path(name), "w") as f:
                f.write("" if name.startswith("empty") else "no scan here\n" * 30)
            self.assert_refused("voxelize", name, "-o", "no.vdb", output="no.vdb", says=name)
        self.assert_refused("export", "block.vdb", "-o", "no.csv", output="no.csv", says="block.vdb")

    def test_voxelize_reports_what_it_found(self):
        self.run_ok("specimen", "scan", "-o", "small.nrrd", "--spacing-mm", "0.3")
        self.run_ok("voxelize", "small.nrrd", "-o", "small.vdb", "--voxel-mm", "0.2", "--report", "seen")
        with open(self.path("seen/report.json")) as f:
            report = json.load(f)
        self.assertEqual(report["schema"], "toothprep-scan-report")
        self.assertGreater(report["enamel_thickness_mm"]["mean"], 0.5)
        self.assertLess(report["threshold_dentin"], report["threshold_enamel"])
        for name in ("histogram.png", "slices.png"):
            self.assertGreater(os.path.getsize(self.path(os.path.join("seen", name))), 5000)

    def test_shells_come_back_as_the_tooth_that_they_were_taken_from(self):
        for tissue in ("enamel", "dentin"):
            self.run_ok("mesh", "block.vdb", "--tissue", tissue, "-o", f"{tissue}-shell.stl")
        self.run_ok("voxelize", "--mesh", "enamel=enamel-shell.stl", "--mesh", "dentin=dentin-shell.stl", "-o",
                    "shells.vdb")
        volumes = [json.loads(self.run_ok("info", name, "--json").stdout)["volume_mm3"]
                   for name in ("block.vdb", "shells.vdb")]
        for tissue in ("enamel", "dentin"):
            self.assertLess(abs(volumes[1][tissue] / volumes[0][tissue] - 1), 0.005, tissue)
        with open(self.path("enamel-shell.stl"), "rb") as f:
            whole = f.read()
        count = int.from_bytes(whole[80:84], "little")
        with open(self.path("hole.stl"), "wb") as f:  # one triangle less
            f.write(whole[:80] + (count - 1).to_bytes(4, "little") + whole[84:-50])
        self.assert_refused("voxelize", "--mesh", "enamel=hole.stl", "--no-repair", "-o", "no.vdb", output="no.vdb",
                            says="hole.stl")
        self.assertIn("warning: hole.stl: filled a hole of", self.run_ok("voxelize", "--mesh", "enamel=hole.stl", "-o",
                                                                       "filled.vdb").stderr)
        self.assertEqual(self.run_tool("voxelize", "-o", "no.vdb").returncode, 2)
        self.assertEqual(self.run_tool("voxelize", "--mesh", "enamel", "-o", "no.vdb").returncode, 2)

    def test_one_of_several_series_is_chosen(self):
        for spacing in ("0.5", "0.4"):
            self.run_ok("specimen", "scan", "-o", f"ct-{spacing}", "--spacing-mm", spacing)
        os.makedirs(self.path("two"))
        for spacing in ("0.5", "0.4"):
            for name in os.listdir(self.path(f"ct-{spacing}")):
                shutil.copy(self.path(os.path.join(f"ct-{spacing}", name)), self.path(f"two/{spacing}-{name}"))
        listed = json.loads(self.run_ok("info", "two", "--json").stdout)
        self.assertEqual(len(listed["series"]), 2)
        self.assert_refused("voxelize", "two", "-o", "no.vdb", "--voxel-mm", "0.3", output="no.vdb", says="--series")
        self.run_ok("voxelize", "two", "--series", listed["series"][0]["uid"], "--voxel-mm", "0.3", "-o", "chosen.vdb")
        self.assert_refused("voxelize", "two", "--series", "none such", "-o", "no.vdb", output="no.vdb", says="none such")

    def make_experiment(self, name, **changes):
        """A folder with one small experiment: a ball through 1.5 mm of enamel into dentin."""
        keys = {"kind": "plateaus", "drive": "direct", "bur": "ball:D1.2", "trajectory": "path.toml"} | changes
        folder = self.path(os.path.join(name, "small"))
        os.makedirs(folder)
        with open(os.path.join(folder, "experiment.toml"), "w") as f:
            f.writelines(f'{key} = "{value}"\n' for key, value in keys.items())
            f.write("[block]\nsize_mm = [3.0, 6.0, 3.0]\nenamel_mm = 3.0\n")
        with open(os.path.join(folder, "path.toml"), "w") as f:
            f.write('start_mm = [0.0, 0.7, -0.6]\n[[segment]]\nkind = "line"\nto_mm = [0.0, -5.2, -0.6]\n'
                    'speed_mm_s = 1.5\n')

    def test_figures_leave_table_traces_meshes_and_pictures(self):
        self.make_experiment("mine")
        printed = self.run_ok("figures", "--experiments", "mine", "--voxel-mm", "0.15", "--json", "-o", "figs").stdout
        with open(self.path("figs/figures.json")) as f:
            table = json.load(f)
        self.assertEqual(table["schema"], "toothprep-figures")
        self.assertEqual(json.loads(printed), table)
        figure, = table["figures"]
        exact = [c for c in figure["claims"] if c["claim"] == "Level in enamel" and c["engine"] == "levelset"]
        self.assertEqual(len(exact), 3)
        for claim in exact:
            self.assertTrue(claim["holds"], claim)
            self.assertLess(abs(claim["measured"] / claim["expected"] - 1), 0.01)
        for name in ("figures.md", "small/levelset.h5", "small/voxel.h5", "small/exact.csv", "small/levelset.ply",
                     "small/forces.png", "small/forces.svg", "small/levelset.png", "small/voxel.png"):
            self.assertGreater(os.path.getsize(self.path(os.path.join("figs", name))), 500, name)
        # No two pictures have the same caption.
        with open(self.path("figs/figures.md")) as f:
            captions = re.findall(r"!\[(.*?)\]\(", f.read())
        self.assertEqual(len(captions), len(figure["plots"]) + len(figure["pictures"]))
        self.assertEqual(len(captions), len(set(captions)), captions)
        # Its traces are traces.
        self.run_ok("replay", "--tooth", "block.vdb", "--trajectory", "figs/small/levelset.h5", "--bur", "ball:D1.2",
                    "-o", "figures-again.h5")
        # An existing folder stays unless --force is given.
        again = ("figures", "--experiments", "mine", "--voxel-mm", "0.15", "--no-plots", "--engine", "levelset")
        self.assert_refused(*again, "-o", "figs", output=None, says="exists")
        self.run_ok(*again, "--force", "-o", "figs")
        self.assertFalse(os.path.exists(self.path("figs/small/voxel.h5")))

    def test_figures_refuse_what_cannot_be_run(self):
        self.make_experiment("wrong-kind", kind="plateau")
        self.make_experiment("wrong-bur", bur="ball:D0.1")
        self.make_experiment("no-path", trajectory="absent.toml")
        with open(self.path("alpha.toml"), "w") as f:
            f.write("[tissue.enamel]\nforce_ratio = 0\n")
        quick = ("figures", "--no-plots", "-q", "-o", "no")
        self.assert_refused(*quick, "--experiments", "wrong-kind", output="no", says='"plateaus"')
        self.assert_refused(*quick, "--experiments", "wrong-bur", output="no", says="two voxels")
        self.assert_refused(*quick, "--experiments", "no-path", output="no", says="absent.toml")
        self.assert_refused(*quick, "--experiments", "nowhere", output="no", says="nowhere")
        self.assert_refused(*quick, "--only", "17", output="no", says="figure-09")
        self.assert_refused(*quick, "--only", "9", "--params", "alpha.toml", output="no", says="force_ratio")
        self.assertEqual(self.run_tool("figures").returncode, 2)
        self.assertEqual(self.run_tool("figures", "--engine", "both?", "-o", "no").returncode, 2)
        self.assertIn("figure-14", self.run_ok("figures", "--list").stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
