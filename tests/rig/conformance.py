"""Live sessions on a stand-in device that misbehaves at random times: what the hand feels, what the operator reads, and
what is left on the disk, judged by judge.py.

    conformance.py --runs 5                  each case so often
    conformance.py --only glitch --runs 100  some of them
    conformance.py --list

Sessions run in real time, some at once. Exits 1 if a session was found wrong, or could not be judged because the machine
left out too many of its ticks each time; its folder is kept with --keep.
"""
import argparse
import collections
import concurrent.futures
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

import judge
from faults import CASES, DURATION_S

BUR = "cylinder:D1.2xL3.0"
LONGEST_S = 60
MOST_MISSED = 0.09  # of the ticks; at a tenth, as the program counts them, a session fails
STALE_S = 0.3  # without a tick: a session ends
TRIES = 4  # of a session for which the machine was too busy


def hand_path(rng, speeds):
    """The hand, in the device's frame: at rest beside the block, pedal up; pedal down; into the block, sideways. Its
    tremor turns the stylus by a milliradian, so that no pose is the last one to the bit."""
    speed, down = rng.uniform(*speeds), rng.uniform(0.12, 0.2)
    x, y = rng.uniform(-0.5, 0.5), rng.uniform(-0.3, 0.3)
    lines = ["time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw,buttons"]
    for t in np.arange(0, 4, 0.01):
        way = max(0.0, t - 0.2) * speed
        tremor = 5e-4 * np.sin(2 * np.pi * 9 * t)
        lines.append(f"{t:.3f},{x * way / 4:.5f},{y * way / 4:.5f},{way:.5f},{tremor:.12f},0,0,{np.cos(np.arcsin(tremor)):.15f},"
                     f"{int(t >= down)}")
    return "\n".join(lines) + "\n"


class Suite:
    def __init__(self, binary, libhd, folder):
        self.binary, self.libhd, self.folder = binary, libhd, Path(folder)
        self.block = self.folder / "block.vdb"
        subprocess.run([binary, "specimen", "block", "-o", str(self.block), "--size-mm", "4", "--enamel-mm", "2"],
                       check=True, capture_output=True)
        (self.folder / "registration.toml").write_text("fixed_axis = [0, 1, 0]\n")

    def run(self, name, number, seed):
        """What was found wrong in a session, how often it was begun again, and whether it was never judged."""
        for attempt in range(TRIES):
            folder = self.folder / f"{name}-{number}-{attempt}"
            folder.mkdir()
            rng = random.Random(f"{seed} {name} {number}")
            found, busy = self.session(CASES[name](rng), rng, folder)
            if not busy:
                break
        if not found:
            shutil.rmtree(folder)
        return found, attempt, busy

    def session(self, case, rng, folder):
        (folder / "hand.csv").write_text(hand_path(rng, case.speed))
        environment = {**os.environ, "TOOTHPREP_LIBHD": self.libhd, "TOOTHPREP_STANDIN_SET": case.settings,
                       "TOOTHPREP_STANDIN_PATH": str(folder / "hand.csv"), "TOOTHPREP_STANDIN_LOG": str(folder / "ticks.log")}
        args = ["live", "--device", "openhaptics", "--tooth", str(self.block), "--bur", BUR, "--pedal", "1", "--start-mm",
                "0,-1,-2.8", "--registration", str(self.folder / "registration.toml"), "--stale-s", str(STALE_S), "-o",
                str(folder / "session.h5"), "--duration-s", str(DURATION_S)]
        for option, value in zip(case.args[::2], case.args[1::2]):
            if option in args:
                args[args.index(option) + 1] = value
            else:
                args += [option, value]
        status, text = self.watch([self.binary, *args], environment, case, folder)
        (folder / "stderr.txt").write_text(text)
        found = self.judged(case, folder, status, text)
        # A machine that doesn't give a session its ticks proves nothing.
        share, longest = judge.withheld(folder / "ticks.log", folder / "session.h5")
        busy = bool(found) and status == 1 and case.status == 0 and (share > MOST_MISSED or longest > 0.9 * STALE_S)
        if busy:
            found.append(f"the machine left out {100 * share:.1f} % of the ticks, at most {1000 * longest:.0f} ms of them at once")
        return found, busy

    def judged(self, case, folder, status, text):
        found = []
        if status != case.status:
            said = text.strip().splitlines()[-1:]
            found.append(f"exit status {status}, not {case.status}" + "".join(f" ({line})" for line in said))
        if case.output == "read":
            found += [f"no word of /{words}/" for words in case.words if not re.search(words, text)]
        rules = judge.Rules(**case.rules)
        try:
            found += judge.findings(folder / "ticks.log", folder / "session.h5", rules)
            return found + (self.recovered(folder) if rules.recording == "incomplete" else [])
        except (OSError, ValueError) as problem:
            return found + [str(problem)]

    def recovered(self, folder):
        """A recording whose program is gone becomes one that is opened as any file."""
        old, new = folder / "session.h5", folder / "recovered.h5"
        done = subprocess.run([self.binary, "recover", str(old), "-o", str(new)], capture_output=True, text=True)
        if done.returncode != 0 or "lost:" not in done.stderr:
            return ["recover: " + done.stderr.strip()]
        with h5py.File(old, "r", swmr=True) as before, h5py.File(new, "r") as after:
            rows = min(len(before["/time"]), len(before["/servo/tick"]))
            same = len(after["/time"]) == rows and np.array_equal(after["/servo/tick"][:], before["/servo/tick"][:rows])
            return [] if same else ["the recovered recording has other rows"]

    def watch(self, command, environment, case, folder):
        pipe = subprocess.DEVNULL if case.output == "closed" else subprocess.PIPE
        if case.output == "closed":
            command = ["sh", "-c", 'exec "$@" >&- 2>&-', "sh", *command]
        process = subprocess.Popen(command, env=environment, cwd=folder, stdout=subprocess.DEVNULL, stderr=pipe, text=True)
        try:
            for tick, number in case.signals:
                wait_for_tick(folder / "ticks.log", tick, process)
                process.send_signal(number)
            if case.output == "closed later":
                wait_for_tick(folder / "ticks.log", 300, process)
                process.stderr.close()
            if case.output != "read":
                status = process.wait(timeout=LONGEST_S)
                return status, ""
            return_text = process.communicate(timeout=LONGEST_S)[1]
            return process.returncode, return_text
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return "none: it hung", ""
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.kill()


