"""What help texts and installed pages name is installed.

Usage: test_installed.py PROGRAM BINARY_DIR
"""
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

PROGRAM, BINARY = sys.argv[1:3]


def help_texts(*command):
    """{command: its help} of a command and all below it."""
    text = subprocess.run([PROGRAM, *command, "--help"], capture_output=True, text=True, check=True).stdout
    texts = {" ".join(command) or "toothprep": text}
    below = re.search(r"^Subcommands:\n((?:^ .*\n)+)", text, re.M)
    for name in re.findall(r"^  (\S+)", below[1], re.M) if below else []:
        texts.update(help_texts(*command, name))
    return texts


class Installed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.prefix = Path(tempfile.mkdtemp(prefix="toothprep-installed-"))
        cls.addClassCleanup(shutil.rmtree, cls.prefix)
        subprocess.run(["cmake", "--install", BINARY, "--prefix", cls.prefix, "--component", "data"],
                       stdout=subprocess.DEVNULL, check=True)

    def test_every_file_that_a_help_text_names_is_installed(self):
        texts, named = help_texts(), set()
        self.assertIn("specimen measurement", texts)
        for command, text in texts.items():
            for path in re.findall(r"(?<![\w/])data/([\w./-]*\w)", re.sub(r"\n +", " ", text)):
                named.add(path)
                self.assertTrue((self.prefix / "share/toothprep" / path).exists(), f"{command}: data/{path}")
            for path in re.findall(r"(?<![\w/])(share/[\w./-]*\w)", text):
                self.assertTrue((self.prefix / path).exists(), f"{command}: {path}")
        self.assertTrue({"rig/FORMATS.md", "trajectories", "parameters", "guide.md"} <= named)

    def test_links_between_installed_pages_hold(self):
        pages = self.prefix / "share/doc/toothprep"
        checked = 0
        for page in [*pages.rglob("*.md"), *(pages / "data").rglob("*.md")]:
            text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
            for link in re.findall(r"\]\(([^)\s#]+)", text):
                if re.match(r"\w+:", link) or Path(link).suffix in (".h", ".cpp"):
                    continue
                checked += 1
                # As a browser resolves it: the folders' names count, not where a link leads.
                target = Path(re.sub(r"//+", "/", str(page.parent / link)))
                parts = []
                for part in target.parts:
                    parts = parts[:-1] if part == ".." else parts + [part]
                self.assertTrue(Path(*parts).exists(), f"{page.relative_to(self.prefix)}: {link}")
        self.assertGreater(checked, 100)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
