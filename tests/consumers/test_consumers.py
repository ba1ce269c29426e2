"""Projects of others, built against an installed tree and nothing else.

Arguments: cmake, the build folder, the source folder. What is installed and built lies in BUILD/consumers.
"""
import os
import re
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

import h5py
import numpy

CMAKE, BUILD, SOURCE = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
FOLDER = BUILD / "consumers"
PREFIX = FOLDER / "prefix"


def run(*command, **more):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=500, **more)
    assert done.returncode == 0, f"{command}: {done.returncode}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}"
    return done


def cached(name):
    found = re.search(rf"^{name}:\w+=(.*)$", (BUILD / "CMakeCache.txt").read_text(), re.M)
    return found.group(1) if found and not found.group(1).endswith("NOTFOUND") else ""


def build(project):
    """Configures and builds a copy of it; its folder."""
    folder = FOLDER / project
    shutil.copytree(SOURCE / "tests" / "consumers" / project, folder / "source")
    configured = run(CMAKE, "-S", folder / "source", "-B", folder / "build", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={PREFIX}",
                     "-DCMAKE_BUILD_TYPE=Release", f"-DCMAKE_CXX_COMPILER={cached('CMAKE_CXX_COMPILER')}",
                     f"-DCMAKE_CXX_COMPILER_LAUNCHER={cached('CCACHE_PROGRAM')}")
    assert "not available" not in configured.stdout, configured.stdout
    run(CMAKE, "--build", folder / "build", "--", "-j2", "-k0")
    return folder / "build"


def datasets(path):
    """All of a trace's numbers, by name."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


class Consumers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        shutil.rmtree(FOLDER, ignore_errors=True)
        FOLDER.mkdir()
        run(CMAKE, "--install", BUILD, "--prefix", PREFIX)
        cls.tool = PREFIX / "bin" / "toothprep"
        cls.tooth = FOLDER / "block.vdb"
        run(cls.tool, "specimen", "block", "--size-mm", "4,2,4", "--enamel-mm", "1", "-o", cls.tooth)

    def assert_same_numbers(self, path, other, least):
        ours, theirs = datasets(path), datasets(other)
        names = sorted(set(ours) & set(theirs))
        self.assertGreaterEqual(len(names), least, names)
        self.assertGreater(numpy.abs(ours["force/grinding"]).max(), 0.05)  # N: it did grind
        for name in names:
            self.assertEqual(ours[name].tobytes(), theirs[name].tobytes(), name)

    def test_the_installed_tree_names_no_folder_of_the_build(self):
        texts = [p for p in PREFIX.rglob("*") if p.suffix in {".cmake", ".h", ".toml", ".md"}]
        self.assertGreater(len(texts), 50)
        for path in texts:
            text = path.read_text(encoding="utf-8")
            for folder in (str(BUILD) + "/", str(SOURCE) + "/"):
                self.assertNotIn(folder, text.replace(str(PREFIX), ""), path)

    def test_the_installed_program_has_its_data_beside_it(self):
        listed = run(self.tool, "replay", "--bur", "list", cwd=FOLDER, env={"PATH": os.environ["PATH"]})
        self.assertIn("837-012", listed.stdout)
        moved = FOLDER / "moved"  # without its data it says so, and does not look elsewhere
        moved.mkdir()
        shutil.copy(self.tool, moved)
        done = subprocess.run([moved / "toothprep", "replay", "--bur", "list"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn(str(FOLDER / "share" / "toothprep" / "burs"), done.stderr)

    def test_the_stand_in_is_installed_only_on_request(self):
        self.assertEqual(list(PREFIX.rglob("libHD*")), [])
        run(CMAKE, "--install", BUILD, "--prefix", FOLDER / "stand-in", "--component", "stand-in")
        self.assertEqual([p.name for p in (FOLDER / "stand-in").rglob("*") if p.is_file()], ["libHD.so"])

    def test_a_simulator_of_ones_own_gets_the_bits_of_replay(self):
        folder = build("simulator")
        path = FOLDER / "path.csv"
        rows = [f"{i * 1e-3:.3f},{-2.6 + 2e-3 * i:.6f},-0.8,{1e-4 * (i % 7):.6f},-0.7071067811865476,0,0,0.7071067811865476"
                for i in range(1201)]
        path.write_text("time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw\n" + "\n".join(rows) + "\n")
        done = run(folder / "simulator", self.tooth, path, "cylinder:D0.8xL1.5", FOLDER / "own.h5")
        self.assertIn("1200 steps", done.stdout)
        run(self.tool, "replay", "--tooth", self.tooth, "--trajectory", path, "--bur", "cylinder:D0.8xL1.5", "-o",
            FOLDER / "replay.h5")
        self.assert_same_numbers(FOLDER / "own.h5", FOLDER / "replay.h5", 15)
        missing = subprocess.run([folder / "simulator", "no.vdb", path, "ball:D1", "x.h5"], capture_output=True, text=True)
        self.assertEqual(missing.returncode, 1)
        self.assertIn("file no.vdb, place", missing.stderr)

    def test_the_step_alone_links_no_file_format(self):
        folder = build("step_only")
        done = run(folder / "step_only")
        self.assertEqual(len(done.stdout.splitlines()), 7)
        ratio = float(re.search(r"work over energy ([\d.]+)", done.stdout).group(1))
        self.assertAlmostEqual(ratio, 1, delta=0.03)  # as the README promises of the energy audit
        line = run("ninja", "-C", folder, "-t", "commands", "step_only").stdout
        loaded = run("ldd", folder / "step_only").stdout
        self.assertIn("libtoothprep_session.a", line)
        for heavy in ("itk", "hdf5", "openvdb", "cgal", "ceres", "embree", "openexr", "imath"):
            self.assertNotIn(heavy, line.lower())
            self.assertNotIn(heavy, loaded.lower())
        looked_for = (folder / "CMakeCache.txt").read_text()
        for package in ("ITK_DIR", "OpenVDB_", "HDF5_", "CGAL_DIR", "Ceres_DIR"):
            self.assertNotIn("\n" + package, looked_for)

    def test_a_device_of_ones_own_runs_a_live_session(self):
        folder = build("own_device")
        session, again = FOLDER / "session.h5", FOLDER / "again.h5"
        done = run(folder / "own_device", self.tooth, session)
        self.assertRegex(done.stdout, r"^duration after \d+ ticks; removed 0\.\d+ mm3 of enamel; last force 0\.000 N")
        run(self.tool, "replay", "--tooth", self.tooth, "--trajectory", session, "--bur", "cylinder:D0.8xL1.5", "-o", again)
        self.assert_same_numbers(session, again, 15)

    def test_public_headers_compile_in_any_order_and_every_component_links(self):
        build("headers")

    def test_what_is_missing_is_named(self):
        project = FOLDER / "missing"
        project.mkdir()
        for request, words in (("toothprep 0.2 REQUIRED COMPONENTS teeth", "toothprep::teeth is not available"),
                               ("toothprep 0.1 REQUIRED", "0.2"), ("toothprep 0.3 REQUIRED", "0.2")):
            (project / "CMakeLists.txt").write_text(
                f"cmake_minimum_required(VERSION 3.22)\nproject(p NONE)\nfind_package({request})\n")
            done = subprocess.run([CMAKE, "-S", project, "-B", project / "build", f"-DCMAKE_PREFIX_PATH={PREFIX}"],
                                  capture_output=True, text=True)
            self.assertNotEqual(done.returncode, 0, request)
            self.assertIn(words, " ".join(done.stderr.split()))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
