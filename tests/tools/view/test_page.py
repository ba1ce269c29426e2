"""The page in a real browser: what it shows is what the files hold.

Usage: test_page.py TOOTHPREP SOURCE_FOLDER [PICTURES]: pictures of the page are left in that folder.
"""
import io
import json
import os
import sys
import unittest
from pathlib import Path

import h5py
import matplotlib.image
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "support"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import browser
from command_test import CommandTest
from viewer import Viewer

PICTURES = os.path.abspath(sys.argv[3]) if len(sys.argv) > 3 else None

# 4 mm of a slot, in air before and after; fast enough to stall.
PATH = """rate_hz = 1000
start_mm = [-6.0, 0.5, 0.0]
axis = [0.0, 1.0, 0.0]
[[segment]]
kind = "waypoints"
points_mm = [[-5.2, -1.0, 0.0]]
speed_mm_s = 8.0
[[segment]]
kind = "waypoints"
points_mm = [[-1.0, -1.0, 0.0]]
speed_mm_s = 2.5
[[segment]]
kind = "waypoints"
points_mm = [[-1.0, 4.0, 0.0]]
speed_mm_s = 8.0
"""


def length(v):
    return np.sqrt((np.asarray(v, float) ** 2).sum(axis=-1))


def setUpModule():
    if not browser.why_not():  # one for all: its start and its first picture take seconds
        PageTest.browser = browser.Browser()
        unittest.addModuleCleanup(PageTest.browser.close)


@unittest.skipIf(browser.why_not(), browser.why_not())
class PageTest(CommandTest):
    def show(self, *arguments):
        viewer = Viewer(*arguments, cwd=self.folder)
        self.addCleanup(viewer.end)
        self.addCleanup(self.browser.open, "about:blank")  # before that
        self.open(viewer)
        return viewer

    def open(self, viewer):
        self.browser.complaints.clear()
        self.browser.open(viewer.address)
        self.browser.wait_for("window.toothprep && window.toothprep.state().ready")

    def picture(self, name):
        return self.browser.picture(PICTURES and os.path.join(PICTURES, name + ".png"))

    def on_screen(self, place):
        """Pixel of the page at which a place (mm, W) is seen."""
        x, y = self.browser.run(f"window.toothprep.onScreen({place})")
        return round(x), round(y)

    def tearDown(self):
        self.browser.run("0")  # what it has said until now
        self.assertEqual(self.browser.complaints, [])


