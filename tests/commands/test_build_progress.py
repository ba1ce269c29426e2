"""scripts/build with PROGRESS: what ninja says becomes a line of progress, errors stay, and so does the exit status.

Usage: test_build_progress.py SOURCE_DIR
"""
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE = os.path.abspath(sys.argv[1])
LINES = ["ninja: Entering directory `build'", "[0/2] Re-checking globbed directories...", "[1/4] Building a", "[2/4] Building b",
         "b.cpp:1: warning: odd", "[4/4] Linking c"]


class Progress(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="toothprep-build-progress-")
        self.addCleanup(shutil.rmtree, self.folder)
        os.makedirs(os.path.join(self.folder, "scripts"))
        shutil.copy(os.path.join(SOURCE, "scripts/build"), os.path.join(self.folder, "scripts/build"))

    def build(self, lines, status):
        for name, text in (("cmake", "exit 0"), ("ninja", "cat <<'END'\n" + "\n".join(lines) + f"\nEND\nexit {status}")):
            path = os.path.join(self.folder, name)
            with open(path, "w", encoding="utf-8") as file:
                file.write(f"#!/bin/sh\n{text}\n")
            os.chmod(path, 0o755)
        environment = {"PATH": f"{self.folder}:/usr/bin:/bin", "PROGRESS": "1"}
        return subprocess.run([os.path.join(self.folder, "scripts/build")], capture_output=True, text=True, timeout=60,
                              env=environment, check=False)

    def test_a_build_shows_how_far_it_is_and_what_the_compiler_says(self):
        done = self.build(LINES, 0)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertIn("building: 1 of 4", done.stdout)
        self.assertIn("b.cpp:1: warning: odd", done.stdout)
        self.assertNotIn("Entering", done.stdout)

    def test_a_build_that_fails_fails(self):
        done = self.build(LINES[:3] + ["FAILED: b.o", "ninja: error: stopped"], 1)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("FAILED: b.o", done.stdout)
        self.assertIn("ninja: error: stopped", done.stdout)


if __name__ == "__main__":
    sys.argv = sys.argv[:1]
    unittest.main()