def wait_for_tick(log, tick, process):
    """Until the servo's clock has got there, or stands still for 0.3 s (a process that was stopped)."""
    rows, since = 0, time.monotonic()
    while process.poll() is None:
        if log.exists():
            with open(log, "rb") as file:
                head = file.read(128)
            if len(head) == 128:
                count = int(np.frombuffer(head, "<u8", 1, 32)[0])
                if count != rows:
                    rows, since = count, time.monotonic()
                # A process that stands goes on by the wall's clock.
                if rows and rows + 1e3 * max(0.0, time.monotonic() - since - 0.005) >= tick:
                    return
        time.sleep(0.001)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", default="build/toothprep")
    parser.add_argument("--libhd", default="build/libhd-stand-in/libHD.so")
    parser.add_argument("--runs", type=int, default=1, help="of each case")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--jobs", type=int, default=3 * (os.cpu_count() or 1), help="sessions at once")
    parser.add_argument("--only", nargs="*", default=[], help="cases by name")
    parser.add_argument("--without", nargs="*", default=[], help="cases by name")
    parser.add_argument("--keep", help="folder for the sessions that were found wrong")
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    if options.list:
        print(*CASES, sep="\n")
        return 0
    names = [name for name in options.only or CASES if name not in options.without]
    for name in [*options.only, *options.without]:
        if name not in CASES:
            parser.error(f"no case {name}; --list names them")
    folder = tempfile.mkdtemp(prefix="toothprep-rig-")
    began = time.monotonic()
    try:
        suite = Suite(os.path.abspath(options.binary), os.path.abspath(options.libhd), folder)
        wrong, busy, again = run_all(suite, names, options)
        if (wrong or busy) and options.keep:
            shutil.copytree(folder, options.keep, dirs_exist_ok=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    for name in names:
        if wrong[name]:
            print(f"{name}: {len(wrong[name])} of {options.runs} wrong")
            for text, count in collections.Counter(t for found in wrong[name] for t in found).most_common(5):
                print(f"    {count} x {text}")
    count = sum(map(len, wrong.values()))
    print(f"{len(names) * options.runs} sessions of {len(names)} cases, {count} wrong, {again} begun again because the "
          f"machine was busy, {busy} without a verdict after {TRIES} tries; {time.monotonic() - began:.0f} s, seed {options.seed}")
    return 1 if count or busy else 0


def run_all(suite, names, options):
    wrong, without_verdict, again = collections.defaultdict(list), 0, 0
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        jobs = {pool.submit(suite.run, name, number, options.seed): (name, number)
                for number in range(options.runs) for name in names}
        for job in concurrent.futures.as_completed(jobs):
            name, number = jobs[job]
            found, attempts, busy = job.result()
            again += attempts
            without_verdict += busy
            if found and not busy:
                wrong[name].append(found)
            if found:
                print(f"{name} {number}: " + "no verdict: " * busy + "; ".join(found), file=sys.stderr, flush=True)
    return wrong, without_verdict, again


if __name__ == "__main__":
    sys.exit(main())
