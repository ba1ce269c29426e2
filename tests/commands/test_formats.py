"""The pages of formats, checked against the program: every example is run, every key that a parser reads is documented,
every key in a table is one that a parser reads, and every dataset, JSON key and CSV column that comes out is listed.

An example is a fenced block whose info string has two words, the second its kind: ```toml trajectory-script.

Usage: test_formats.py BINARY STAND_IN_LIBHD SOURCE_DIR
"""
import csv
import json
import os
import re
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from busy_machine import settled  # noqa: E402
from started_program import run_program  # noqa: E402

BINARY, LIBHD = (os.path.abspath(argument) for argument in sys.argv[1:3])
SOURCE = Path(sys.argv[3]).resolve()
STAND_IN = "lib/toothprep/proof/libhd_stand_in/README.md"
OUTPUTS = "data/outputs/README.md"
BUR = "cylinder:D0.8xL1.0"

# Page -> the modules whose parsers read what it describes.
PARSERS = {
    "data/trajectories/README.md": ["tools/trajectory", "tools/placement"],
    "data/burs/README.md": ["step/bur"],
    "data/parameters/README.md": ["step/core"],
    "data/rubrics/README.md": ["tools/score"],
    "data/batch/README.md": ["tools/batch"],
    "data/figures/README.md": ["proof/figures"],
    "data/scans/README.md": ["tools/segmentation"],
    "data/scans/landmarks.md": ["tools/orientation"],
    "data/rig/FORMATS.md": ["tools/live", "tools/rig_check"],
    STAND_IN: ["proof/libhd_stand_in"],
}
# Calls that read a key of a TOML table: members of StrictTable, and the readers' own helpers around them.
MEMBER = r"(?:\.|->)(?:number|integer|boolean|text|choice|vector|vectors|numbers|table|tables|texts|range)\(\s*\"(\w+)\""
HELPER = (r"\b(?:require_positive|positive_or|finite_or|require_vector|words|positive|pair|quaternion|finite|take_count|"
          r"take_choice(?:<\w+>)?|read_range|border|text|check_table)\(\s*(?:\*?\w+,\s*)?\"(\w+)\"")
EITHER = r"\b(?:read_either|side)\(\s*\*?\w+,\s*\"(\w+)\",\s*\"(\w+)\""


def read(name):
    return (SOURCE / name).read_text(encoding="utf-8")


def pages():
    return sorted(str(p.relative_to(SOURCE)) for p in [*(SOURCE / "data").rglob("*.md"), SOURCE / STAND_IN])


def examples():
    """(kind, text, page, line) of every tagged block."""
    found = []
    for page in pages():
        lines, i = read(page).splitlines(), 0
        while i < len(lines):
            match = re.match(r"```(\w+)(?: (\S+))?\s*$", lines[i])
            if match:
                end = next(j for j in range(i + 1, len(lines)) if lines[j].startswith("```"))
                found.append((match.group(2), match.group(1), "\n".join(lines[i + 1:end]) + "\n", page, i + 1))
                i = end
            i += 1
    return found


def keys_read_by(modules):
    keys = set()
    for source in sorted(s for module in modules for s in (SOURCE / "lib/toothprep" / module).glob("*.cpp")):
        text = source.read_text(encoding="utf-8")
        keys |= set(re.findall(MEMBER, text)) | set(re.findall(HELPER, text)) | set(re.findall(r"\{\"(\w+)\", &Cut::", text))
        for pair in re.findall(EITHER, text):
            keys |= set(pair)
    return keys


def words_in_backticks(text):
    """All identifiers between backticks or in fenced blocks."""
    words = set()
    for block in re.findall(r"```[^\n]*\n(.*?)```", text, re.S):
        words |= set(re.findall(r"\w+", block))
    for span in re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.S)):
        words |= set(re.findall(r"\w+", span)) | {span}
    return words


def table_rows(text):
    """(header cells, row cells) of every row of every Markdown table."""
    header = None
    for line in re.sub(r"```.*?```", "", text, flags=re.S).splitlines():
        if not line.startswith("|"):
            header = None
        elif header is None:
            header = [c.strip() for c in line.strip("|").split("|")]
        elif not re.match(r"\|[-| ]+\|$", line):
            yield header, [c.strip() for c in line.strip("|").split("|")]


