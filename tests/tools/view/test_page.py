"""The page in a real browser: what it shows is what the files hold.

Usage: test_page.py TOOTHPREP SOURCE_FOLDER [PICTURES]: pictures of the page are left in that folder.
"""
import io
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


@unittest.skipIf(browser.why_not(), browser.why_not())
class PageTest(CommandTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.browser = browser.Browser()
        cls.addClassCleanup(cls.browser.close)

    def show(self, *arguments):
        viewer = Viewer(*arguments, cwd=self.folder)
        self.addCleanup(viewer.end)
        self.addCleanup(self.browser.open, "about:blank")  # before that
        self.browser.complaints.clear()
        self.browser.open(viewer.address)
        self.browser.wait_for("window.toothprep && window.toothprep.state().ready")
        return viewer

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

    def test_every_number_is_the_traces(self):
        self.show("trace.h5", "--tooth", "block.vdb")
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
        def triangles(tooth):
            self.run_ok("mesh", tooth, "-o", "surface.ply", "--force")
            header = self.read("surface.ply").split(b"end_header")[0].decode()
            return int(header.split("element face ")[1].split()[0])
        self.show("trace.h5", "--tooth", "block.vdb")
        seek = lambda time: self.browser.run(f"window.toothprep.seek({time})")
        end = self.trace["time"][-1]
        whole, cut = triangles("block.vdb"), triangles("prepared.vdb")
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
        self.show("trace.h5", "--tooth", "block.vdb")
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

    def test_plays_pauses_and_goes_at_the_speed_asked_for(self):
        self.show("trace.h5", "--tooth", "block.vdb")
        self.browser.run("""(() => { const s = document.getElementById('speed'); s.value = '20';
                             s.dispatchEvent(new Event('change')); })()""")
        self.assertEqual(self.browser.state()["speed"], 20)
        self.browser.run("document.getElementById('play').click()")
        self.browser.wait_for("!window.toothprep.state().playing && window.toothprep.state().time > 0")
        self.assertEqual(self.browser.state()["row"], len(self.trace["time"]) - 1)  # to the end, and stops
        self.browser.run("document.getElementById('play').click()")  # from the beginning again
        self.browser.wait_for("window.toothprep.state().time < 2 || window.toothprep.state().time > 0")
        self.browser.run("window.toothprep.play(false)")
        stood = self.browser.state()["time"]
        self.assertEqual(self.browser.run("new Promise((r) => setTimeout(() => r(window.toothprep.state().time), 200))"), stood)

    def test_the_time_line_is_dragged(self):
        self.show("trace.h5", "--tooth", "block.vdb")
        box = self.browser.run("(() => { const r = document.getElementById('line-plot').getBoundingClientRect();"
                               " return [r.left, r.top, r.width, r.height]; })()")
        x, y = box[0] + 0.3 * box[2], box[1] + 0.4 * box[3]
        self.browser.drag((x, y), (box[0] + 0.8 * box[2], y))
        share = self.browser.state()["time"] / self.trace["time"][-1]
        self.assertAlmostEqual(share, 0.8, delta=0.04)

    def test_turns_cuts_and_compares(self):
        self.show("trace.h5", "--tooth", "block.vdb")
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
        self.assertEqual(state["triangles"], state["triangles_before"])  # the same surface by two ways
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

    def begin(self, name):
        viewer = Viewer("--tooth", "block.vdb", "--bur", "cylinder:D1.2xL3.0", "--hand", "path.toml", "--no-real-time",
                        "--duration-s", "250", "--view", "--no-open", "-o", name, cwd=self.folder, command="live")
        self.addCleanup(viewer.end)
        self.addCleanup(self.browser.open, "about:blank")
        self.browser.complaints.clear()
        self.browser.open(viewer.address)
        self.browser.wait_for("window.toothprep && window.toothprep.state().ready")
        return viewer

    def finish(self, viewer, name):
        """The rows of the recording, after Ctrl-C."""
        stderr, status = viewer.end()
        self.assertEqual(status, 0, stderr)
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
