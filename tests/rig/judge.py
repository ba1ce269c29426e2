"""Judges a live session by what the stand-in library was sent, tick by tick, and by the recording.

Independent of toothprep: the stand-in's log is read as its README describes it, the recording with h5py.
`findings(log, recording, rules)` is empty if nothing is wrong.
"""
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

# A row of the log: lib/toothprep/proof/libhd_stand_in/README.md.
ROW = np.dtype([("tick", "<i8"), ("time", "<f8"), ("position", "<f8", 3), ("orientation", "<f8", 4), ("buttons", "<u4"),
                ("flags", "<u4"), ("commanded", "<f8", 3), ("motor", "<f8", 3)])
JUMPED, STANDS, ERROR, UNCALIBRATED, GONE, SWITCH_OPEN, OUTPUT, FRAME_ENDED, RELEASED = (1 << i for i in range(9))
RECORDED_REJECTED, RECORDED_WITHHELD = 128, 32  # bits of /servo/flags


@dataclass
class Rules:
    """What a session may do. Forces in N, times in s."""
    rate_hz: float = 1000
    max_force: float = 7.9
    max_change: float = 3.0  # in a tick, unless to zero for a cause
    ramp: float = 0.25  # of the force, from the start and after a cause for zero
    fade: float = 0.05  # of the force, at an end in order
    frozen_after: float = 0.25
    calibration_within: int = 60  # ticks
    fades: bool = True  # it ends in order
    cause_at: tuple = ()  # ticks from which something that the log doesn't say is a cause for zero force
    force_may_stand: bool = False  # at the end: nobody was left to make it zero
    recording: str = "complete"  # "incomplete": ended without its program; "absent"
    most_unrecorded: int = 0  # ticks at the end that may be missing
    largest_step: float = 1.0  # mm of the handle in a tick, between readings that were believed
    largest_bur_step: float = 0.5  # mm
    gap: float = 0.05  # s without a reading: a pause
    near: float = 0.5  # mm between readings of a hand that hasn't moved
    longest_way: float = 0.1  # s for which a hand is taken to have gone on in a pause


@dataclass
class Log:
    rows: np.ndarray  # of ticks
    released: np.ndarray  # rows that are no ticks: the motors let go
    lost: int = 0  # rows that the file had no place for
    last: np.ndarray = field(default=None)


def read_log(path):
    data = Path(path).read_bytes()
    if data[:15] != b"toothprep-ticks":
        raise ValueError(f"{path}: not the log of a stand-in")
    most, count = np.frombuffer(data, "<u8", 2, 24)
    rows = np.frombuffer(data, ROW, int(min(most, count)), 128)
    ticks = rows[(rows["flags"] & RELEASED) == 0]
    return Log(ticks, rows[(rows["flags"] & RELEASED) != 0], int(max(0, count - min(most, count))),
               rows[-1] if len(rows) else None)


def withheld(log, recording, rules=Rules()):
    """What the machine left out while the session was recorded, or of the log: the share of the servo's ticks, a gap above
    1.5 periods rounded, and the longest time (s) without one; 0 without a log."""
    rows = read_log(log).rows if Path(log).exists() else ()
    if not len(rows):
        return 0, 0
    try:
        with h5py.File(recording, "r", swmr=True) as file:
            rows = rows[file["/servo/tick"][0]:file["/servo/tick"][-1] + 1]
    except (KeyError, OSError, ValueError):
        pass
    gaps = np.diff(rows["time"])
    missed = np.maximum(np.rint(gaps * rules.rate_hz) - 1, 0).sum()
    return missed / (missed + len(rows)), gaps.max(initial=0)


def norm(vectors):
    return np.linalg.norm(vectors, axis=-1)


def times(indices, rows):
    """The first few places of a finding, for a reader."""
    return "at tick " + ", ".join(str(rows["tick"][i]) for i in indices[:4]) + (", ..." if len(indices) > 4 else "")


def after(rows):
    """The rows after these."""
    return np.concatenate([[False], rows[:-1]])


def frozen_too_long(rows, rules):
    """Rows whose pose has stood, to the bit, for longer than is believed; a pause counts as the gap."""
    stands = (rows["flags"] & STANDS) != 0
    began = np.where(stands & ~after(stands), np.arange(len(rows)), -1)
    began = np.maximum.accumulate(began)
    time = np.cumsum(np.minimum(np.diff(rows["time"], prepend=rows["time"][0]), rules.gap))
    since = time - time[np.maximum(began, 0)]
    return stands & (since > rules.frozen_after + 0.01)