class Pages(unittest.TestCase):
    """What needs no program."""

    def test_every_example_in_toml_or_csv_has_a_kind_that_is_run(self):
        for kind, language, _, page, line in examples():
            if language in ("toml", "csv", "text"):
                self.assertTrue(hasattr(Examples, "run_" + (kind or "").replace("-", "_")), f"{page}:{line}: {kind}")

    def test_every_key_that_a_parser_reads_is_documented(self):
        for page, modules in PARSERS.items():
            keys = keys_read_by(modules)
            self.assertGreater(len(keys), 3, page)
            self.assertEqual(sorted(keys - words_in_backticks(read(page))), [], f"not in {page}")

    def test_every_key_in_a_table_is_one_that_a_parser_reads(self):
        checked = 0
        for page, modules in PARSERS.items():
            keys = keys_read_by(modules)
            for header, row in table_rows(read(page)):
                if header[0] != "key" and not re.match(r"(key of )?`\[", header[0]):
                    continue
                for key in re.findall(r"`([a-z][a-z0-9_]*)`", row[0]):
                    checked += 1
                    self.assertIn(key, keys, f"{page} has a key that {modules} do not read")
        self.assertGreater(checked, 80)

    def test_letters_and_shapes_of_burs_are_those_of_the_parser(self):
        text, source = read("data/burs/README.md"), read("lib/toothprep/step/bur/bur_shapes.cpp")
        letters = re.findall(r"\{'(\w)', \"[^\"]*\", ([\d.]+), ([\d.]+)\}", source)
        self.assertEqual(len(letters), 8)
        for letter, least, most in letters:
            self.assertRegex(text, rf"\| `{letter}` \|[^|]*\| {least} \.\. {most} \|")
        shapes = re.findall(r"\{\"([\w-]+)\", \"\1:", source)
        self.assertEqual(len(shapes), 9)
        for shape in shapes:
            self.assertRegex(text, rf"\| `{shape}` \|")

    def test_columns_of_csv_inputs_are_those_of_the_reader(self):
        source = read("lib/toothprep/tools/trajectory/csv_trajectory.cpp")
        columns = re.findall(r'"(\w+)"', re.search(r"kColumns = \{(.*?)\};", source, re.S).group(1))
        self.assertEqual(len(columns), 15)
        more = re.findall(r'further\["(\w+)"\]', read("lib/toothprep/tools/calibrate/recording_csv.cpp"))
        self.assertEqual(len(set(more)), 3)
        for page, known in (("data/trajectories/README.md", columns), ("data/recordings/README.md", columns + more)):
            documented = {column for header, row in table_rows(read(page)) if header[0] == "column"
                          for column in re.findall(r"`(\w+)`", row[0])}
            self.assertEqual(documented, set(known), page)

    def test_faults_of_the_checks_would_be_found(self):
        self.assertEqual(keys_read_by(["tools/segmentation"]),
                         {"preset", "name", "description", "source", "pulp_dentin", "dentin_enamel"})
        self.assertEqual(words_in_backticks("a `b_c = 1` d\n```toml x\ne = 2\n```\n"), {"b_c", "1", "b_c = 1", "e", "2"})


class Tool(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="toothprep-formats-")
        cls.ok("specimen", "block", "-o", "block.vdb", "--size-mm", "3", "--enamel-mm", "1.2", "--voxel-mm", "0.15")
        scripts = [text for kind, _, text, _, _ in examples() if kind == "trajectory-script"]
        cls.write("path.toml", scripts[0])
        cls.write("pocket.toml", scripts[1])

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @classmethod
    def write(cls, name, text):
        path = Path(cls.folder) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return name

    @classmethod
    def ok(cls, *args, **environment):
        more = {"env": {**os.environ, **environment}} if environment else {}
        done = settled(lambda: run_program(BINARY, args, cls.folder, 120, **more), args, cls.folder)
        assert done.returncode == 0, f"{args}: {done.returncode}\n{done.stderr}"
        return done.stdout

    @classmethod
    def replay(cls, trajectory, *more, bur=BUR, **environment):
        return json.loads(cls.ok("replay", "--tooth", "block.vdb", "--trajectory", trajectory, "--bur", bur, "--drive",
                                 "direct", "--strict", "--json", "--force", "-o", "trace.h5", *more, **environment))

    @classmethod
    def live(cls, *args, **environment):
        return cls.ok("live", "--no-real-time", "--force", *args, **environment)

    @classmethod
    def session(cls, *args):
        cls.live("--tooth", "block.vdb", "--bur", BUR, "--duration-s", "0.3", "-o", "session.h5", *args)


