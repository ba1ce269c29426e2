#!/usr/bin/python3
"""Runs whole commands on damaged files and judges what they answer: kind of file x outcome, as a table.

    mutate.py TOOTHPREP --runs 2000 --seed 1 --jobs 2 [--kind NAME]... [--keep FOLDER] [--seconds S]

A run takes one kind (kinds.py), damages its file by one mutation (mutations.py), and runs the command with a limit
of time and memory. The same seed gives the same runs. Good outcomes:

    same          exit 0, the figures of the undamaged file
    with warning  exit 0, other figures, and a line `warning: ...` that the undamaged file doesn't give
    as stated     exit 0, other figures that follow from what the damaged file now says (statements.py)
    long work     ended after ten seconds: the file is well-formed and asks for more than the undamaged one
    refused       exit 1, one line `toothprep: ...`, nothing on stdout, nothing left behind

Findings, each printed with the command that repeats it; any makes the exit status 1:

    SILENT        exit 0, other figures, no warning, and an independent strict reader finds the file malformed, or
                  unchanged in what it says, or its volumes elsewhere; or an energy audit or a force that can't be
    ragged        refused with no line, several lines, or output
    leftover      files of a run that failed
    crash, hang, memory (more than 1.5 GB)
"""
import argparse
import collections
import concurrent.futures
import csv
import glob
import json
import math
import os
import random as random_module
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time

import kinds as kinds_module
import mutations
import statements

GOOD = ("same", "with warning", "as stated", "long work", "refused")
BAD = ("SILENT", "ragged", "leftover", "crash", "hang", "memory")
MEMORY = 1.5e9     # bytes, resident
SECONDS = 10
DATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "data")
# Figures that differ from run to run.
UNREPEATABLE = re.compile(r"^seconds$|step_us|realtime|wall|cpu|duration_us|version|seconds_of|elapsed")


# ---- Running

class Done:
    def __init__(self, status, out, error, resident, timed_out):
        self.status, self.out, self.error = status, out, error
        self.resident, self.timed_out = resident, timed_out
        self.lines = error.splitlines()
        self.warnings = {line for line in self.lines if line.startswith("warning: ")}


def run_limited(command, folder):
    with open(os.path.join(folder, ".out"), "w+b") as out, open(os.path.join(folder, ".err"), "w+b") as err:
        process = subprocess.Popen(command, cwd=folder, stdout=out, stderr=err, stdin=subprocess.DEVNULL,
                                   start_new_session=True, preexec_fn=limits)
        over = threading.Event()

        def end():
            over.set()
            os.killpg(process.pid, 9)

        timer = threading.Timer(SECONDS, end)
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0), err.seek(0)
        texts = [f.read().decode(errors="replace") for f in (out, err)]
    os.remove(os.path.join(folder, ".out")), os.remove(os.path.join(folder, ".err"))
    return Done(process.returncode, *texts, usage.ru_maxrss * 1024, over.is_set())


def limits():
    resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))  # for this machine's sake
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 30, 1 << 30))


def flatten(value, name, figures):
    if isinstance(value, dict):
        for key, inner in value.items():
            flatten(inner, f"{name}.{key}" if name else key, figures)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            flatten(inner, f"{name}[{i}]", figures)
    elif isinstance(value, (bool, int, float)) and not UNREPEATABLE.search(name):
        figures[name] = value