def force_findings(log, rules):
    """What the motors did."""
    rows = log.rows
    found = []
    if log.lost:
        found.append(f"{log.lost} ticks are not in the log")
    if len(rows) == 0:
        return found
    flags, motor = rows["flags"], rows["motor"]
    force = norm(motor)
    if not np.isfinite(motor).all():
        found.append("a force that is not finite")
    for name, wrong in (
            ("force at a reading that cannot be true", (flags & JUMPED) != 0),
            ("force while nobody holds the stylus", (flags & SWITCH_OPEN) != 0),
            ("force on a device that is gone", (flags & GONE) != 0),
            ("force at a pose that stands", frozen_too_long(rows, rules))):
        at = np.flatnonzero(wrong & (force > 0))
        if len(at):
            found.append(f"{name}: {force[at].max():.3g} N {times(at, rows)}")
    error = (flags & ERROR) != 0
    after_error = after(error)  # what is reported at a frame's end acts on the next
    at = np.flatnonzero(error & after_error & (force > 0))
    if len(at):
        found.append(f"force while the driver reports an error: {force[at].max():.3g} N {times(at, rows)}")
    uncalibrated = np.flatnonzero(flags & UNCALIBRATED)
    if len(uncalibrated):
        late = np.flatnonzero(force > 0)
        late = late[late > uncalibrated[0] + rules.calibration_within]
        if len(late):
            found.append(f"force without calibration: {force[late].max():.3g} N {times(late, rows)}")
    return found + change_findings(rows, force, rules) + end_findings(log, rules)


def causes(rows, rules):
    """Rows in which zero force has a cause: a fault now or in the tick before, or a pause."""
    bad = (rows["flags"] & (JUMPED | STANDS | ERROR | UNCALIBRATED | GONE | SWITCH_OPEN)) != 0
    for tick in rules.cause_at:
        bad |= rows["tick"] >= tick
    paused = np.diff(rows["time"], prepend=rows["time"][0]) > rules.gap
    paused[:-1] |= paused[1:]  # a tick that hung
    return bad | after(bad) | paused


def change_findings(rows, force, rules):
    found = []
    change = norm(np.diff(rows["motor"], axis=0, prepend=np.zeros((1, 3))))
    cause = causes(rows, rules)
    slack = 1e-9
    kick = (change > rules.max_change + slack) & ~(cause & (force == 0))
    if kick.any():
        at = np.flatnonzero(kick)
        found.append(f"a kick of {change[at].max():.3g} N in a tick {times(at, rows)}")
    # The ramp: so many ticks after the start, or after the force was zero for a cause, it can only be so large.
    began = np.where(cause & (force == 0), np.arange(len(rows)), -1)
    since = np.arange(len(rows)) - np.maximum.accumulate(began)
    allowed = rules.max_force * np.minimum(1, since / (rules.ramp * rules.rate_hz))
    steep = force > allowed + slack
    if steep.any():
        at = np.flatnonzero(steep)
        found.append(f"not ramped in: {force[at[0]]:.3g} N, {since[at[0]]} ticks after zero, {times(at, rows)}")
    return found


def end_findings(log, rules):
    rows = log.rows
    found = []
    if rules.force_may_stand:
        return found
    last = norm(log.last["motor"])
    if last > 0:
        found.append(f"the motors hold {last:.3g} N at the end")
    commanded = norm(rows["commanded"])
    if commanded[-1] > 0 and not rows["flags"][-1] & GONE:
        found.append(f"the last force that was sent is {commanded[-1]:.3g} N, not zero")
    pushing = np.flatnonzero(norm(rows["motor"]) > 0)
    if rules.fades and len(pushing) and pushing[-1] + 1 < len(rows):
        from_tick = max(0, int(pushing[-1] - rules.fade * rules.rate_hz))
        drops = -np.diff(norm(rows["motor"][from_tick:pushing[-1] + 2]))
        drops = drops[~causes(rows, rules)[from_tick + 1:pushing[-1] + 2]]
        most = 1.5 * rules.max_force / (rules.fade * rules.rate_hz)
        if drops.max(initial=0) > most:
            found.append(f"not ramped out: the force falls by {drops.max():.3g} N in a tick at the end")
    return found


def same(a, b):
    return a.shape == b.shape and bool(np.all(a == b))


def recording_findings(log, path, rules):
    """Whether the recording says what was sent, and cut nothing where it should not."""
    try:
        file = h5py.File(path, "r", swmr=True)
    except OSError as problem:
        return [] if rules.recording == "absent" and not path.exists() else [f"the recording cannot be read: {problem}"]
    if rules.recording == "absent":
        return ["there is a recording of a session that never began"]
    with file:
        try:
            return row_findings(log, file, rules)
        except (KeyError, OSError, ValueError) as problem:
            return [f"the recording cannot be read: {problem}"]


