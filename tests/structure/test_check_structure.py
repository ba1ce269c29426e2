"""Each breach that check_structure.py is there for, made on purpose in a small tree."""
import tempfile
import unittest
from pathlib import Path

from check_structure import check

TREE = {
    "CMakeLists.txt": "set(STEP_ROOMS core tooth)\nset(FILE_ROOMS toothfile)\n",
    "lib/toothprep/core/CMakeLists.txt": "toothprep_room(core\n  SOURCES a.cpp\n  PUBLIC Eigen3::Eigen)\n",
    "lib/toothprep/core/README.md": "core",
    "lib/toothprep/core/a.h": "#include <string>\n",
    "lib/toothprep/core/a.cpp": '#include "toothprep/core/a.h"\n#include <openssl/evp.h>\n',
    "lib/toothprep/tooth/CMakeLists.txt": "toothprep_room(tooth SOURCES t.cpp ROOMS core) # ROOMS toothfile\n",
    "lib/toothprep/tooth/README.md": "tooth",
    "lib/toothprep/tooth/t.cpp": '#include "toothprep/core/a.h"\n',
    "lib/toothprep/toothfile/CMakeLists.txt": "toothprep_room(toothfile SOURCES f.cpp ROOMS tooth)\n",
    "lib/toothprep/toothfile/README.md": "toothfile",
    "lib/toothprep/toothfile/f.cpp": "#include <openvdb/openvdb.h>\n"
                                     '#include "toothprep/core/a.h"\n',  # through tooth
    "apps/toothprep/main.cpp": "#include <CLI/CLI.hpp>\n",
    "tests/toothfile/test_f.cpp": "#include <openvdb/openvdb.h>\n",
}


class Breaches(unittest.TestCase):
    def breaches(self, changes):
        with tempfile.TemporaryDirectory() as folder:
            for name, text in {**TREE, **changes}.items():
                if text is not None:
                    path = Path(folder) / name
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.write_text(text)
            return check(folder)

    def expect(self, changes, *words):
        found = self.breaches(changes)
        self.assertEqual(len(found), 1, found)
        for word in words:
            self.assertIn(word, found[0])

    def test_a_good_tree_has_none(self):
        self.assertEqual(self.breaches({}), [])

    def test_undeclared_edge(self):
        self.expect({"lib/toothprep/core/a.h": '#include "toothprep/tooth/t.h"\n'},
                    "core/a.h:1", "does not declare the room tooth")

    def test_edge_declared_only_in_a_comment(self):
        self.expect({"lib/toothprep/tooth/t.cpp": '#  include <toothprep/toothfile/f.h>\n'}, "tooth/t.cpp:1")

    def test_cycle(self):
        found = self.breaches({"lib/toothprep/core/CMakeLists.txt":
                               "toothprep_room(core SOURCES a.cpp ROOMS tooth)\n"})
        self.assertEqual(len(found), 2)  # seen from both ends
        self.assertIn("core -> tooth -> core", found[0])

    def test_unknown_room(self):
        self.expect({"lib/toothprep/toothfile/CMakeLists.txt":
                     "toothprep_room(toothfile SOURCES f.cpp ROOMS tooth teeth)\n"}, "'teeth'")

    def test_step_needs_a_file_format(self):
        changes = {"lib/toothprep/view/CMakeLists.txt": "toothprep_room(view SOURCES v.cpp ROOMS toothfile)\n",
                   "lib/toothprep/view/README.md": "view", "lib/toothprep/view/v.cpp": "",
                   "CMakeLists.txt": "set(STEP_ROOMS core tooth view)\n"}
        self.expect(changes, "lib/toothprep/view", "haptic step", "'toothfile'")

    def test_heavy_header_outside_its_room(self):
        self.expect({"lib/toothprep/tooth/t.cpp": "#include <openvdb/openvdb.h>\n"}, "tooth/t.cpp:1", "openvdb")
        self.expect({"lib/toothprep/tooth/t.h": "#include <CLI/CLI.hpp>\n"}, "CLI/CLI.hpp")
        self.expect({"apps/toothprep/info.cpp": '#include "itkImage.h"\n'}, "itkImage.h")
        self.expect({"tests/toothfile/test_g.cpp": "#include <hdf5.h>\n"}, "hdf5.h")

    def test_missing_readme(self):
        self.expect({"lib/toothprep/tooth/README.md": None}, "no README.md")

    def test_source_that_is_not_built(self):
        self.expect({"lib/toothprep/tooth/forgotten.cpp": ""}, "forgotten.cpp", "SOURCES")

    def test_room_under_another_name(self):
        found = self.breaches({"lib/toothprep/tooth/CMakeLists.txt": "toothprep_room(teeth SOURCES t.cpp)\n"})
        self.assertTrue(any("instead of tooth" in b for b in found), found)

    def test_large_file(self):
        self.expect({"data/scan.raw": "x" * 1_000_001}, "data/scan.raw", "1.0 MB")


if __name__ == "__main__":
    unittest.main()