def figures_of(kind, folder, done):
    """The numbers of the answer: JSON on stdout, or the sums of a table's columns."""
    figures = {}
    if not kind.repeats:
        return figures
    if done.out.lstrip().startswith("{"):
        flatten(json.loads(done.out), "", figures)
    for path in glob.glob(os.path.join(folder, "out.csv")) + glob.glob(os.path.join(folder, "out", "*.csv")):
        with open(path, newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                for key, cell in row.items():
                    if not UNREPEATABLE.search(key):
                        try:
                            figures[key] = figures.get(key, 0) + float(cell)
                        except ValueError:
                            pass
    return figures


# ---- Judging

def silent(kind, before, after):
    """Why figures that changed without a warning are wrong; empty: they follow from what the file says now.
    `before`, `after`: (path, figures)."""
    try:
        said = kind.says(before[0])
    except statements.NotWellFormed as e:
        return str(e)
    try:
        says = kind.says(after[0])
    except Exception as e:  # whatever a strict reader stumbles over
        return f"accepted, although {type(e).__name__}: {e}"
    if says == said:
        return "the file says the same; other: " + ", ".join(
            f"{key} {before[1].get(key)} -> {after[1].get(key)}" for key in sorted({*before[1], *after[1]})
            if before[1].get(key) != after[1].get(key))[:300]
    if isinstance(says, statements.Volumes):
        for key, volume in says.volumes.items():
            old, new = (figures.get(f"volume_mm3.{key}") for _, figures in (before, after))
            if old is None or new is None:
                return f"no volume of {key}"
            scale = says.voxel_mm3 / said.voxel_mm3
            due = old * scale + volume - said.volumes[key] * scale
            tolerance = 0.1 * max(due, old) + says.tolerance(said)
            if abs(new - due) > tolerance:
                return f"{key}: {new:.4g} mm3 instead of {due:.4g} +- {tolerance:.2g}"
    return implausible(after[1])


def implausible(figures):
    """What must not be said without a warning, whatever the file says."""
    for key, value in figures.items():
        if not math.isfinite(value):
            return f"{key} is {value}"
        if key.endswith("energy_ratio") and not 0.9 <= value <= 1.1:
            return f"{key} is {value}"
        if key.endswith("peak_force_n") and value > 50:
            return f"{key} is {value}"
    return ""


def judge_apart(kind, before, after):
    """silent() in a process of its own: libraries that read damaged files crash."""
    try:
        done = subprocess.run([sys.executable, os.path.abspath(__file__), "--judge", kind.name],
                              input=json.dumps([before, after]), text=True, capture_output=True, timeout=60, check=False)
    except subprocess.TimeoutExpired:
        return "accepted, although another reader hangs on it"
    if done.returncode != 0:
        return "accepted, although another reader crashes on it: " + done.stderr[-200:]
    return json.loads(done.stdout)


def judge(kind, base, folder, done, left):
    """(outcome, why)."""
    if done.timed_out:
        why = judge_apart(kind, (base.path, {}), (os.path.join(folder, kind.file), {}))
        return ("hang", f"more than {SECONDS} s; {why}") if why else ("long work", "")
    if done.resident > MEMORY:
        return "memory", f"{done.resident / 1e9:.1f} GB"
    if done.status not in (0, 1, 2):
        return "crash", f"exit status {done.status}"
    if done.status != 0:
        if left and not kind.keeps:
            return "leftover", " ".join(sorted(left))
        errors = [line for line in done.lines if line not in done.warnings]
        if done.status == 2 or len(errors) != 1 or not errors[0].startswith("toothprep: ") or done.out:
            if not kind.keeps:
                return "ragged", f"exit status {done.status}: " + " | ".join(errors[:3])
        return "refused", errors[-1] if errors else ""
    extra = left - set(kind.outputs)
    if extra:
        return "leftover", " ".join(sorted(extra))
    figures = figures_of(kind, folder, done)
    if figures == base.figures:
        return "same", ""
    if done.warnings - base.warnings:
        return "with warning", sorted(done.warnings - base.warnings)[0]
    why = judge_apart(kind, (base.path, base.figures), (os.path.join(folder, kind.file), figures))
    return ("SILENT", why) if why else ("as stated", "")


# ---- One run

def copy(source, target):
    (shutil.copytree if os.path.isdir(source) else shutil.copy)(source, target)


def damage(path, random):
    """Damages the file, or one of the files of the folder."""
    if os.path.isdir(path):
        files = sorted(f for f in os.listdir(path) if f.endswith(".dcm"))
        one = os.path.join(path, random.choice(files))
        what = random.random()
        if what < 0.05:
            os.remove(one)
            return "file gone"
        if what < 0.1:
            shutil.copy(one, one + "-copy.dcm")
            return "file twice"
        path = one
    if random.random() < 0.5 and path.endswith((".csv", ".h5")):
        return (mutations.other_csv if path.endswith(".csv") else mutations.other_hdf5)(path, random)
    with open(path, "rb") as file:
        data = file.read()
    name, data = mutations.mutated(data, random)
    with open(path, "wb") as file:
        file.write(data)
    return name


class Base:
    """The answer to the undamaged file."""
    def __init__(self, tool, kind, files):
        with tempfile.TemporaryDirectory(dir=os.path.dirname(files)) as folder:
            for name in (kind.file, *kind.needs):
                copy(os.path.join(files, name), os.path.join(folder, name))
            started = time.monotonic()
            done = run_limited((tool, "-q", "--threads", "1", *kind.command), folder)
            self.seconds = time.monotonic() - started
            if done.status != 0:
                raise SystemExit(f"{kind.name}: the undamaged file is refused: {done.error}")
            self.figures, self.warnings = figures_of(kind, folder, done), done.warnings
            self.path = os.path.join(files, kind.file)


def one_run(tool, kind, base, files, seed, index, keep):
    random = random_module.Random(f"{seed} {index}")
    folder = tempfile.mkdtemp(prefix="run-", dir=os.path.dirname(files))
    try:
        for name in (kind.file, *kind.needs):
            copy(os.path.join(files, name), os.path.join(folder, name))
        what = damage(os.path.join(folder, kind.file), random)
        before = set(os.listdir(folder))
        done = run_limited((tool, "-q", "--threads", "1", *kind.command), folder)
        outcome, why = judge(kind, base, folder, done, set(os.listdir(folder)) - before)
        if outcome in BAD and keep:
            os.makedirs(keep, exist_ok=True)
            target = os.path.join(keep, f"{outcome}-{kind.name.replace(' ', '_')}-{index}-{kind.file}")
            shutil.rmtree(target, ignore_errors=True)
            copy(os.path.join(folder, kind.file), target)
        return kind.name, what, outcome, why, index
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def table(counts, columns, title):
    used = [c for c in columns if any(row[c] for row in counts.values())] or list(columns)
    lines = [f"| {title} | " + " | ".join(used) + " |", "|---|" + "---|" * len(used)]
    for name, row in [*counts.items(), ("all", sum(counts.values(), collections.Counter()))]:
        lines.append(f"| {name} | " + " | ".join(str(row[c]) for c in used) + " |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tool", help="the toothprep binary")
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seconds", type=float, default=math.inf, help="start no further run after so long")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--kind", action="append", default=[], help="only this kind")
    parser.add_argument("--only", type=int, help="only the run of this number")
    parser.add_argument("--keep", help="folder for the files of findings")
    parser.add_argument("--verbose", action="store_true", help="print every run")
    options = parser.parse_args()
    tool = os.path.abspath(options.tool)
    all_kinds = kinds_module.kinds()
    chosen = [k for k in all_kinds if not options.kind or k.name in options.kind]
    started = time.monotonic()
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="toothprep-mutations-", dir=memory) as folder:
        files = os.path.join(folder, "files")
        os.mkdir(files)

        def run_tool(*command):
            subprocess.run([tool, "-q", *command], cwd=files, check=True, timeout=300)

        kinds_module.make_files(run_tool, files, DATA)
        bases = {k.name: Base(tool, k, files) for k in chosen}
        if options.verbose:
            for kind in chosen:
                print(f"{kind.name}: {bases[kind.name].seconds:.2f} s, {len(bases[kind.name].figures)} figures")
        # Run i is of kind i modulo the number of kinds, whatever was chosen.
        runs = [i for i in range(options.runs) if all_kinds[i % len(all_kinds)] in chosen]
        runs = [options.only] if options.only is not None else runs
        counts, by_mutation = {k.name: collections.Counter() for k in chosen}, {}
        late = lambda: time.monotonic() - started > options.seconds

        def start(i):
            kind = all_kinds[i % len(all_kinds)]
            if not late():
                return one_run(tool, kind, bases[kind.name], files, options.seed, i, options.keep)

        with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
            for result in pool.map(start, runs):
                if not result:
                    continue
                kind, mutation, outcome, why, index = result
                counts[kind][outcome] += 1
                by_mutation.setdefault(mutation, collections.Counter())[outcome] += 1
                if outcome in BAD or options.verbose:
                    print(f"{outcome}: {kind}, {mutation}: {why}   [--seed {options.seed} --only {index}]", flush=True)
    total = sum(counts.values(), collections.Counter())
    print(table(counts, GOOD + BAD, "kind"))
    print(table(dict(sorted(by_mutation.items())), GOOD + BAD, "mutation"))
    print(f"{sum(total.values())} runs, seed {options.seed}, {time.monotonic() - started:.0f} s, {options.jobs} jobs")
    return 1 if any(total[b] for b in BAD) else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--judge"]:
        wanted = next(k for k in kinds_module.kinds() if k.name == sys.argv[2])
        print(json.dumps(silent(wanted, *json.load(sys.stdin))))
    else:
        sys.exit(main())
