"""The judge of the mutations: every outcome that it knows is given for what it stands for."""
import os
import tempfile
import unittest
from unittest import mock

import kinds
import mutate
import mutations
import random
import statements

TABLE = "time_s,x_mm\n0,1\n0.1,2\n"


def nrrd(spacing="1", sizes="2 2 2", data=bytes([3] * 8)):
    return (f"NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {sizes}\n"
            f"space directions: ({spacing},0,0) (0,1,0) (0,0,1)\nencoding: raw\n\n").encode() + data


def kind(says, **more):
    return kinds.Kind("k", "in", (), ("out",), says, **more)


def done(status=0, out="", error="", resident=1e6, timed_out=False):
    return mutate.Done(status, out, error, resident, timed_out)


class Judge(unittest.TestCase):
    def outcome(self, answer, left=(), says=statements.csv, why="", **more):
        base = mock.Mock(figures={"volume": 1}, warnings={"warning: as ever"}, path="")
        with mock.patch.object(mutate, "judge_apart", lambda *_: why):
            return mutate.judge(kind(says, **more), base, "/nonexistent", answer, set(left))[0]

    def test_a_refusal_is_one_line_and_nothing_else(self):
        line = "toothprep: in: is damaged\n"
        self.assertEqual(self.outcome(done(1, error=line)), "refused")
        self.assertEqual(self.outcome(done(1, error="warning: as ever\n" + line)), "refused")
        self.assertEqual(self.outcome(done(1, error=line + line)), "ragged")
        self.assertEqual(self.outcome(done(1)), "ragged")
        self.assertEqual(self.outcome(done(1, error="std::bad_alloc\n")), "ragged")
        self.assertEqual(self.outcome(done(2, error=line)), "ragged")
        self.assertEqual(self.outcome(done(1, out="{}", error=line)), "ragged")
        self.assertEqual(self.outcome(done(1, error=line), left=["out"]), "leftover")
        self.assertEqual(self.outcome(done(1, error=line), left=["out"], keeps=True), "refused")

    def test_what_ends_a_run_badly(self):
        self.assertEqual(self.outcome(done(-11)), "crash")
        self.assertEqual(self.outcome(done(134)), "crash")
        self.assertEqual(self.outcome(done(-9, timed_out=True), why="malformed"), "hang")
        self.assertEqual(self.outcome(done(-9, timed_out=True)), "long work")
        self.assertEqual(self.outcome(done(resident=1.6e9)), "memory")
        self.assertEqual(self.outcome(done(out='{"volume": 1}'), left=["out", ".part"]), "leftover")

    def test_other_figures_need_a_warning_or_a_reason(self):
        self.assertEqual(self.outcome(done(out='{"volume": 1}'), left=["out"]), "same")
        other = '{"volume": 2}'
        self.assertEqual(self.outcome(done(out=other, error="warning: new\n")), "with warning")
        self.assertEqual(self.outcome(done(out=other, error="warning: as ever\n"), why="no reason"), "SILENT")
        self.assertEqual(self.outcome(done(out=other), why=""), "as stated")
        self.assertEqual(self.outcome(done(out='{"volume": 1, "step_us": 7}')), "same")


class Statements(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def file(self, name, content):
        path = os.path.join(self.folder.name, name)
        with open(path, "wb") as f:
            f.write(content if isinstance(content, bytes) else content.encode())
        return path

    def why(self, says, before, after, old=None, new=None):
        return mutate.silent(kind(says), (self.file("before", before), old or {}), (self.file("after", after), new or {}))

    def test_a_table_may_say_another_number_but_not_be_malformed(self):
        self.assertEqual(self.why(statements.csv, TABLE, TABLE.replace("0.1", "0.2")), "")
        for after in (TABLE.replace("0.1", "nan"), TABLE.replace("0.1", "0.1 s"), TABLE.replace("0.1,2", "0.1"),
                      TABLE + "x", TABLE.replace("0.1", "0x1"), ""):
            self.assertNotEqual(self.why(statements.csv, TABLE, after), "", after)
        self.assertIn("the file says the same", self.why(statements.csv, TABLE, TABLE.replace(",", ", ")))

    def test_what_no_file_makes_plausible_needs_a_warning(self):
        after = TABLE.replace("0.1", "0.2")
        for figures in ({"energy_ratio": 0.05}, {"peak_force_n": 60}, {"x": float("nan")}):
            self.assertNotEqual(self.why(statements.csv, TABLE, after, {}, figures), "")

    def test_volumes_follow_spacing_and_voxels(self):
        def reader(path):
            return statements.nrrd(path, {"enamel": (1, 9)})

        def figures(volume):
            return {"volume_mm3.enamel": volume}
        self.assertEqual(self.why(reader, nrrd(), nrrd("2"), figures(8), figures(16)), "")
        self.assertNotEqual(self.why(reader, nrrd(), nrrd("2"), figures(8), figures(8)), "")
        fewer = nrrd(data=bytes([3] * 7 + [0]))
        self.assertEqual(self.why(reader, nrrd(), fewer, figures(800), figures(795)), "")
        self.assertNotEqual(self.why(reader, nrrd(), fewer, figures(800), figures(500)), "")
        for after in (nrrd("nan"), nrrd("0"), nrrd("none"), nrrd("-1e9"), nrrd(sizes="2 2 1"), nrrd(data=bytes(7))):
            self.assertNotEqual(self.why(reader, nrrd(), after, figures(8), figures(8.1)), "", after)

    def test_the_checksum_of_gzip_counts(self):
        import gzip
        packed = bytearray(gzip.compress(bytes(1000)))
        packed[-6] ^= 1
        with self.assertRaises(Exception):
            statements.inflate(bytes(packed))


class Mutations(unittest.TestCase):
    def test_the_same_seed_gives_the_same_damage_and_never_none(self):
        for data in (b"", b"x", TABLE.encode(), bytes(3000), nrrd()):
            for seed in range(200):
                results = [mutations.mutated(data, random.Random(seed)) for _ in range(2)]
                self.assertEqual(*results)
                if data:
                    self.assertNotEqual(results[0][1], data)


if __name__ == "__main__":
    unittest.main()
