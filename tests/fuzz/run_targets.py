"""Runs the programs of libFuzzer's and says what came of it: the work behind scripts/fuzz.

Usage: run_targets.py BUILD_FOLDER SECONDS JOBS [TARGET...]

A finding is an input that stops the program (found/TARGET-crash-*, -timeout-*, -oom-*), or a report of a sanitizer
from a child process in which a reader tries a file first, if code of this repository stands in it: what libraries do
to themselves there is what the child process is for.
"""
import concurrent.futures
import glob
import gzip
import os
import re
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
BUILD, SECONDS, JOBS = os.path.abspath(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
MEMORY_MB = 2500  # the sanitizers' own share is a good third
# Seconds for one input. Under the sanitizers the readers are some ten times slower.
TIMEOUT = 30


def targets():
    there = sorted(os.path.basename(p)[len("fuzz_"):] for p in glob.glob(os.path.join(BUILD, "fuzz", "fuzz_*"))
                   if os.access(p, os.X_OK))
    wrong = [t for t in sys.argv[4:] if t not in there]
    if wrong:
        sys.exit(f"no such target: {wrong[0]}; there are {' '.join(there)}")
    return sys.argv[4:] or there


def ours(report):
    """Whether the report's first stack comes from this repository's code rather than from a library that it calls."""
    with open(report, errors="replace") as file:
        text = file.read()
        if "ERROR: " not in text and "runtime error: " not in text:  # an allocation that was refused
            return False
        for frame in re.findall(r"^ +#\d+ \S+ in (.*)$", text.split("\n\n")[0], re.M):
            if "/lib/toothprep/" in frame:
                return True
            if ".so" in frame or re.search(r"/usr/include/(openvdb|ITK|gdcm|CGAL|eigen3)", frame):
                return False
    return True


def run(target):
    found, learned, seeds = (os.path.join(BUILD, *f) for f in (("found",), ("learned", target), ("seeds", target)))
    shutil.rmtree(seeds, ignore_errors=True)
    for folder in (found, learned, seeds):
        os.makedirs(folder, exist_ok=True)
    for path in glob.glob(os.path.join(HERE, "corpus", target, "*")):
        with open(path, "rb") as packed, open(os.path.join(seeds, os.path.basename(path)), "wb") as plain:
            data = packed.read()
            plain.write(gzip.decompress(data) if data.startswith(b"\x1f\x8b") else data)
    its = lambda: {f for f in os.listdir(found) if f.startswith(target + "-")}
    before = its()
    memory = os.path.join("/dev/shm", f"toothprep-fuzz-{os.getpid()}-{target}")
    os.makedirs(memory)
    # In the child processes handlers are taken off; here the fuzzer's own are in charge. Libraries leak what they had
    # when they throw.
    asan = ":".join(("allocator_may_return_null=1", "detect_leaks=0", "handle_abort=1",
                     f"log_path={os.path.join(found, target + '-report')}"))
    command = [os.path.join(BUILD, "fuzz", "fuzz_" + target), learned, seeds,
               f"-max_total_time={SECONDS}", f"-rss_limit_mb={MEMORY_MB}", "-malloc_limit_mb=1500",
               f"-timeout={TIMEOUT}", f"-seed={os.environ.get('FUZZ_SEED', 0)}", "-print_final_stats=1", f"-artifact_prefix={found}/{target}-"]
    with open(os.path.join(BUILD, f"fuzz-{target}.log"), "w+", errors="replace") as log:
        status = subprocess.run(command, stdout=log, stderr=subprocess.STDOUT, check=False,
                                env={**os.environ, "ASAN_OPTIONS": asan, "TOOTHPREP_FUZZ_FOLDER": memory,
                                     "UBSAN_OPTIONS": asan + ":print_stacktrace=1"}).returncode
        log.seek(0)
        text = log.read()
    shutil.rmtree(memory, ignore_errors=True)
    new = sorted(its() - before)
    findings = [f for f in new if "-report" in f and ours(os.path.join(found, f))]
    if status != 0:  # this process itself was stopped
        findings += [f for f in new if "-report" not in f]
    if status != 0 and not findings:
        findings = [f"exit status {status}, see {log.name}"]
    if not findings:  # a library's own business
        for name in new:
            os.remove(os.path.join(found, name))
    runs = re.search(r"stat::number_of_executed_units: *(\d+)", text)
    edges = re.findall(r"cov: (\d+)", text)
    return target, int(runs.group(1)) if runs else 0, int(edges[-1]) if edges else 0, findings


def main():
    print("| reader | seconds | inputs | edges of code | findings |\n|---|---|---|---|---|", flush=True)
    failed = []
    with concurrent.futures.ThreadPoolExecutor(JOBS) as pool:
        for target, runs, edges, findings in pool.map(run, targets()):
            print(f"| {target} | {SECONDS} | {runs} | {edges} | {len(findings)} |", flush=True)
            failed += findings
    for finding in failed:
        print("found:", finding)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