def row_findings(log, file, rules):
    found = []
    complete = bool(file.attrs["complete"])
    if complete != (rules.recording == "complete"):
        found.append("the recording is " + ("" if complete else "not ") + "marked as complete")
    n = min(len(file[name]) for name in ("/servo/tick", "/time", "/servo/force_sent", "/device/position",
                                         "/reading_rejected", "/bur/position", "/removed/volume", "/handle/position"))
    if n == 0:
        return found + ["the recording has no rows"]
    tick = file["/servo/tick"][:n]
    if np.any(np.diff(tick) != 1):
        found.append(f"{int(np.sum(np.diff(tick) - 1))} ticks are missing in the recording")
    if tick[-1] >= len(log.rows):
        return found + [f"the recording has tick {tick[-1]}, the log ends with {len(log.rows) - 1}"]
    logged = log.rows[tick]
    read = np.isfinite(logged["position"]).all(axis=1)
    if not same(file["/device/position"][:n][read], logged["position"][read]):
        found.append("the recorded positions are not those that the device gave")
    if not same(file["/servo/force_sent"][1:n], log.rows[tick[1:] - 1]["commanded"]):
        found.append("the recorded forces are not those that were sent")
    unrecorded = log.rows[tick[-1] + 1:]
    if rules.recording == "complete" and norm(unrecorded["motor"]).max(initial=0) > 0:
        found.append(f"force after the last recorded row, in {int((norm(unrecorded['motor']) > 0).sum())} ticks")
    if rules.recording == "incomplete" and len(unrecorded) > rules.most_unrecorded:
        found.append(f"{len(unrecorded)} ticks at the end are not in the recording")
    return found + step_findings(file, n, logged, rules)


def step_findings(file, n, logged, rules):
    found = []
    rejected = file["/reading_rejected"][:n] != 0
    flagged = (file["/servo/flags"][:n] & RECORDED_REJECTED) != 0
    if not same(rejected, flagged):
        found.append("/reading_rejected and /servo/flags differ")
    wrong = ((logged["flags"] & JUMPED) != 0) | frozen_too_long(logged, rules)
    believed = np.flatnonzero(wrong & ~rejected)
    if len(believed):
        found.append(f"a reading that cannot be true was believed {times(believed, logged)}")
    removed = file["/removed/volume"][:n].sum(axis=1)
    bur = file["/bur/position"][:n]
    at = np.flatnonzero(rejected[1:]) + 1
    # What a session still owes is removed with its last row.
    cut = at[(removed[at] != removed[at - 1]) & (at < n - 1)]
    if len(cut):
        found.append(f"an implausible reading cut {np.max(removed[cut] - removed[cut - 1]):.3g} mm3 {times(cut, logged)}")
    if not same(bur[at], bur[at - 1]):
        found.append("an implausible reading moved the bur")
    begins = rejected & ~after(rejected)
    without = np.flatnonzero(begins & ~near_a_cause(logged, wrong, rules))
    if len(without):
        found.append(f"a good reading was rejected {times(without, logged)}")
    good = np.flatnonzero(~rejected)
    step = norm(np.diff(file["/handle/position"][:n][good], axis=0))
    late = np.diff(logged["time"][good]) > 0.0025  # or the one before: then it may have been as old
    late |= after(late)
    if len(step) and step[~late].max(initial=0) > rules.largest_step:
        found.append(f"the handle jumped {step[~late].max():.3g} mm")
    way = norm(np.diff(bur, axis=0))
    if way.max(initial=0) > rules.largest_bur_step:
        found.append(f"the bur jumped {way.max():.3g} mm")
    if np.any(np.diff(removed) < 0):
        found.append("removed tissue came back")
    return found


def near_a_cause(logged, wrong, rules):
    """Rows in which a rejection may begin: a wrong reading, a hand that is elsewhere after a pause, or the first after the
    pose stood."""
    stands = (logged["flags"] & STANDS) != 0
    return wrong | elsewhere(logged, rules) | after(stands)


def elsewhere(logged, rules):
    """Rows after a pause, the second if the first may be as old as the pause, of a hand that is farther from where it was
    than it would have gone on."""
    position, time = logged["position"], logged["time"]
    paused = np.diff(time, prepend=time[0]) > rules.gap
    rows = np.zeros(len(logged), bool)
    for i in np.flatnonzero(paused | after(paused)):
        last = i - 1 if paused[i] else i - 2
        earlier = max(0, last - 20)
        speed = norm(position[last] - position[earlier]) / (time[last] - time[earlier]) if last > earlier else 0
        went_on = rules.near + speed * min(time[i] - time[last], rules.longest_way)
        rows[i] = not norm(position[i] - position[last]) <= went_on
    return rows


def findings(log_path, recording_path, rules):
    log = read_log(log_path)
    return force_findings(log, rules) + recording_findings(log, recording_path, rules)
