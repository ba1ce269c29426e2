"""The container's recipes as text: both install the same, in commands that a shell takes, of packages that are known.

Usage: test_container.py SOURCE_DIR VERSION
"""
import fnmatch
import re
import subprocess
import sys
import unittest
from pathlib import Path

SOURCE, VERSION = Path(sys.argv[1]), sys.argv[2]
DOCKER = (SOURCE / "scripts/container/Dockerfile").read_text(encoding="utf-8")
APPTAINER = (SOURCE / "scripts/container/toothprep.def").read_text(encoding="utf-8")


def section(name):
    """The lines of %name of the Apptainer recipe."""
    text = re.search(rf"^%{name}\n(.*?)(?=^%|\Z)", APPTAINER, re.M | re.S).group(1)
    return [line.strip() for line in text.splitlines() if line.strip()]


class Container(unittest.TestCase):
    def test_both_recipes_begin_and_install_alike(self):
        base = re.search(r"^FROM (\S+)$", DOCKER, re.M).group(1)
        self.assertIn(f"From: {base}\n", APPTAINER)
        runs = re.findall(r"^RUN (.*)$", DOCKER, re.M)
        self.assertEqual(section("post") + section("test"), runs)
        for line in runs + section("runscript"):
            self.assertEqual(subprocess.run(["bash", "-n", "-c", line]).returncode, 0, line)

    def test_they_take_the_package_that_is_made(self):
        name = f"toothprep_{VERSION}_amd64.deb"
        self.assertTrue(fnmatch.fnmatch(name, re.search(r"^COPY (\S+) /opt/$", DOCKER, re.M).group(1)))
        self.assertTrue(fnmatch.fnmatch("build/" + name, section("files")[0].split()[0]))
        self.assertEqual(section("files")[0].split()[1], "/opt/")
        installed = re.search(r"--no-install-recommends ([^&]*)&&", DOCKER).group(1).split()
        self.assertTrue(fnmatch.fnmatch("/opt/" + name, installed[0]))
        known = (SOURCE / "scripts/install-packages").read_text(encoding="utf-8")
        for package in installed[1:]:
            self.assertRegex(known, rf"\b{package}\b")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