class Replay(PageTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--voxel-mm", "0.1")
        cls.write("path.toml", PATH)
        cls.run_ok("replay", "--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--trajectory", "path.toml", "--stall-torque-mnm",
                   "0.3", "-o", "trace.h5", "--prepared", "prepared.vdb")
        with h5py.File(cls.path("trace.h5")) as file:
            cls.trace = {name: file[name][()] for name in
                         ("time", "bur/position", "handle/position", "force/device", "torque", "stalled")}
        cls.viewer = Viewer("trace.h5", "--tooth", "block.vdb", cwd=cls.folder)
        cls.addClassCleanup(cls.viewer.end)
        cls.addClassCleanup(cls.browser.open, "about:blank")  # before that

    BEGINNING = """(() => {
      const page = window.toothprep;
      page.play(false), page.section({kind: 'off'}), page.wipe(0), page.stereo('off'), page.mirror(false), page.look('oblique');
      return page.seek(0);
    })()"""

    def show_replay(self):
        """The page of the replay, one for the tests that only look and move, as it was at first."""
        if self.browser.run("window.location.href") != self.viewer.address:
            return self.open(self.viewer)
        self.browser.complaints.clear()
        self.browser.run(self.BEGINNING)
        self.set_speed("1")

    def test_every_number_is_the_traces(self):
        self.show_replay()
        times = self.trace["time"]
        self.assertEqual(self.browser.state()["rows"], len(times))
        for row in (0, 100, len(times) // 2, len(times) - 1):
            state = self.browser.run(f"window.toothprep.seek({times[row]!r})")
            self.assertEqual(state["row"], row)
            self.assertEqual(state["time"], times[row])
            for key, name in (("bur", "bur/position"), ("handle", "handle/position"), ("force", "force/device")):
                np.testing.assert_allclose(state[key], self.trace[name][row], rtol=1e-6, atol=1e-6)
            self.assertAlmostEqual(state["force_n"], length(self.trace["force/device"][row]), delta=1e-6)
            self.assertAlmostEqual(state["lag_mm"], length(self.trace["bur/position"][row] - self.trace["handle/position"][row]),
                                   delta=1e-5)
            self.assertAlmostEqual(state["torque"], self.trace["torque"][row], delta=1e-6)
            self.assertEqual(state["stalled"], bool(self.trace["stalled"][row]))
            self.assertEqual(state["lamps"]["stall"], bool(self.trace["stalled"][row]))
            self.assertIsNone(state["lamps"]["fault"])  # a trace knows nothing of a device

    def test_the_tooth_is_the_one_of_the_moment_in_any_order(self):
        def triangles(tooth):  # of the tooth's file, shown alone
            self.show(tooth)
            return self.browser.state()["triangles"]
        whole, cut = triangles("block.vdb"), triangles("prepared.vdb")
        # Of one tissue: between two, `mesh` divides triangles, which the page doesn't.
        self.run_ok("specimen", "block", "-o", "enamel.vdb", "--size-mm", "4,4,4", "--enamel-mm", "4", "--force")
        self.run_ok("mesh", "enamel.vdb", "-o", "surface.ply", "--force")
        header = self.read("surface.ply").split(b"end_header")[0].decode()
        self.assertIn(f"element face {triangles('enamel.vdb')}\n", header)
        self.show("trace.h5", "--tooth", "block.vdb")
        seek = lambda time: self.browser.run(f"window.toothprep.seek({time})")
        end = self.trace["time"][-1]
        self.assertNotEqual(whole, cut)
        self.browser.wait_for("window.toothprep.state().recomputed.finished")
        self.assertEqual(seek(end)["triangles"], cut)
        half = seek(0.5 * end)
        self.assertNotIn(half["triangles"], (whole, cut))
        self.assertLessEqual(abs(half["frame_row"] - half["row"]), 50)
        self.assertEqual(seek(0)["triangles"], whole)
        self.assertEqual(seek(0.5 * end)["triangles"], half["triangles"])
        self.assertEqual(seek(end)["triangles"], cut)
        recomputed = self.browser.state()["recomputed"]
        self.assertEqual((recomputed["bur_difference_mm"], recomputed["force_difference_n"], recomputed["failure"]), (0, 0, ""))

    def test_moments_to_jump_to_are_the_traces(self):
        self.show_replay()
        time, force = self.trace["time"], length(self.trace["force/device"])
        stalled = self.trace["stalled"].astype(bool)
        onsets = time[1:][stalled[1:] & ~stalled[:-1]]
        self.assertGreater(len(onsets), 0)
        moments = self.browser.state()["moments"]
        np.testing.assert_array_equal(moments["stalls"], onsets)
        self.assertEqual(len(moments["contacts"]), 1)
        self.assertIn(time[force.argmax()], moments["peaks"])
        self.browser.run("window.toothprep.seek(0)")
        self.browser.run("document.getElementById('next-stalls').click()")
        self.assertEqual(self.browser.state()["time"], onsets[0])
        self.assertTrue(self.browser.state()["stalled"])
        self.browser.run("document.getElementById('next-contacts').click()")
        self.browser.run("document.getElementById('previous-contacts').click()")
        self.assertEqual(self.browser.state()["time"], moments["contacts"][0])
        self.picture("stall")

    def set_speed(self, value):
        self.browser.run(f"(() => {{ const s = document.getElementById('speed'); s.value = '{value}';"
                         " s.dispatchEvent(new Event('change')); })()")
        self.assertEqual(self.browser.state()["speed"], float(value))

    def test_plays_pauses_and_goes_at_the_speed_asked_for(self):
        self.show_replay()
        end = self.trace["time"][-1]
        self.set_speed("20")
        self.browser.run("document.getElementById('play').click()")
        self.browser.wait_for("!window.toothprep.state().playing && window.toothprep.state().time > 0")
        self.assertEqual(self.browser.state()["row"], len(self.trace["time"]) - 1)  # to the end, and stops
        self.set_speed("0.1")
        self.browser.run("document.getElementById('play').click()")  # from the beginning again
        self.browser.wait_for("window.toothprep.state().time > 0.01")
        state = self.browser.state()
        self.assertTrue(state["playing"])
        self.assertLess(state["time"], 0.9 * end)
        self.browser.run("window.toothprep.play(false)")
        paused = self.browser.state()["time"]
        self.assertEqual(self.browser.run("new Promise((r) => setTimeout(() => r(window.toothprep.state().time), 200))"), paused)

    def test_the_time_line_is_dragged(self):
        self.show_replay()
        box = self.browser.run("(() => { const r = document.getElementById('line-plot').getBoundingClientRect();"
                               " return [r.left, r.top, r.width, r.height]; })()")
        x, y = box[0] + 0.3 * box[2], box[1] + 0.4 * box[3]
        self.browser.drag((x, y), (box[0] + 0.8 * box[2], y))
        share = self.browser.state()["time"] / self.trace["time"][-1]
        self.assertAlmostEqual(share, 0.8, delta=0.04)

    def test_turns_cuts_and_compares(self):
        self.show_replay()
        self.browser.run(f"window.toothprep.seek({0.6 * self.trace['time'][-1]})")
        before = self.browser.state()["camera"]["position"]
        whole = self.picture("replay")
        self.browser.drag((500, 400), (620, 430))
        after = self.browser.state()["camera"]
        self.assertGreater(length(np.subtract(after["position"], before)), 1)
        # It turns about the target: the distance stays.
        self.assertAlmostEqual(length(np.subtract(after["position"], after["target"])),
                               length(np.subtract(before, after["target"])), places=6)
        turned = self.picture("turned")
        self.assertNotEqual(whole, turned)
        self.browser.run("window.toothprep.section({kind: 'buccal'})")  # along the slot
        self.browser.run("window.toothprep.look('buccal')")
        self.browser.run("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
        # The face of the section, beside and below the bur: enamel over dentin, and nothing of the far wall's inside.
        image = 255 * matplotlib.image.imread(io.BytesIO(self.picture("section")))[..., :3]
        x, y = self.on_screen([0.0, -0.7, 0.0])
        self.assertGreater(image[y, x].min(), 170)
        x, y = self.on_screen([0.0, -6.0, 0.0])
        self.assertGreater(image[y, x, 0], 1.3 * image[y, x, 2])
        self.browser.run("window.toothprep.section({kind: 'off'})")
        self.browser.run("window.toothprep.look('oblique')")
        self.browser.run("window.toothprep.wipe(0.5)")
        self.browser.wait_for("window.toothprep.state().triangles_before > 0")
        self.browser.run("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
        self.picture("before-after")
        self.assertNotEqual(self.browser.state()["triangles_before"], self.browser.state()["triangles"])


    FRAMES = "new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))"

    def pixels(self, name):
        self.browser.run("new Promise((r) => setTimeout(r, 400))")  # at rest: all pixels
        self.browser.run(self.FRAMES)
        return 255 * matplotlib.image.imread(io.BytesIO(self.picture(name)))[..., :3]

    def test_two_eyes_see_it_side_by_side_and_in_red_and_cyan(self):
        self.show_replay()
        self.browser.run(f"window.toothprep.seek({0.5 * self.trace['time'][-1]})")
        self.browser.run("window.toothprep.stereo('side')")
        image = self.pixels("side-by-side")
        box = self.browser.run("(() => { const r = document.getElementById('picture').getBoundingClientRect();"
                               " return [r.left, r.top, r.right, r.bottom].map(Math.round); })()")
        middle = (box[0] + box[2]) // 2
        half = (slice(box[1] + 90, box[3] - 60),)
        left, right = image[half + (slice(box[0], middle),)].max(axis=-1), image[half + (slice(middle, box[2]),)].max(axis=-1)
        for eye in (left, right):
            self.assertGreater((eye > 120).mean(), 0.05)  # the tooth is in both
        both = min(left.shape[1], right.shape[1])
        self.assertGreater((abs(left[:, :both] - right[:, :both]) > 30).mean(), 0.002)  # and not the same
        self.browser.run("window.toothprep.stereo('anaglyph')")
        image = self.pixels("anaglyph")[half + (slice(box[0], box[2]),)]
        red, cyan = image[..., 0], image[..., 1:].mean(axis=-1)
        self.assertGreater(((red > cyan + 60) | (cyan > red + 60)).mean(), 0.002)  # edges apart
        self.browser.run("window.toothprep.stereo('off')")
        self.assertEqual(self.browser.state()["stereo"], "off")

    def test_a_headset_shows_the_tooth_before_the_eyes_occlusal_side_up_and_goes_on_in_time(self):
        script = (Path(__file__).resolve().parent / "headset.js").read_text(encoding="utf-8")
        self.addCleanup(self.browser.before_every_page(script))
        self.show("trace.h5", "--tooth", "block.vdb")
        self.browser.wait_for("window.toothprep.state().recomputed.finished")
        self.browser.run(f"window.toothprep.seek({self.trace['time'][-1]})")
        desk = self.browser.state()["camera"]
        self.browser.wait_for("document.getElementById('headset') && document.getElementById('headset').textContent === 'ENTER VR'")
        self.browser.run("document.getElementById('headset').click()")
        self.browser.wait_for("window.toothprep.state().headset && window.headset.pictures > 5")
        image = self.pixels("headset")
        box = self.browser.run("(() => { const r = document.getElementById('picture').getBoundingClientRect();"
                               " return [r.left, r.top, r.right, r.bottom].map(Math.round); })()")
        image = image[box[1] + 90:box[3] - 60, box[0]:box[2]]
        half = image.shape[1] // 2
        white = (image.min(axis=-1) > 130)
        ochre = (image[..., 0] > 100) & (image[..., 2] < 0.8 * image[..., 0])
        for eye in (slice(0, half), slice(half, 2 * half)):  # the block of 8 mm is 16 cm wide, and 85 cm away
            rows, columns = np.nonzero(white[:, eye] | ochre[:, eye])
            self.assertAlmostEqual(columns.mean() / half, 0.5, delta=0.15)
            self.assertGreater((white[:, eye] | ochre[:, eye]).mean(), 0.03)
            # Enamel is above dentin.
            self.assertLess(np.nonzero(white[:, eye])[0].mean(), np.nonzero(ochre[:, eye])[0].mean())
        # The eyes converge: what is near is further to the right in the left eye.
        self.assertGreater(np.nonzero(ochre[:, :half])[1].mean(), np.nonzero(ochre[:, half:])[1].mean() + 2)
        self.set_speed("0.5")
        self.browser.run("window.toothprep.play(true)")
        self.browser.wait_for("window.toothprep.state().time > 0.05 && window.toothprep.state().time < 5")
        self.browser.run("window.toothprep.play(false)")
        self.browser.run("document.getElementById('headset').click()")
        self.browser.wait_for("!window.toothprep.state().headset")
        drawn = self.browser.state()["pictures"]
        self.browser.run("window.toothprep.look('buccal')")
        self.browser.wait_for(f"window.toothprep.state().pictures > {drawn}")
        self.assertEqual(desk["target"], self.browser.state()["camera"]["target"])
        self.assertEqual(self.browser.run("window.headset.sessions"), ["immersive-vr"])

    def test_the_mirror_reflects_the_scene_and_is_dragged(self):
        self.show_replay()
        self.browser.run("window.toothprep.mirror(true)")
        with_tooth = self.pixels("mirror")
        mirror = self.browser.state()["mirror"]
        self.assertGreater(mirror["reflections"], 0)
        x, y = self.on_screen(mirror["position"])
        glass = (slice(y - 25, y + 25), slice(x - 25, x + 25))
        self.assertGreater(with_tooth[glass].max(), 110)  # the tooth, brighter than what is behind all
        self.browser.drag((x, y), (x - 60, y - 30))
        moved = self.browser.state()["mirror"]["position"]
        self.assertGreater(length(np.subtract(moved, mirror["position"])), 0.5)
        camera = self.browser.state()["camera"]["position"]
        self.browser.run("window.toothprep.mirror(false)")
        self.assertIsNone(self.browser.state()["mirror"])
        self.assertEqual(self.browser.state()["camera"]["position"], camera)  # the drag was the mirror's

    def test_sounds_follow_the_drill_and_the_lamps_and_are_switched_off(self):
        self.show_replay()
        stall = self.browser.state()["moments"]["stalls"][0]
        self.assertFalse(self.browser.state()["sound"]["on"])
        x, y = self.browser.run("(() => { const r = document.getElementById('sound').getBoundingClientRect();"
                                " return [r.left + r.width / 2, r.top + r.height / 2]; })()")
        self.browser.drag((x, y), (x, y))  # a click of the user: browsers want one
        self.browser.wait_for("window.toothprep.state().sound.on")
        state = self.browser.run("(window.toothprep.play(true), window.toothprep.seek(0.1), window.toothprep.state().sound)")
        self.assertEqual((state["drill_hz"], state["sounding"]), (420, []))  # without load
        state = self.browser.run(f"(window.toothprep.seek({stall}), window.toothprep.state().sound)")
        self.assertEqual((state["drill_hz"], state["sounding"]), (0, ["stall"]))
        self.browser.run("document.getElementById('lamp-stall').click()")
        state = self.browser.run(f"(window.toothprep.seek({stall}), window.toothprep.state().sound)")
        self.assertEqual((state["sounding"], state["muted"]), ([], ["stall"]))
        self.browser.run("document.getElementById('sound').click()")
        self.assertFalse(self.browser.state()["sound"]["on"])

    def test_two_recordings_lie_over_each_other(self):
        self.run_ok("replay", "--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--trajectory", "path.toml", "-o", "free.h5",
                    "--force")
        self.show("trace.h5", "free.h5", "--tooth", "block.vdb")
        with h5py.File(self.path("free.h5")) as file:
            time, bur = file["time"][()], file["bur/position"][()]
        row = int(0.8 * len(time))
        state = self.browser.run(f"window.toothprep.seek({time[row]!r})")
        self.assertEqual(state["other"]["time"], time[row])
        np.testing.assert_allclose(state["other"]["bur"], bur[row], rtol=1e-6, atol=1e-6)
        self.assertGreater(length(np.subtract(state["other"]["bur"], state["bur"])), 0.01)  # one stalled
        self.pixels("two-recordings")


class Scored(PageTest):
    """The report of a score, alone in an empty folder, and the page of what it wrote."""
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "cavity", "-o", "cut.vdb", "--original", "whole.vdb", "--target", "target.vdb", "--voxel-mm", "0.2",
                   "--offset-mm", "0.15")
        cls.run_ok("score", "--original", "whole.vdb", "--prepared", "cut.vdb", "--target", "target.vdb", "--type", "class1",
                   "-o", "score.json", "--report", "report")

    def test_the_report_holds_the_scene_and_loads_nothing(self):
        page = Path(self.path("report")) / "report.html"
        self.assertLess(page.stat().st_size, 5e6)
        self.browser.complaints.clear()
        self.browser.open(page.as_uri())
        self.browser.wait_for("window.toothprep && window.toothprep.state().ready")
        state = self.browser.state()
        self.assertTrue(state["deviation"])
        self.assertGreater(state["triangles"], 10000)
        self.assertGreater(state["triangles_before"], 10000)
        self.browser.run("document.getElementById('scene').scrollIntoView()")
        self.browser.run("new Promise((r) => setTimeout(r, 400))")
        self.picture("report")
        self.browser.run("(() => { const w = document.getElementById('wipe'); w.value = 0.5; w.dispatchEvent(new Event('input')); })()")
        self.browser.wait_for("window.toothprep.state().wipe === 0.5")
        self.assertEqual(self.browser.run("performance.getEntriesByType('resource').length"), 0)

    def test_without_webgl_the_report_shows_its_pictures(self):
        page = (Path(self.path("report")) / "report.html").read_text(encoding="utf-8")
        start, end = page.index("<script>//<![CDATA["), page.index("</script>", page.index("<script>//<![CDATA["))
        (Path(self.folder) / "other.html").write_text(page[:start] + "<script>1" + page[end:], encoding="utf-8")
        self.browser.open((Path(self.folder) / "other.html").as_uri())  # a script that the policy doesn't know
        self.browser.wait_for("document.readyState === 'complete' && document.querySelector('figure img') !== null")
        self.assertTrue(self.browser.run("document.getElementById('scene').hidden"))
        self.assertGreater(self.browser.run("document.querySelectorAll('figure img').length"), 3)
        self.assertTrue(any("Content Security Policy" in c for c in self.browser.complaints), self.browser.complaints)
        self.browser.open("about:blank")
        self.browser.run("0")
        self.browser.complaints.clear()

    def pixels(self, name):
        self.browser.run("new Promise((r) => setTimeout(r, 400))")
        data = self.picture(name) if name else self.browser.picture()
        return 255 * matplotlib.image.imread(io.BytesIO(data))[60:, :, :3]

    def share_of_blue(self, name):
        image = self.pixels(name)
        return (image[..., 2] > image[..., 0] + 25).mean()

    def share_of_ochre(self, name):
        image = self.pixels(name)
        return ((image[..., 0] > 120) & (image[..., 2] < 0.75 * image[..., 0]) & (image[..., 1] > 0.6 * image[..., 0])).mean()

    def test_the_page_of_a_report_shows_the_deviation(self):
        self.show("report")
        self.browser.run("window.toothprep.look('distal')")  # the mesh has no frame; the cavity opens to +y
        blue = self.share_of_blue("deviation")  # 0.15 mm too much was taken
        self.assertGreater(blue, 0.01)
        self.browser.run("document.getElementById('deviation').click()")
        self.assertLess(self.share_of_blue(None), 0.5 * blue)
        self.assertEqual(self.browser.state()["triangles_before"], 0)

    def test_the_page_of_a_score_has_both_teeth_and_the_deviation(self):
        self.show("score.json")
        state = self.browser.state()
        self.assertEqual((state["kind"], state["wipe"], state["triangles_before"] > 1000), ("surfaces", 0.5, True))
        self.browser.run("window.toothprep.wipe(0)")
        self.browser.run("window.toothprep.look('occlusal')")
        blue = self.share_of_blue("score")
        self.assertGreater(blue, 0.01)
        self.browser.run("document.getElementById('deviation').click()")
        self.assertLess(self.share_of_blue(None), 0.2 * blue)
        self.browser.run("document.getElementById('deviation').click()")
        self.browser.run("window.toothprep.section({kind: 'mesial', offset: 0})")
        self.browser.run("window.toothprep.look('mesial')")
        self.assertGreater(self.share_of_ochre("score-section"), 0.01)


class Surfaces(PageTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "molar", "-o", "molar.vdb", "--voxel-mm", "0.2")
        cls.run_ok("mesh", "molar.vdb", "-o", "molar.stl")

    def test_a_tooth_shows_its_tissues_and_its_pulp_in_a_section(self):
        self.show("molar.vdb")
        self.browser.run("window.toothprep.look('mesial')")
        self.browser.run("window.toothprep.section({kind: 'mesial', offset: 0})")
        self.browser.run("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
        self.picture("molar-section")
        image = 255 * matplotlib.image.imread(io.BytesIO(self.browser.picture()))[60:, :, :3]
        red = (image[..., 0] > 1.8 * image[..., 1]) & (image[..., 0] > 80)
        ochre = (image[..., 0] > 150) & (image[..., 2] < 0.75 * image[..., 0]) & ~red
        bright = (image > 170).all(axis=-1)
        for name, area in (("pulp", red), ("dentin", ochre), ("enamel", bright)):
            self.assertGreater(area.mean(), 0.002, name)

    def test_a_mesh_and_a_tooth_before_it(self):
        self.show("molar.vdb", "molar.stl")
        state = self.browser.state()
        self.assertEqual((state["kind"], state["wipe"]), ("surfaces", 0.5))
        self.assertEqual(state["triangles"], int.from_bytes(self.read("molar.stl")[80:84], "little"))
        # The same surface by two ways; the mesh's triangles are divided where tissues meet.
        self.assertGreater(state["triangles"], state["triangles_before"])
        self.assertLess(state["triangles"], 1.05 * state["triangles_before"])
        self.browser.run("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
        self.picture("two-surfaces")


class Live(PageTest):
    """A session with a simulated hand on the same path, and strangers at its port."""
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_ok("specimen", "block", "-o", "block.vdb", "--voxel-mm", "0.2")
        # The bur starts when it was clear of the tooth for half a second.
        cls.write("path.toml", PATH.replace("speed_mm_s = 8.0", "speed_mm_s = 1.0", 1).replace("speed_mm_s = 2.5", "speed_mm_s = 0.4"))

    def begin(self, name, *options, hand="path.toml", real_time=("--no-real-time",)):
        viewer = Viewer("--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--hand", hand, *real_time, "--stale-s", "10",
                        "--duration-s", "250", "--view", "--no-open", "-o", name, *options, cwd=self.folder, command="live")
        self.addCleanup(viewer.end)
        self.addCleanup(self.browser.open, "about:blank")
        self.open(viewer)
        return viewer

    def finish(self, viewer, name):
        """The rows of the recording, after Ctrl-C."""
        stderr, status = viewer.end()
        self.assertEqual(status, 0, stderr)
        self.browser.open("about:blank")  # the page would try to connect every second, and complain each time
        self.browser.run("0")  # what it has said until now
        self.browser.complaints[:] = [c for c in self.browser.complaints if "WebSocket" not in c]  # that it is over
        with h5py.File(self.path(name)) as file:
            return {name: file[name][()] for name in ("time", "bur/position", "handle/position", "force/device")}

    def test_shows_the_rows_of_the_recording_and_the_tooth_as_it_is_cut(self):
        viewer = self.begin("session.h5")
        self.browser.wait_for("window.toothprep.state().time > 1")
        early = self.browser.state()
        self.browser.wait_for("window.toothprep.state().removed_mm3 > 0.2")
        late = self.browser.state()
        self.picture("live")
        self.assertEqual(early["kind"], "live")
        self.assertGreater(late["time"], early["time"])
        self.browser.wait_for(f"window.toothprep.state().generation > {early['generation']}")
        self.assertEqual(late["lamps"]["fault"], False)  # a device has them
        rows = self.finish(viewer, "session.h5")
        for state in (early, late):
            row = int(np.argmin(np.abs(rows["time"] - state["time"])))
            self.assertEqual(rows["time"][row], state["time"])
            for key, name in (("bur", "bur/position"), ("handle", "handle/position"), ("force", "force/device")):
                np.testing.assert_allclose(state[key], rows[name][row], rtol=1e-6, atol=1e-6)

    def test_the_mirror_moves_as_the_second_device_does(self):
        self.write("mirror.toml", "rate_hz = 100\nstart_mm = [-6, 5, 0]\naxis = [0, 0.6, 0.8]\n[[segment]]\nkind = \"line\"\n"
                                  "to_mm = [6, 5, 3]\nspeed_mm_s = 1\n")
        viewer = self.begin("mirrored.h5", "--mirror-hand", "mirror.toml")
        self.browser.run("window.toothprep.mirror(true)")
        shown = self.browser.state().get("time", 0)  # or no row yet; the mirror follows from the next one on
        self.browser.wait_for(f"window.toothprep.state().time > {max(1, shown)}")
        early = self.browser.state()
        # Half a millimetre: half a second, or as long as a loaded machine takes.
        self.browser.wait_for("Math.hypot(...window.toothprep.state().mirror.position.map("
                              f"(x, i) => x - {json.dumps(early['mirror']['position'])}[i])) > 0.5")
        late = self.browser.state()
        moved = np.subtract(late["mirror"]["position"], early["mirror"]["position"])
        self.assertGreater(late["mirror"]["reflections"], early["mirror"]["reflections"])
        self.finish(viewer, "mirrored.h5")
        with h5py.File(self.path("mirrored.h5")) as file:
            times, places = file["time"][()], file["mirror/position"][()]
        place = {name: places[int(np.argmin(np.abs(times - state["time"])))] for name, state in (("early", early), ("late", late))}
        np.testing.assert_allclose(moved, place["late"] - place["early"], atol=1e-4)

    def click(self, name):
        self.browser.run(f"document.getElementById('do-{name}').click()")

    def wait_for_control(self, condition):
        self.browser.wait_for(f"(() => {{ const c = window.toothprep.state().live.control; return c && {condition}; }})()")
        return self.browser.state()["live"]["control"]

    def test_is_paused_taken_back_changed_and_ended_from_the_page_and_replays_to_the_bit(self):
        # Into the side and there for long: the tooth is moved away from the bur in the end.
        self.write("in.toml", PATH.replace("speed_mm_s = 8.0", "speed_mm_s = 1.0", 1).replace("[[-1.0, -1.0, 0.0]]", "[[-2.0, -1.0, 0.0]]")
                   .replace("speed_mm_s = 2.5", "speed_mm_s = 0.4").rsplit("[[segment]]", 1)[0] +
                   '[[segment]]\nkind = "hold"\nduration_s = 200.0\n')
        viewer = self.begin("controlled.h5", "--control", hand="in.toml", real_time=())
        self.browser.wait_for("window.toothprep.state().removed_mm3 > 0.1")
        self.click("undo")  # disabled: nothing is asked
        self.browser.run("window.toothprep.control({do: 'undo'})")
        self.wait_for_control("c.note === 'undo: pause first'")
        self.click("pause")
        self.wait_for_control("c.state === 'paused' && c.undoable === 1")
        self.browser.wait_for("window.toothprep.state().lamps.paused")
        cut = self.browser.state()
        self.assertGreater(cut["removed_mm3"], 0.1)
        self.picture("paused")
        self.click("undo")
        self.browser.wait_for("window.toothprep.state().removed_mm3 === 0")
        self.browser.wait_for(f"window.toothprep.state().generation > {cut['generation']}")
        self.browser.run("(() => { const s = document.getElementById('do-bur'); s.value = '3'; s.dispatchEvent(new Event('change')); })()")
        self.wait_for_control("c.bur === 3")
        bur = self.browser.state()["bur_name"]
        handle = self.browser.state()["handle"]
        self.browser.run("window.toothprep.control({do: 'move', shift_mm: [-6, 0, 0], turn_deg: 0})")
        self.browser.wait_for(f"window.toothprep.state().handle[0] < {handle[0]} - 5")
        self.click("resume")
        self.wait_for_control("c.state === 'running'")
        self.browser.wait_for("!window.toothprep.state().lamps.paused")
        self.assertNotEqual(bur, "cylinder:D1.2xL3.0")
        self.picture("another-bur")
        self.click("end")
        self.click("end")
        self.assertEqual(viewer.process.wait(timeout=60), 0)
        stderr = viewer.process.stderr.read()
        self.assertIn("ended from the page", stderr)
        self.browser.open("about:blank")  # it would go on asking
        self.browser.run("0")
        self.browser.complaints[:] = [c for c in self.browser.complaints if "WebSocket" not in c]
        self.check_recording_with_events("controlled.h5")

    def check_recording_with_events(self, name):
        kinds = ["", "pause", "resume", "undo", "bur", "registration", "end"]
        with h5py.File(self.path(name)) as file:
            self.assertEqual(file.attrs["schema_version"], 2)
            self.assertEqual([kinds[k] for k in file["events/kind"]], ["pause", "undo", "bur", "registration", "resume", "end"])
            time, removed = file["time"][()], file["removed/volume"][()].sum(axis=1)
            undone = np.searchsorted(time, file["events/time"][1])
            self.assertEqual(time[undone], file["events/time"][1])
            self.assertGreater(removed[undone - 1], 0.1)
            self.assertEqual(removed[undone], 0)  # it falls at the undo
            self.assertGreater(file.attrs["removed_energy_mJ"], 0)  # and the audit counts what was undone
            live = {key: file[key][()] for key in ("bur/position", "force/device", "torque", "removed/volume", "time")}
        self.run_ok("replay", "--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--trajectory", name, "-o", "again.h5")
        with h5py.File(self.path("again.h5")) as file:
            for key, values in live.items():
                np.testing.assert_array_equal(values, file[key][()], key)
            self.assertEqual(file.attrs["schema_version"], 2)
        self.run_ok("replay", "--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--trajectory", "again.h5", "-o", "third.h5")
        info = json.loads(self.run_ok("info", name, "--json").stdout)
        self.assertEqual([e["kind"] for e in info["events"]], ["pause", "undo", "bur", "registration", "resume", "end"])
        self.run_ok("export", name, "-o", "table.csv")
        report = json.loads(self.run_ok("rig-check", name, "--tooth", "block.vdb", "--json").stdout)
        self.assertEqual(report["replay_differing_rows"], 0)
        self.show(name, "--tooth", "block.vdb")
        self.browser.wait_for("window.toothprep.state().recomputed.finished")
        recomputed = self.browser.state()["recomputed"]
        self.assertEqual((recomputed["bur_difference_mm"], recomputed["force_difference_n"], recomputed["failure"]), (0, 0, ""))
        self.assertEqual(self.browser.run(f"window.toothprep.seek({live['time'][-1]})")["bur_name"], info["events"][2]["bur"])

    def test_a_page_without_control_can_only_look_and_nonsense_and_floods_do_nothing(self):
        viewer = self.begin("looked-at.h5")
        self.assertTrue(self.browser.run("document.getElementById('control').hidden"))
        self.browser.run("window.toothprep.control({do: 'end'})")
        self.browser.wait_for("window.toothprep.state().live.control && window.toothprep.state().live.control.refused")
        self.assertIn("can only look", self.browser.state()["live"]["control"]["refused"])
        self.finish(viewer, "looked-at.h5")
        viewer = self.begin("flooded.h5", "--control")
        feed = viewer.address.replace("http", "ws") + "feed"
        stranger = self.connect(feed, f"http://127.0.0.1:{viewer.port}")
        for nonsense in ("", "{", "[]", "null", '"end"', '{"do": 3}', '{"do": "start"}', '{"do": "registration"}', '{"do": "bur"}',
                         '{"do": "bur", "bur": -1}', '{"do": "bur", "bur": 1e9}', '{"do": "bur", "bur": "1"}', '{"do": "end", "now": 1}',
                         '{"do": "move", "shift_mm": [1, 2], "turn_deg": 0}', '{"do": "move", "shift_mm": [1e9, 0, 0], "turn_deg": 0}',
                         '{"do": "move", "shift_mm": [0, 0, null], "turn_deg": 0}', 300 * "[", '\x00\xff'):
            stranger.send(nonsense)
            self.refusal(stranger)
        for _ in range(2000):  # read at 50 Hz: they wait in the network, or the line is cut
            try:
                stranger.send('{"do": "undo"}')
            except (browser.websocket.WebSocketException, OSError):
                break
        self.browser.wait_for("window.toothprep.state().time > 2")
        self.assertEqual(self.browser.state()["live"]["control"]["state"], "running")
        stranger.shutdown()
        self.finish(viewer, "flooded.h5")
        with h5py.File(self.path("flooded.h5")) as file:
            self.assertEqual((file.attrs["schema_version"], len(file["events/time"])), (1, 0))
        self.run_ok("info", "flooded.h5")

    def refusal(self, line):
        while True:
            message = line.recv()
            if message[:4] == b"\x03\0\0\0" and "refused" in json.loads(message[4:]):
                return

    def test_strangers_and_bad_pages_do_the_session_no_harm(self):
        viewer = self.begin("attacked.h5")
        feed = viewer.address.replace("http", "ws") + "feed"
        for address, origin in ((feed, "http://evil.example"), (feed, None), (feed.replace(viewer.token, 32 * "0"), "own"),
                                (feed + "2", "own")):
            with self.assertRaises((browser.websocket.WebSocketException, OSError)):
                self.connect(address, f"http://127.0.0.1:{viewer.port}" if origin == "own" else origin)
        own = f"http://127.0.0.1:{viewer.port}"
        silent = [self.connect(feed, own) for _ in range(5)]  # they read nothing
        loud = self.connect(feed, own)
        with self.assertRaises((browser.websocket.WebSocketException, OSError)):
            loud.send(100000 * "x")
            while True:
                loud.recv()
        self.browser.wait_for("window.toothprep.state().time > 2")
        before = self.browser.state()["live"]["messages"]
        self.browser.wait_for(f"window.toothprep.state().live.messages > {before + 5}")
        for one in silent:
            one.shutdown()
        rows = self.finish(viewer, "attacked.h5")
        self.assertGreater(len(rows["time"]), 1000)

    def connect(self, address, origin):
        return browser.websocket.create_connection(address, timeout=20, suppress_origin=origin is None, origin=origin)


if __name__ == "__main__":
    if browser.why_not():
        print(f"left out: {browser.why_not()}")
    unittest.main(argv=sys.argv[:1])