class Examples(Tool):
    """Every example of the pages, run."""

    def test_examples(self):
        count = {}
        for kind, _, text, page, line in examples():
            if kind:
                with self.subTest(f"{page}:{line} {kind}"):
                    getattr(self, "run_" + kind.replace("-", "_"))(text)
                    count[kind] = count.get(kind, 0) + 1
        self.assertEqual(len(count), 21, count)

    def run_trajectory_script(self, text):
        result = self.replay(self.write("example.toml", text))
        self.assertGreater(sum(result["removed_mm3"].values()), 0)

    def run_tooth_script(self, text):
        self.ok("specimen", "molar", "--voxel-mm", "0.5", "-o", "molar.vdb", "--force")
        result = self.ok("replay", "--tooth", "molar.vdb", "--trajectory", self.write("own.toml", text), "--bur", "ball:D1.8",
                         "--drive", "direct", "--json", "--force", "-o", "trace.h5")
        self.assertGreater(sum(json.loads(result)["removed_mm3"].values()), 0)

    def run_place_pairs(self, text):
        self.ok("specimen", "molar", "--voxel-mm", "0.5", "-o", "molar.vdb", "--force")
        self.ok("place", "--tooth", "molar.vdb", "--trajectory", "path.toml", "--bur", BUR, "--at", self.write("pairs.toml", text))

    def run_trajectory_csv(self, text):
        self.assertGreater(self.replay(self.write("example.csv", text))["contact_steps"], 0)

    def run_bur_profile(self, text):
        self.assertGreater(self.replay("path.toml", bur=self.write("bur.toml", text))["contact_steps"], 0)

    def run_bur_library(self, text):
        self.write("data/burs/library.toml", text)
        data = {"TOOTHPREP_DATA": os.path.join(self.folder, "data")}
        names = [line.split()[0] for line in self.ok("replay", "--bur", "list", **data).splitlines()]
        self.assertEqual(names, re.findall(r'^name = "(.*)"', text, re.M))
        for name in names + re.findall(r'^also = "(.*)"', text, re.M):
            self.assertGreater(self.replay("path.toml", bur=name, **data)["contact_steps"], 0)

    def run_parameters(self, text):
        self.assertGreater(self.replay("path.toml", "--params", self.write("params.toml", text))["contact_steps"], 0)

    def run_landmarks(self, text):
        self.ok("specimen", "molar", "--voxel-mm", "0.5", "-o", "molar.vdb", "--force")
        frame = json.loads(self.ok("orient", "molar.vdb", "--anew", "--landmarks", self.write("marks.toml", text), "--json"))
        self.assertEqual([frame[axis + "_source"] for axis in ("occlusal", "mesial", "buccal")], ["landmarks"] * 3)
        self.assertGreater(frame["occlusal"][2], 0.99)

    def run_registration(self, text):
        self.session("--registration", self.write("registration.toml", text))

    def run_hand_path(self, text):
        self.session("--hand", self.write("hand.toml", text))

    def run_protocol(self, text):
        lines = text.splitlines()
        self.assertEqual(len(lines), 3)
        for line in lines:
            self.live("--protocol", line, "-o", "check.h5")
            with h5py.File(os.path.join(self.folder, "check.h5")) as recording:
                self.assertEqual(recording.attrs["protocol"], line)

    def run_rig_limits(self, text):
        self.session()
        report = json.loads(self.ok("rig-check", "session.h5", "--limits", self.write("limits.toml", text), "--json",
                                    "--quiet"))
        judged = [line["figure"] for line in report["lines"] if line["limit_min"] is not None or
                  line["limit_max"] is not None]
        self.assertEqual(sorted(judged), ["servo_clock_error_ppm", "servo_missed_share"])

    def run_rubric(self, text):
        self.ok("specimen", "cavity", "--kind", "box", "--voxel-mm", "0.25", "--size-mm", "8,5,6", "--original",
                "before.vdb", "-o", "after.vdb", "--force")
        score = json.loads(self.ok("score", "--original", "before.vdb", "--prepared", "after.vdb", "--rubric",
                                   self.write("rubric.toml", text), "-o", "score.json", "--force", "--json"))
        self.assertEqual([c["key"] for c in score["criteria"]], re.findall(r'^key = "(.*)"', text, re.M))
        self.assertNotIn("not judged", [c["verdict"] for c in score["criteria"]])

    def run_manifest(self, text):
        self.write("rubric.toml", next(t for kind, _, t, _, _ in examples() if kind == "rubric"))
        os.makedirs(os.path.join(self.folder, "students/anna"), exist_ok=True)
        self.replay("pocket.toml", "--prepared", "students/anna/prepared.vdb")
        name = self.write("manifest.toml", text)
        shutil.rmtree(os.path.join(self.folder, "results"), ignore_errors=True)
        self.ok("batch", name, "-o", "results", "--quiet")
        with open(os.path.join(self.folder, "results/batch.csv"), encoding="utf-8") as table:
            rows = list(csv.DictReader(table))
        self.assertGreater(len(rows), 0)
        self.assertNotIn("failed", [row["status"] for row in rows])

    def run_study(self, text):
        """Few samples of coarse teeth; the trajectory is the page's next block."""
        page = read("data/batch/study.md")
        self.write("slot.toml", re.search(r"^```\n(start_mm.*?)```", page, re.M | re.S).group(1))
        self.write("study.toml", text.replace("samples = 64", "samples = 3").replace("voxel_mm = 0.1", "voxel_mm = 0.25"))
        self.ok("batch", "study.toml", "-o", "study", "--quiet")
        with open(os.path.join(self.folder, "study/batch.csv"), encoding="utf-8") as table:
            rows = list(csv.DictReader(table))
        self.assertEqual(sorted({row["step"] for row in rows}), ["cut", "judged", "tooth"])
        self.assertNotIn("failed", [row["status"] for row in rows])

    def run_experiment(self, text):
        self.write("experiments/own/experiment.toml", text)
        self.write("experiments/own/params.toml", "[handpiece]\nstall_torque_mnm = inf\n")
        self.write("experiments/own/path.toml", 'start_mm = [0, 0.6, -0.5]\n[[segment]]\nkind = "line"\n'
                   "to_mm = [0, -3.6, -0.5]\nspeed_mm_s = 2\n")
        self.ok("figures", "--experiments", "experiments", "--no-plots", "--voxel-mm", "0.2", "--engine", "levelset",
                "-o", "figures", "--quiet")
        with open(os.path.join(self.folder, "figures/figures.json"), encoding="utf-8") as file:
            self.assertGreater(len(json.load(file)["figures"][0]["claims"]), 0)

    def run_cutting_test(self, text):
        self.write("cutting/mine/experiment.toml", 'kind = "validation"\nmeasurements = "measured"\n')
        self.write("cutting/mine/measured/measurements.csv", "id\nM01\n")
        self.write("cutting/mine/measured/tests/one.toml", text)
        self.ok("figures", "--experiments", "cutting", "--no-plots", "-o", "cut", "--force")
        with open(os.path.join(self.folder, "cut/figures.json"), encoding="utf-8") as file:
            return json.load(file)

    def run_hounsfield(self, text):
        self.write("data/scans/hounsfield.toml", text)
        data = {"TOOTHPREP_DATA": os.path.join(self.folder, "data")}
        self.ok("specimen", "scan", "-o", "scan.nrrd", "--spacing-mm", "0.4", "--force")
        for name in re.findall(r'^name = "(.*)"', text, re.M):
            self.ok("voxelize", "scan.nrrd", "--hounsfield", name, "--voxel-mm", "0.4", "-o", "tooth.vdb", "--force",
                    **data)

    def run_stand_in(self, text):
        self.live("--device", "openhaptics", "--protocol", "rest 0.2 s", "-o", "check.h5", TOOTHPREP_LIBHD=LIBHD,
                  TOOTHPREP_STANDIN=os.path.join(self.folder, self.write("rig.toml", text)))

    def run_rigid_transform(self, text):
        name = self.write("transform.toml", text)
        self.write("table.csv", "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n0.01,1,0,0\n")
        self.ok("import", "table.csv", "--transform", name, "--marker-to-bur", name, "-o", "imported.h5", "--force")
        with h5py.File(os.path.join(self.folder, "imported.h5")) as file:
            self.assertNotAlmostEqual(file["handle/position"][0, 0], 0)

    def run_recording_csv(self, text):
        """The example's columns on enough rows to fit: those that `specimen measurement` writes."""
        self.ok("specimen", "measurement", "--tooth", "block.vdb", "--bur", BUR, "--trajectory", "pocket.toml", "-o",
                "rig.csv", "--force")
        with open(os.path.join(self.folder, "rig.csv"), encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        columns = text.splitlines()[0].split(",")
        extra = {"rotation_rate_rev_s": "100", "torque_mNm": "0", "stalled": "0"}
        self.write("rig.csv", "\n".join([",".join(columns)] + [",".join({**extra, **row}[c] for c in columns)
                                                               for row in rows]) + "\n")
        fit = json.loads(self.ok("calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", "--bur", BUR, "-o",
                                 "fit.json", "--bootstrap", "50", "--force", "--json"))
        self.assertTrue(fit["rotation_rate_recorded"])
        # The example itself is read up to the point where three samples are too few to fit.
        self.write("rig.csv", text)
        done = run_program(BINARY, ["calibrate", "--tooth", "block.vdb", "--measured", "rig.csv", "--bur", BUR, "-o", "fit.json",
                                    "--force"], self.folder, 60)
        self.assertNotIn("column", done.stderr)
        self.assertNotIn("line ", done.stderr)


TISSUES = {"enamel", "dentin", "pulp", "other"}


def keys_of(value, stop):
    """All keys in a JSON value; what lies under a key in `stop` has keys of its own."""
    if isinstance(value, dict):
        for key, member in value.items():
            yield key
            if key not in stop:
                yield from keys_of(member, stop)
    elif isinstance(value, list):
        for member in value:
            yield from keys_of(member, stop)


class Outputs(Tool):
    """Whatever the program really writes is in the page of outputs."""

    def section(self, title):
        match = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", read(OUTPUTS), re.S | re.M)
        self.assertTrue(match, title)
        return match.group(1)

    def assert_documented(self, found, title, also=()):
        documented = words_in_backticks(self.section(title)) | set(also)
        self.assertEqual(sorted(set(found) - documented), [], f"not in the section {title} of {OUTPUTS}")

    def assert_h5_documented(self, name, sections):
        rows = {}
        for title in sections:
            for header, row in table_rows(self.section(title)):
                if header[0] == "dataset":
                    for dataset in re.findall(r"`(/[\w/]+)`", row[0]):
                        rows[dataset] = row[2] if len(row) > 2 else ""
        words = set().union(*(words_in_backticks(self.section(title)) for title in sections))
        with h5py.File(os.path.join(self.folder, name)) as file:
            found = {}
            file.visititems(lambda path, item: found.update({"/" + path: item.attrs["units"]})
                            if isinstance(item, h5py.Dataset) else None)
            for dataset, units in found.items():
                self.assertIn(dataset, rows)
                self.assertEqual(units, rows[dataset] or units, dataset)
            self.assertEqual(sorted(set(file.attrs) - words), [])
        self.assertGreater(len(found), 15)

    def header(self, name):
        with open(os.path.join(self.folder, name), encoding="utf-8") as file:
            return file.readline().strip().split(",")

    def test_replay_and_trace(self):
        result = self.replay("pocket.toml", "--prepared", "prepared.vdb")
        self.assert_documented(keys_of(result, ()), "replay --json", TISSUES)
        self.assert_h5_documented("trace.h5", ["Trace files (.h5)"])
        self.ok("export", "trace.h5", "-o", "trace.csv", "--force")
        self.assert_documented(self.header("trace.csv"), "Trace as CSV")

    def test_info(self):
        self.replay("pocket.toml", "--prepared", "prepared.vdb")
        self.ok("mesh", "prepared.vdb", "-o", "prepared.ply", "--force")
        self.ok("specimen", "scan", "-o", "scan.nrrd", "--spacing-mm", "0.4", "--force")
        for name in ("block.vdb", "trace.h5", "path.toml", "prepared.ply", "scan.nrrd"):
            info = json.loads(self.ok("info", name, "--json"))
            self.assert_documented(keys_of(info, ("provenance",)), "info --json", TISSUES)
            if name == "block.vdb":
                self.assert_documented(info["provenance"], "Tooth files (.vdb)")

    def test_orient(self):
        self.ok("specimen", "molar", "--voxel-mm", "0.5", "-o", "molar.vdb", "--force")
        result = json.loads(self.ok("orient", "molar.vdb", "--tooth-number", "36", "-o", "oriented.vdb", "--json", "--force"))
        self.assert_documented(keys_of(result, ()), "orient --json")
        info = json.loads(self.ok("info", "oriented.vdb", "--json"))
        self.assert_documented(keys_of(info, ("provenance",)), "info --json", TISSUES)
        self.assert_documented(info["provenance"], "Tooth files (.vdb)")

    def test_voxelize(self):
        self.ok("specimen", "scan", "-o", "scan.nrrd", "--spacing-mm", "0.4", "--force")
        result = json.loads(self.ok("voxelize", "scan.nrrd", "--voxel-mm", "0.4", "-o", "tooth.vdb", "--json",
                                    "--report", "report", "--force"))
        with open(os.path.join(self.folder, "report/report.json"), encoding="utf-8") as file:
            result["report"] = json.load(file)
        self.assert_documented(keys_of(result, ()), "voxelize", TISSUES | {"report"})
        for name in ("histogram.csv", "slice-x.csv"):
            self.assert_documented(self.header("report/" + name), "voxelize")

    def test_live_and_rig_check(self):
        result = json.loads(self.live("--tooth", "block.vdb", "--bur", BUR, "--duration-s", "0.4", "-o", "session.h5",
                                      "--json"))
        self.assert_documented(keys_of(result, ()), "live --json")
        self.assert_h5_documented("session.h5", ["Trace files (.h5)", "Recordings of live sessions (.h5)"])
        self.live("--protocol", "damping-sweep 1..4 N*s/m in 2 geometric steps of 0.5 s", "-o", "sweep.h5")
        self.live("--protocol", "step 0.3 N for 0.4 s", "-o", "step.h5")
        for name in ("session", "sweep", "step"):
            self.ok("rig-check", name + ".h5", "--report", name, "--no-plots", "--force")
            with open(os.path.join(self.folder, name, "report.json"), encoding="utf-8") as file:
                report = json.load(file)
            figures = {line["figure"] for line in report["lines"]}
            self.assert_documented(set(keys_of(report, ())) - figures, "rig-check")
            for table in Path(self.folder, name).glob("*.csv"):
                self.assertIn(table.name, words_in_backticks(self.section("rig-check")))
                self.assert_documented(self.header(f"{name}/{table.name}"), "rig-check")

    def test_score_and_truth(self):
        self.ok("specimen", "cavity", "--kind", "box", "--voxel-mm", "0.25", "--size-mm", "8,5,6", "--original",
                "before.vdb", "-o", "after.vdb", "--truth", "truth.json", "--force")
        score = json.loads(self.ok("score", "--original", "before.vdb", "--prepared", "after.vdb", "--type", "class1",
                                   "-o", "score.json", "--force", "--json"))
        definitions = read("lib/toothprep/tools/score/DEFINITIONS.md")
        figures = set(re.findall(r"`(\w+)", definitions)) | set(re.findall(r"\w+", definitions))
        self.assert_documented(keys_of(score, ("uncertainty", "options")), "score", figures)
        with open(os.path.join(self.folder, "truth.json"), encoding="utf-8") as file:
            truth = json.load(file)
        self.assert_documented([key for key in truth if "_mm" not in key and "_deg" not in key], "Specimens",
                               {"voxel_mm", "pulp_exposed", "undercut_draws"})

    def test_calibrate(self):
        self.ok("specimen", "measurement", "--tooth", "block.vdb", "--bur", BUR, "--trajectory", "pocket.toml", "-o",
                "rig.h5", "--force")
        self.ok("calibrate", "--tooth", "block.vdb", "--measured", "rig.h5", "--bur", BUR, "-o", "fit.json", "--bootstrap",
                "50", "--report", "fit", "--no-plots", "--params-out", "fit.toml", "--force")
        with open(os.path.join(self.folder, "fit.json"), encoding="utf-8") as file:
            fit = json.load(file)
        self.assert_documented(keys_of(fit, ()), "calibrate", TISSUES)
        for name in ("force-1.csv", "adequacy.csv"):
            self.assert_documented(self.header("fit/" + name), "calibrate")
        self.replay("path.toml", "--params", "fit.toml")

    def test_figures(self):
        Examples.run_experiment(self, next(t for kind, _, t, _, _ in examples() if kind == "experiment"))
        with open(os.path.join(self.folder, "figures/figures.json"), encoding="utf-8") as file:
            report = json.load(file)
        self.assert_documented(keys_of(report, ("plots", "maps", "pictures")), "figures", TISSUES)
        text = next(t for kind, _, t, _, _ in examples() if kind == "cutting-test")
        report = Examples.run_cutting_test(self, text)
        self.assert_documented(keys_of(report, ("plots", "maps", "pictures")), "figures", TISSUES)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[4:], verbosity=2)
