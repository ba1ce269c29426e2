"""The judge of live sessions finds what is wrong with made-up logs and recordings, and nothing with good ones."""
import tempfile
import unittest
from pathlib import Path

import h5py
import numpy as np

import judge
from judge import ERROR, FRAME_ENDED, GONE, JUMPED, OUTPUT, RELEASED, STANDS, SWITCH_OPEN, UNCALIBRATED, Rules

TICKS, FIRST, END = 1200, 20, 1100  # in all; the first recorded one; the first after the session's last step
BEGAN, GOOD = 600, 601  # a fault of one tick, and the next one


def good_rows(fault=0):
    """A hand that moves at 1 mm/s, a force of 2 N from 0.3 s on, at most as the ramp allows, and out within 50 ms; with a
    fault of one tick."""
    rows = np.zeros(TICKS, judge.ROW)
    n = np.arange(TICKS)
    rows["tick"], rows["time"] = n, 100 + 1e-3 * n
    rows["position"][:, 2] = 1e-3 * n
    rows["orientation"][:, 3] = 1
    rows["flags"] = OUTPUT | FRAME_ENDED
    force = 2.0 * (n >= 300) * np.clip((END - n) / 50, 0, 1)
    since = n.copy()
    if fault:
        rows["flags"][BEGAN] |= fault
        zero = GOOD if fault & ERROR else BEGAN
        force[zero] = 0
        since[zero:] -= zero
    rows["motor"][:, 0] = rows["commanded"][:, 0] = np.minimum(force, 7.9 * since / 250)
    return rows


class JudgeTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory(prefix="toothprep-judge-")
        self.addCleanup(self.folder.cleanup)
        self.log, self.recording = (Path(self.folder.name) / name for name in ("ticks.log", "session.h5"))

    def write(self, rows, released=True, record=None, places=None, complete=1):
        """A log, and what a program that recorded it truly would have written; `record` changes that."""
        log = rows
        if released:
            last = rows[-1:].copy()
            last["flags"] |= RELEASED
            last["motor"] = 0
            log = np.concatenate([rows, last])
        head = b"toothprep-ticks\0" + np.float64(1000).tobytes() + np.uint64([places or len(log), len(log)]).tobytes()
        self.log.write_bytes(head.ljust(128, b"\0") + log[:places].tobytes())
        kept = slice(FIRST, END + 1)
        rejected = (rows["flags"][kept] & JUMPED) != 0
        bur = rows["position"][kept].copy()
        bur[1:][rejected[1:]] = bur[:-1][rejected[1:]]
        removed = np.zeros((len(rejected), 4))
        removed[:, 0] = np.cumsum(np.where(rejected, 0, 1e-4))
        data = {
            "/time": 1e-3 * np.arange(len(rejected)), "/servo/tick": rows["tick"][kept],
            "/servo/force_sent": rows["commanded"][FIRST - 1:END], "/servo/flags": np.where(rejected, 128 | 32, 0),
            "/device/position": rows["position"][kept], "/handle/position": rows["position"][kept],
            "/reading_rejected": rejected.astype(np.uint8), "/bur/position": bur, "/removed/volume": removed,
        }
        if record:
            record(data)
        with h5py.File(self.recording, "w", libver="latest") as file:
            file.attrs["complete"] = complete
            for name, values in data.items():
                file[name] = values

    def found(self, rows=None, rules=None, **more):
        self.write(good_rows() if rows is None else rows, **more)
        return judge.findings(self.log, self.recording, rules or Rules())

    def assert_found(self, words, found):
        self.assertTrue(any(words in line for line in found), f"{words!r} is not in {found}")

    def jumped(self, change=None, record=None):
        rows = good_rows(JUMPED)
        rows["position"][BEGAN] += (0, -20, 0)
        if change:
            change(rows)
        return self.found(rows, record=record)

    def test_nothing_is_wrong_with_good_sessions(self):
        self.assertEqual(self.found(), [])
        self.assertEqual(self.jumped(), [])
        for flag in (ERROR, SWITCH_OPEN):
            self.assertEqual(self.found(good_rows(flag)), [])

    def test_force_at_the_end(self):
        rows = good_rows()
        rows["motor"][-1, 0] = rows["commanded"][-1, 0] = 0.1
        self.assert_found("the last force that was sent is 0.1 N", self.found(rows))
        found = self.found(rows, released=False)
        self.assert_found("the motors hold 0.1 N at the end", found)
        found = self.found(rows, Rules(force_may_stand=True), released=False)
        self.assertFalse(any("at the end" in line or "last force" in line for line in found), found)

    def test_a_kick(self):
        rows = good_rows()
        rows["motor"][700, 0] += 3.1
        self.assert_found("a kick of 3.1 N", self.found(rows))
        rows = good_rows()
        rows["motor"][700, 1] = np.nan
        self.assert_found("not finite", self.found(rows))

    def test_a_force_that_vanishes_in_a_tick_without_a_cause(self):
        rows = good_rows()
        rows["motor"][700:, 0] = rows["commanded"][700:, 0] = 0
        self.assert_found("not ramped out: the force falls by 2 N", self.found(rows))

    def test_a_force_that_is_not_ramped_in(self):
        rows = good_rows()
        rows["motor"][5, 0] = 0.5
        self.assert_found("not ramped in: 0.5 N, 6 ticks after zero", self.found(rows))
        self.assert_found("not ramped in", self.jumped(lambda rows: rows["motor"].__setitem__((GOOD, 0), 2)))

    def test_a_force_after_a_pause_of_the_machine(self):
        rows = good_rows()
        rows["time"][700:] += 0.2
        rows["motor"][700, 0] = 0
        self.assert_found("not ramped in: 2 N, 1 ticks after zero", self.found(rows))

    def test_force_while_the_device_says_that_there_must_be_none(self):
        for flag, words in ((JUMPED, "cannot be true"), (SWITCH_OPEN, "nobody holds"), (GONE, "gone")):
            rows = good_rows()
            rows["flags"][BEGAN] |= flag
            self.assert_found(words, self.found(rows))
        for flag, words, ticks in ((ERROR, "the driver reports an error", 2), (UNCALIBRATED, "without calibration", 200),
                                   (STANDS, "a pose that stands", 300)):
            rows = good_rows()
            rows["flags"][BEGAN:BEGAN + ticks] |= flag
            self.assert_found(words, self.found(rows))

    def test_a_log_that_was_too_short(self):
        self.assert_found("ticks are not in the log", self.found(places=1000))

    def test_a_reading_that_was_believed(self):
        def believe(data):
            data["/reading_rejected"][:] = 0
            data["/servo/flags"][:] = 0
        found = self.jumped(record=believe)
        self.assert_found("was believed at tick 600", found)
        self.assert_found("the handle jumped 20 mm", found)

    def test_an_implausible_reading_that_cuts_or_moves_the_bur(self):
        def cut(data):
            data["/removed/volume"][BEGAN - FIRST:, 0] += 1.95
        self.assert_found("an implausible reading cut 1.95 mm3", self.jumped(record=cut))

        def move(data):
            data["/bur/position"][BEGAN - FIRST] += (0, -1.7, 0)
        found = self.jumped(record=move)
        self.assert_found("an implausible reading moved the bur", found)
        self.assert_found("the bur jumped 1.7 mm", found)

    def test_a_good_reading_that_was_rejected(self):
        def reject(data):
            data["/reading_rejected"][100] = 1
            data["/servo/flags"][100] = 128
            data["/bur/position"][100] = data["/bur/position"][99]
            data["/removed/volume"][100:, 0] -= 1e-4
        self.assert_found("a good reading was rejected at tick 120", self.found(record=reject))

    def test_a_hand_that_is_rejected_after_a_pause_is_elsewhere(self):
        """Moved by so much in the first reading after a pause of 60 ms, or in the second."""
        for first, then, wrong in ((0.06, 0, True), (0, 0.06, True), (0.5, 0, True), (0, 0.5, True), (0.6, 0, False),
                                   (0, 0.6, False)):
            rows = good_rows()
            rows["time"][700:] += 0.06
            rows["position"][700:, 2] += first
            rows["position"][701:, 2] += then
            at = 700 if first else 701

            def reject(data):
                data["/reading_rejected"][at - FIRST] = 1
                data["/servo/flags"][at - FIRST] = 128
                data["/bur/position"][at - FIRST] = data["/bur/position"][at - FIRST - 1]
                data["/removed/volume"][at - FIRST:, 0] -= 1e-4
            found = self.found(rows, record=reject)
            self.assertEqual(any(f"a good reading was rejected at tick {at}" in line for line in found), wrong, found)

    def test_a_pause_does_not_make_a_pose_stand(self):
        rows = good_rows()
        rows["flags"][BEGAN:BEGAN + 100] |= STANDS
        rows["time"][BEGAN + 50:] += 1
        self.assertFalse(any("stands" in line for line in self.found(rows)))

    def test_flags_that_differ(self):
        self.assert_found("differ", self.found(record=lambda data: data["/servo/flags"].__setitem__(3, 128)))

    def test_tissue_that_comes_back(self):
        self.assert_found("came back", self.found(record=lambda data: data["/removed/volume"].__setitem__((500, 0), 1)))

    def test_a_recording_that_says_something_else(self):
        self.assert_found("positions are not those",
                          self.found(record=lambda data: data["/device/position"].__setitem__((40, 1), 1e-12)))
        self.assert_found("forces are not those",
                          self.found(record=lambda data: data["/servo/force_sent"].__setitem__((700, 0), 1.99)))

    def test_rows_that_are_missing(self):
        def hole(data):
            for name in data:
                data[name] = np.delete(data[name], 300, axis=0)
        self.assert_found("1 ticks are missing", self.found(record=hole))

        def short(data):
            for name in data:
                data[name] = data[name][:-100]
        self.assert_found("force after the last recorded row, in 99 ticks", self.found(record=short))
        rules = Rules(recording="incomplete", most_unrecorded=150)
        self.assert_found("199 ticks at the end are not in the recording", self.found(rules=rules, record=short, complete=0))
        self.assertEqual(self.found(rules=Rules(recording="incomplete", most_unrecorded=200), record=short, complete=0), [])

    def test_a_recording_that_is_not_there_or_no_recording(self):
        self.write(good_rows())
        self.recording.write_bytes(self.recording.read_bytes()[:3000])
        self.assert_found("cannot be read", judge.findings(self.log, self.recording, Rules()))
        self.recording.unlink()
        self.assert_found("cannot be read", judge.findings(self.log, self.recording, Rules()))
        self.assertEqual(judge.findings(self.log, self.recording, Rules(recording="absent")), [])
        self.assert_found("never began", self.found(rules=Rules(recording="absent")))

    def test_a_recording_marked_wrongly(self):
        self.assert_found("not marked as complete", self.found(complete=0))
        self.assert_found("marked as complete", self.found(rules=Rules(recording="incomplete", most_unrecorded=200)))

    def test_a_machine_that_gave_a_session_too_few_ticks_shows_in_the_log(self):
        rows = good_rows()
        self.write(rows)
        self.assert_withheld(0, 1)
        rows["time"][FIRST:] += 10  # before the session began
        rows["time"][END + 1:] += 10  # after its last row
        self.assert_withheld(0, 1, rows)
        rows["time"][400:] += 0.12
        self.assert_withheld(0.12 / (0.12 + 1e-3 * (END + 1 - FIRST)), 121, rows)
        self.recording.unlink()
        share, longest = judge.withheld(self.log, self.recording)
        self.assertAlmostEqual(longest, 10.001)
        self.assertAlmostEqual(share, 1 - 1200 / 21320)
        rows = good_rows()
        rows["time"][30::20] += 6e-4  # 1.6 ms and 0.4 ms
        self.assert_withheld(54 / (54 + END + 1 - FIRST), 1.6, rows)
        self.assertEqual(judge.withheld(self.log.with_name("none.log"), self.recording), (0, 0))

    def assert_withheld(self, share, longest_ms, rows=None):
        self.write(good_rows() if rows is None else rows)
        found = judge.withheld(self.log, self.recording)
        self.assertAlmostEqual(found[0], share)
        self.assertAlmostEqual(1e3 * found[1], longest_ms)


if __name__ == "__main__":
    unittest.main()
