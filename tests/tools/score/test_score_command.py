"""Runs `toothprep score` as a user does: what it writes, what it refuses and how, and that nothing half written stays.

Usage: test_score_command.py BINARY
"""
import json
import os
import resource
import shutil
import signal
import struct
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
from command_test import CommandTest

TEETH = ("--original", "o.vdb", "--prepared", "p.vdb")
BOX = ("specimen", "cavity", "--kind", "box", "--size-mm", "6,4,5", "--voxel-mm", "0.2", "--taper-deg", "4", "--length-mm", "3",
       "--width-mm", "1.4", "--depth-mm", "1.7", "--enamel-mm", "1.2")


def small_files_only():
    """As if the disk were full: no file beyond 20 kB."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))


class Score(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok(*BOX, "--offset-mm", "0.1", "-o", "p.vdb", "--original", "o.vdb", "--target", "t.vdb")
        cls.run_ok("specimen", "molar", "--voxel-mm", "0.4", "-o", "molar.vdb")
        cls.run_ok("mesh", "p.vdb", "-o", "p.stl")
        cls.run_ok("mesh", "p.vdb", "-o", "p.ply")
        cls.run_ok("mesh", "o.vdb", "-o", "o.stl")
        cls.run_ok(*BOX, "--position-mm", "40,0,0", "-o", "far.vdb")
        stl = cls.read("o.stl")
        count = struct.unpack("<I", stl[80:84])[0]
        cls.write("open.stl", stl[:80] + struct.pack("<I", 40) + stl[84:84 + 50 * 40])
        cls.write("cut.vdb", cls.read("p.vdb")[:20000])
        cls.write("not-a-tooth.vdb", b"hello")
        rubric = ('name = "r"\ntype = "%s"\nsource = "a test"\npass_points = 60\n[[criterion]]\nkey = "%s"\nunit = "mm"\n'
                  'weight = 1\nsource = "a test"\nideal = [1, 2]\ntolerated = [0, 3]\n')
        cls.write("crown.toml", (rubric % ("crown", "wall_height_mm")).encode())
        cls.write("unknown.toml", (rubric % ("class1", "dept_mm")).encode())
        cls.write("class1.toml", (rubric % ("class1", "depth_mm")).encode())

    def setUp(self):
        self.before = self.made = self.everything()

    def tearDown(self):
        for path in self.everything():
            if path not in self.made and os.path.lexists(path):
                shutil.rmtree(path) if os.path.isdir(path) else os.remove(path)

    def everything(self):
        """Every file's content, hidden ones too."""
        found = {}
        for place, folders, files in os.walk(self.folder):
            for name in folders:
                found[os.path.join(place, name)] = None
            for name in files:
                with open(os.path.join(place, name), "rb") as file:
                    found[os.path.join(place, name)] = file.read()
        return found

    def score(self, *args):
        done = self.run_tool("score", *args)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def read_json(self, name):
        with open(self.path(name), encoding="utf-8") as file:
            return json.load(file)

    def assert_refused(self, args, says, code=1):
        done = self.run_tool("score", *args)
        self.assertEqual(done.returncode, code, f"{args}: {done.stdout}{done.stderr}")
        self.assertEqual(done.stdout, "", args)
        self.assertIn(says, done.stderr, args)
        if code == 1:
            self.assertEqual(len(done.stderr.splitlines()), 1, f"{args}: {done.stderr}")
            self.assertTrue(done.stderr.startswith("toothprep: "), done.stderr)
        self.assertEqual(self.everything(), self.before, args)

    def test_it_writes_the_score_and_the_report(self):
        done = self.score(*TEETH, "--target", "t.vdb", "--type", "class1", "-o", "s.json", "--report", "r", "--json")
        score = self.read_json("s.json")
        self.assertEqual(score, json.loads(done.stdout))
        self.assertEqual(score["schema"], "toothprep-score")
        self.assertAlmostEqual(score["depth_mm"], 1.8, delta=0.1)
        self.assertAlmostEqual(score["deviation_mean_mm"], -0.1, delta=0.03)
        self.assertAlmostEqual(score["wall_angles_deg"]["mesial"], 4, delta=1)
        self.assertEqual([score["inputs"][k]["file"] for k in ("original", "prepared", "target")], ["o.vdb", "p.vdb", "t.vdb"])
        self.assertTrue(score["criteria"])
        self.assertIn("points_percent", score)
        self.assertEqual(sorted(os.listdir(self.path("r"))), [".toothprep-folder", "deviation.ply", "deviation.vtk",
                                                              "prepared.ply", "report.html", "thumbnail.png"])
        with open(self.path("r/report.html"), encoding="utf-8") as file:
            page = file.read()
        self.assertEqual(page.count("<svg"), page.count("</svg>"))
        for foreign in ('src="http', 'href="http', "@import", "url(http"):
            self.assertNotIn(foreign, page)
        # Again: refused without --force, replaced with it, the same to the byte with one thread.
        first = self.everything()
        self.before = first
        again = (*TEETH, "--target", "t.vdb", "--type", "class1", "-o", "s.json", "--report", "r")
        self.assert_refused(again, "s.json: exists already")
        self.score(*again, "--force", "--threads", "1")
        self.assertEqual(self.everything(), first)

    def test_contact_with_a_neighbour_is_judged_only_where_there_is_one(self):
        """A stroke into the mesial wall of a molar alone and of one with a neighbour behind it, distally."""
        self.write("stroke.toml", b'''start_mm = [6, -1, 15]
axis = [0, 0, 1]
[[segment]]
kind = "line"
to_mm = [6, 3.0, 15]
speed_mm_s = 0.3
''')
        for neighbours, judged in (("0", False), ("1", True)):
            name = "of" + neighbours
            more = ("--neighbours", neighbours) if judged else ()
            self.run_ok("specimen", "molar", "--voxel-mm", "0.4", *more, "-o", name + ".vdb")
            self.run_ok("replay", "--tooth", name + ".vdb", "--bur", "cylinder:D1.2xL3.0", "--drive", "direct", "--trajectory",
                        "stroke.toml", "-o", name + ".h5", "--prepared", name + "-p.vdb")
            self.score("--original", name + ".vdb", "--prepared", name + "-p.vdb", "--trace", name + ".h5", "--type", "crown",
                       "-o", name + ".json")
            sheet = self.read_json(name + ".json")
            self.assertEqual(sheet["process"]["neighbour_contact_s"], 0)
            for key in ("neighbour_damage_mm3", "process.neighbour_contact_s"):
                criterion, = [c for c in sheet["criteria"] if c["key"] == key]
                self.assertEqual(criterion["verdict"], "ideal" if judged else "not judged", key)
                self.assertEqual(criterion["of"] > 0, judged, key)
                reason = "the original has no neighbouring tooth; its weight is left out"
                self.assertEqual(reason in criterion["reason"], not judged, key)

    def test_a_mesh_alone_and_no_rubric(self):
        self.score("--original", "o.vdb", "--prepared", "p.stl", "--rubric", "none", "--quiet", "-o", "s.json")
        score = self.read_json("s.json")
        self.assertNotIn("criteria", score)
        self.assertEqual(score["options"]["type_from"], "found")
        self.assertEqual(score["options"]["type"], "class1")
        self.assertGreater(score["removed_mm3"]["enamel"], 1)

    def test_what_is_wrong_with_the_teeth_is_told(self):
        new = ("-o", "s.json", "--report", "r")
        for args, says in (
                (("--original", "molar.vdb", "--prepared", "p.vdb"), "outside the original tooth"),
                (("--original", "o.vdb", "--prepared", "molar.vdb"), "outside the original tooth"),
                (("--original", "o.vdb", "--prepared", "molar.vdb", "--register"), "molar.vdb"),
                (("--original", "o.vdb", "--prepared", "far.vdb"), "far.vdb: the prepared tooth lies wholly outside"),
                (("--original", "o.vdb", "--prepared", "o.vdb"), "nothing was removed"),
                (("--original", "p.vdb", "--prepared", "o.vdb"), "stand out of the original tooth"),
                ((*TEETH, "--target", "far.vdb"), "far.vdb: the target lies wholly outside"),
                ((*TEETH, "--target", "molar.vdb"), "molar.vdb: the target"),
                ((*TEETH, "--target", "o.vdb"), "the target removes nothing"),
                (("--original", "o.vdb", "--prepared", "open.stl"), "open.stl"),
                ((*TEETH, "--target", "open.stl"), "open.stl"),
                (("--original", "open.stl", "--prepared", "p.vdb"), "open.stl"),
                (("--original", "o.vdb", "--prepared", "cut.vdb"), "cut.vdb"),
                (("--original", "cut.vdb", "--prepared", "p.vdb"), "cut.vdb"),
                (("--original", "o.vdb", "--prepared", "not-a-tooth.vdb"), "not-a-tooth.vdb"),
                (("--original", "o.vdb", "--prepared", "class1.toml"), "class1.toml"),
                (("--original", "missing.vdb", "--prepared", "p.vdb"), "missing.vdb"),
                (("--original", "o.vdb", "--prepared", "missing.stl"), "missing.stl"),
                ((*TEETH, "--target", "missing.ply"), "missing.ply"),
                ((*TEETH, "--trace", "missing.h5"), "missing.h5"),
                ((*TEETH, "--trace", "p.vdb"), "p.vdb")):
            with self.subTest(args=args):
                self.assert_refused((*args, *new), says)

    def test_what_is_wrong_with_rubric_and_directions_is_told(self):
        for args, says in (
                (("--rubric", "crown.toml", "--type", "class1"), "is for the type crown, not class1"),
                (("--rubric", "unknown.toml"), "depth_mm"),
                (("--rubric", "missing.toml"), "missing.toml"),
                (("--rubric", "p.stl"), "p.stl"),
                (("--axis", "0,0,0"), "occlusal direction"),
                (("--axis", "0,1,0", "--mesial", "0,2,0"), "parallel"),
                (("--mesial", "1,0,0", "--buccal", "2,0,0"), "parallel"),
                (("--buccal", "0,0,0"), "buccal direction")):
            with self.subTest(args=args):
                self.assert_refused((*TEETH, *args, "-o", "s.json", "--report", "r"), says)

    def test_an_axis_across_the_opening_is_noted(self):
        done = self.score(*TEETH, "--axis", "1,0,0", "--mesial", "0,1,0", "--rubric", "none", "--type", "class1", "-o", "s.json")
        self.assertIn("90 degrees off the direction in which the tooth was opened", done.stderr)
        self.assertTrue(any("90 degrees off" in note for note in self.read_json("s.json")["notes"]))

    def test_a_wrong_command_line_is_exit_2(self):
        for args, says in (((), "--original"), (("--original", "o.vdb", "--prepared", "p.vdb"), "--output"),
                           ((*TEETH, "-o", "s.json", "--type", "class3"), "--type"),
                           ((*TEETH, "-o", "s.json", "--axis", "1,2"), "--axis"),
                           ((*TEETH, "-o", "s.json", "--axis", "up"), "--axis"),
                           ((*TEETH, "-o", "s.json", "--axis", "nan,0,1"), "--axis"),
                           ((*TEETH, "-o", "s.json", "--axis", "0,inf,1"), "--axis"),
                           ((*TEETH, "-o", "s.json", "--mesial", "nan,1,0"), "--mesial"),
                           ((*TEETH, "-o", "s.json", "--voxel-mm", "0"), "--voxel-mm"),
                           ((*TEETH, "-o", "s.json", "--undercut-threshold-mm", "-1"), "--undercut-threshold-mm"),
                           ((*TEETH, "-o", "s.json", "--force-limit-n", "0"), "--force-limit-n"),
                           ((*TEETH, "-o", "s.json", "--nonsense"), "--nonsense")):
            with self.subTest(args=args):
                self.assert_refused(args, says, code=2)

    def test_outputs_in_the_way_stay(self):
        self.write("old.json", b"old")
        self.write("work/notes.txt", b"mine")
        self.write("report/report.html", b"a report")
        self.write("report/thesis.txt", b"mine, too")
        self.write("plain", b"a file")
        self.before = self.everything()
        for args, says in (
                (("-o", "old.json"), "old.json: exists already"),
                (("-o", "s.json", "--report", "work"), "work: exists already"),
                (("-o", "s.json", "--report", "work", "--force"), "notes.txt"),
                (("-o", "s.json", "--report", "report", "--force"), "report: holds 'report.html' and was not written"),
                (("-o", "s.json", "--report", "plain", "--force"), "plain"),
                (("-o", "s.json", "--report", ".", "--force"), "."),
                (("-o", "work", "--force"), "is a folder"),
                (("-o", "nowhere/s.json"), "nowhere"),
                (("-o", "s.json", "--report", "nowhere/r"), "nowhere"),
                (("-o", "new", "--report", "new"), "is named for two outputs"),
                (("-o", "s.json", "--report", "s.json"), "is named for two outputs"),
                (("-o", "p.vdb", "--force"), "another format"),
                (("--trace", "old.json", "-o", "./old.json", "--force"), "is read as an input")):
            with self.subTest(args=args):
                self.assert_refused((*TEETH, "--type", "class1", *args), says)

    def test_an_error_keeps_what_was_there_before(self):
        self.score(*TEETH, "--type", "class1", "-o", "s.json", "--report", "r")
        self.before = self.everything()
        again = ("-o", "s.json", "--report", "r", "--force")
        self.assert_refused(("--original", "o.vdb", "--prepared", "o.vdb", *again), "nothing was removed")
        self.assert_refused((*TEETH, "--axis", "0,0,0", *again), "occlusal direction")
        # A report that can't be made leaves neither half of the outputs: its last file has no room.
        done = self.run_tool("score", *TEETH, "--type", "class1", *again,
                             preexec_fn=small_files_only)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertEqual(self.everything(), self.before)

    def test_every_figure_is_listed_with_its_definition(self):
        done = self.run_tool("score", "--list-figures")
        self.assertEqual(done.returncode, 0)
        for key in ("depth_mm", "wall_angles_deg.{", "undercut_max_mm", "process.time_s"):
            self.assertIn(key, done.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
