"""data/dependencies.md against scripts/install-packages, CMake's find_package, what the program links, and Debian's own
statements of version and licence.

Usage: test_dependencies.py SOURCE_DIR PROGRAM...
"""
import re
import subprocess
import sys
import unittest
from pathlib import Path

SOURCE = Path(sys.argv[1])
PROGRAMS = [Path(sys.argv[2])] + [Path(p) for p in sys.argv[3:] if Path(p).is_file()]  # a build may lack the module
PAGE = (SOURCE / "data" / "dependencies.md").read_text(encoding="utf-8")
# [packages, version, licence, used for, CMake, libraries] of every row; the two lists may be missing.
ROWS = [[c.strip() for c in line.split("|")[1:-1]] for line in PAGE.splitlines() if line.startswith("| `")]
OF_CMAKE = {"SuiteSparse", "Python", "Python3", "Threads"}  # part of CMake or of the compiler
NAMES_ONLY = {"libboost-dev", "libboost-iostreams-dev"}  # packages that name the current version; their file is of that
DEBIAN = subprocess.run(["sh", "-c", ". /etc/os-release && echo $ID-$VERSION_ID"], capture_output=True, text=True,
                        check=True).stdout.strip()


def names(cell):
    return re.findall(r"`([^`]+)`", cell)


def column(index):
    return {name for row in ROWS if len(row) > index for name in names(row[index])}


def linked_packages(programs):
    """The packages of the libraries that programs name themselves."""
    files = set()
    for program in programs:
        needed = re.findall(r"NEEDED.*\[(.*)\]", subprocess.run(["readelf", "-d", program], capture_output=True, text=True,
                                                                check=True).stdout)
        places = dict(re.findall(r"(\S+) => (\S+)", subprocess.run(["ldd", program], capture_output=True, text=True,
                                                                   check=True).stdout))
        files |= {str(Path(places[name]).resolve()) for name in needed if name in places}
    # A package may know its file by the path before or after the merge of /usr.
    known = {path for file in files for path in (file, file.removeprefix("/usr"))}
    done = subprocess.run(["dpkg", "-S", *sorted(known)], capture_output=True, text=True, check=False)
    return {line.split(":")[0] for line in done.stdout.splitlines()}


class Dependencies(unittest.TestCase):
    def test_every_package_that_is_installed_has_a_row(self):
        script = (SOURCE / "scripts" / "install-packages").read_text(encoding="utf-8")
        wanted = {word for call in re.findall(r"(?:packages|optional)\+?=\(([^)]*)\)", script) for word in call.split()}
        self.assertGreater(len(wanted), 30)
        self.assertEqual(wanted - column(0), set())

    def test_every_package_that_cmake_looks_for_has_a_row_and_each_is_looked_for(self):
        files = [SOURCE / "CMakeLists.txt", *SOURCE.glob("lib/**/CMakeLists.txt"), *SOURCE.glob("apps/**/CMakeLists.txt")]
        text = re.sub(r"#[^\n]*", "", "\n".join(f.read_text(encoding="utf-8") for f in files))
        found = set(re.findall(r"find_package\((\w+)", text)) - OF_CMAKE - {"toothprep"}
        self.assertEqual(found ^ (column(4) - OF_CMAKE), set())

    @unittest.skipUnless(DEBIAN == "debian-12", "versions and names of packages are Debian 12's")
    def test_rows_name_what_the_programs_link_and_nothing_else(self):
        linked = linked_packages(PROGRAMS)
        stated = column(5)
        self.assertEqual(linked - stated, set(), "linked, but without a row")
        self.assertEqual(stated - linked, set(), "in a row, but not linked")

    @unittest.skipUnless(DEBIAN == "debian-12", "versions and names of packages are Debian 12's")
    def test_versions_and_licences_are_those_of_the_packages(self):
        checked = 0
        for row in ROWS:
            for package in names(row[0]):
                version = subprocess.run(["dpkg-query", "-W", "-f=${Version}", package],
                                         capture_output=True, text=True, check=False).stdout
                copyright_ = Path("/usr/share/doc", package, "copyright")
                if version and row[1] != "current":  # one that a release keeps up to date
                    checked += 1
                    self.assertRegex(version, r"(^|:|really)" + re.escape(row[1]) + r"(?!\d)", package)
                main = copyright_.is_file() and re.search(r"^Files: \*\n(?:.+\n)*?License: *(\S.*)$",
                                                          copyright_.read_text(encoding="utf-8"), re.M)
                if main and package not in NAMES_ONLY:
                    self.assertIn(main[1].strip().lower(), row[2].lower(), package)
        self.assertGreater(checked, 20)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
