"""scripts/build-site: the site of this repository is whole, and the faults that it has to find are found.

Usage: test_site.py SOURCE_DIR BINARY_DIR
"""
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SOURCE, BINARY = (Path(a).resolve() for a in sys.argv[1:3])
sys.path.insert(0, str(SOURCE / "scripts" / "site"))
import cpp_reference  # noqa: E402
import python_reference  # noqa: E402

HAS_DOXYGEN = shutil.which("doxygen") is not None
HEADER = """// A header.
#pragma once

namespace made_up {

// A thing, in a table:
//
//   x  mm   where
struct Thing {
  double x = 0, y = 0;  // mm, W
  enum class Kind { kOne } kind = Kind::kOne;  // which
  int size() const { return 2; }  // of both
%s};

enum class Mode {  // how
  kFirst,          // so
  kSecond
};

// Read and written.
Thing read(int from,
           int to);
void write(const Thing& thing);

}  // namespace made_up
"""


class Site(unittest.TestCase):
    def test_this_repository_makes_a_site_without_a_broken_link(self):
        out = BINARY / "site"
        done = subprocess.run(
            [SOURCE / "scripts" / "build-site", "-o", out, "--force", "--python-path", BINARY / "python"]
            + ([] if HAS_DOXYGEN else ["--without-cpp"]), capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        first = (out / "index.html").read_text(encoding="utf-8")
        for page in ("data/FORMATS.html", "data/rig/index.html", "lib/toothprep/step/grinding/index.html"):
            self.assertIn(f'href="{page}"', first)
            self.assertTrue((out / page).is_file())


class Faults(unittest.TestCase):
    """The same script over a small tree of its own."""

    def build(self, **pages):
        root = Path(tempfile.mkdtemp(prefix="toothprep-site-"))
        self.addCleanup(shutil.rmtree, root)
        shutil.copytree(SOURCE / "scripts" / "site", root / "scripts" / "site")
        shutil.copy(SOURCE / "scripts" / "build-site", root / "scripts")
        for name, text in pages.items():
            (root / f"{name}.md").write_text(text, encoding="utf-8")
        self.out = root / "out"
        return subprocess.run([root / "scripts" / "build-site", "-o", self.out, "--without-cpp"],
                              capture_output=True, text=True, check=False)

    def test_links_between_pages_and_to_headings_hold(self):
        done = self.build(README="# One\n\n## The a_b, twice\n\n## The a_b, twice\n\n[x](Two.md#far-α)",
                          Two="# Two\n## Far (α)\n[back](README.md#the-a_b-twice-1)")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn('href="Two.html#far-%CE%B1"', (self.out / "index.html").read_text(encoding="utf-8"))

    def test_a_link_to_no_page_is_named(self):
        done = self.build(README="# One\n[x](Two.md)")
        self.assertEqual(done.returncode, 1)
        self.assertIn("index.html: Two.md leads nowhere", done.stderr)

    def test_a_link_to_no_heading_is_named(self):
        done = self.build(README="# One\n[x](Two.md#near)", Two="# Two")
        self.assertEqual(done.returncode, 1)
        self.assertIn("index.html: Two.html#near: no such heading", done.stderr)

    def test_a_picture_from_the_network_is_named(self):
        done = self.build(README="# One\n![x](https://example.org/x.png)")
        self.assertEqual(done.returncode, 1)
        self.assertIn("loads https://example.org/x.png from elsewhere", done.stderr)

    def test_a_folder_of_other_things_is_not_replaced(self):
        self.build(README="# One")
        (self.out / ".toothprep-site").unlink()
        again = subprocess.run([self.out.parent / "scripts" / "build-site", "-o", self.out, "--without-cpp", "--force"],
                               capture_output=True, text=True, check=False)
        self.assertEqual(again.returncode, 1)
        self.assertTrue((self.out / "index.html").is_file())


@unittest.skipUnless(HAS_DOXYGEN, "needs doxygen")
class CppReference(unittest.TestCase):
    def faults(self, member):
        with tempfile.TemporaryDirectory() as folder:
            header = Path(folder, "thing.h")
            header.write_text(HEADER % member, encoding="utf-8")
            return [line.replace(folder, "") for line in cpp_reference.build_cpp_reference(Path(folder, "out"), [header])]

    def test_plain_comments_document_what_they_stand_at(self):
        self.assertEqual(self.faults(""), [])

    def test_a_member_without_a_comment_is_a_fault_at_its_line(self):
        self.assertEqual(self.faults("\n  long bare = 0;\n"), [
            "/thing.h:14: warning: Member bare (variable) of struct made_up::Thing is not documented."])


class PythonReference(unittest.TestCase):
    def page(self, text, stub=None):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "toothprep.py").write_text(text, encoding="utf-8")
            if stub:
                Path(folder, "toothprep.pyi").write_text(stub, encoding="utf-8")
            return python_reference.python_reference(folder)

    def test_functions_and_classes_stand_with_their_docstrings(self):
        page, faults = self.page('"""All."""\n\ndef load(path: str) -> int:\n    """Loads."""\n\n\n'
                                 'class Tooth:\n    """A tooth."""\n    def save(self, path):\n        """Saves."""\n')
        self.assertEqual(faults, [])
        for part in ("All.", "## load", "load(path: str) -> int", "Loads.", "## class Tooth", "save(path)", "Saves."):
            self.assertIn(part, page)

    def test_signatures_are_the_stubs_where_there_are_some(self):
        page, faults = self.page('"""All."""\ndef load(*args):\n    """Loads."""\n',
                                 "_Path = str\ndef load(path: _Path, *, fast: bool = ...) -> int: ...\n")
        self.assertEqual(faults, [])
        self.assertIn("load(path: _Path, *, fast: bool=...) -> int", page)
        self.assertIn("_Path = str", page)
        self.assertNotIn("*args", page)

    def test_a_name_without_a_docstring_is_a_fault(self):
        self.assertEqual(self.page('"""All."""\nclass Tooth:\n    """A tooth."""\n    def save(self): pass\n')[1],
                         ["Tooth.save has no docstring"])

    def test_without_a_module_there_is_no_page(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertIsNone(python_reference.python_reference(folder))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
