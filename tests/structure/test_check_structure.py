"""Each breach that check_structure.py is there for, made on purpose in a small tree."""
import tempfile
import unittest
from pathlib import Path

from check_structure import check

TREE = {
    "CMakeLists.txt": "set(STEP_MODULES core tooth)\nset(TOOLS_MODULES files live)\n"
                      "set(LIGHT_MODULES ${STEP_MODULES} live)\n",
    "lib/toothprep/step/core/CMakeLists.txt":
        "toothprep_module(core\n  SOURCES a.cpp\n  PUBLIC Eigen3::Eigen)\n",
    "lib/toothprep/step/core/README.md": "core",
    "lib/toothprep/step/core/a.h": "#include <string>\n",
    "lib/toothprep/step/core/a.cpp": '#include "toothprep/step/core/a.h"\n#include <openssl/evp.h>\n',
    "lib/toothprep/step/tooth/CMakeLists.txt":
        "toothprep_module(tooth SOURCES t.cpp MODULES core) # MODULES files\n",
    "lib/toothprep/step/tooth/README.md": "tooth",
    "lib/toothprep/step/tooth/t.cpp": '#include "toothprep/step/core/a.h"\n',
    "lib/toothprep/tools/files/CMakeLists.txt": "toothprep_module(files SOURCES f.cpp MODULES tooth)\n",
    "lib/toothprep/tools/files/README.md": "files",
    "lib/toothprep/tools/files/f.cpp": "#include <openvdb/openvdb.h>\n"
                                       '#include "toothprep/step/core/a.h"\n',  # through tooth
    "lib/toothprep/tools/live/CMakeLists.txt": "toothprep_module(live SOURCES l.cpp MODULES tooth)\n",
    "lib/toothprep/tools/live/README.md": "live",
    "lib/toothprep/tools/live/l.cpp": "",
    "lib/toothprep/proof/specimen/CMakeLists.txt": "toothprep_module(specimen SOURCES s.cpp MODULES files)\n",
    "lib/toothprep/proof/specimen/README.md": "specimen",
    "lib/toothprep/proof/specimen/s.cpp": "",
    "apps/toothprep/main.cpp": "#include <CLI/CLI.hpp>\n",
    "tests/tools/files/test_f.cpp": "#include <openvdb/openvdb.h>\n",
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

    def test_a_function_of_more_than_a_hundred_lines(self):
        def function(lines, head="int f(int x)"):
            return f"namespace a {{\n\n{head} {{\n" + "  // {\n" * (lines - 2) + "}\n\n}\n"
        path = "lib/toothprep/step/core/a.cpp"
        self.assertEqual(self.breaches({path: function(100)}), [])
        self.expect({path: function(101)}, path + ":3:", "101 lines")
        self.expect({path: "struct S {\n" + function(101, "S() : x{1}") + "};\n"}, "101 lines")
        self.expect({"apps/toothprep/main.cpp": function(120)}, "120 lines")
        self.expect({path: function(101, "void g(const char* s = \"{\", char c = '{')")}, "101 lines")
        # Neither a type, a table nor a namespace is a function.
        for head in ("struct S", "enum class E : int", "constexpr int kTable[] = ", "namespace b"):
            self.assertEqual(self.breaches({path: function(130, head)}), [], head)

    def test_a_good_tree_has_none(self):
        self.assertEqual(self.breaches({}), [])

    def test_public_header_that_includes_one_that_is_not_installed(self):
        tooth = "lib/toothprep/step/tooth/"
        cmake = "toothprep_module(tooth SOURCES t.cpp MODULES core PUBLIC_HEADERS t.h)"
        header = '#include "toothprep/step/core/a.h"\n'
        self.expect({tooth + "CMakeLists.txt": cmake}, tooth + "t.h", "does not exist")
        self.expect({tooth + "CMakeLists.txt": cmake, tooth + "t.h": header}, tooth + "t.h:1", "step/core/a.h, which is not")
        self.assertEqual(self.breaches({
            tooth + "CMakeLists.txt": cmake, tooth + "t.h": header,
            "lib/toothprep/step/core/CMakeLists.txt":
                "toothprep_module(core SOURCES a.cpp PUBLIC Eigen3::Eigen PUBLIC_HEADERS a.h)\n"}), [])

    def test_texts_may_name_what_exists(self):
        self.assertEqual(self.breaches({
            "lib/toothprep/step/core/README.md":
                "# core: *the* parts\n[t](../tooth/README.md), [here](#core-the-parts), [out](https://a.b/c)\n"
                "`step/core/a.h`, lib/toothprep/step/core, `tests/RING/MODULE`, `tools/files/f`, `step/core/a.*`\n",
            "lib/toothprep/step/core/a.h": "// see step/core/README.md\n"}), [])

    def test_module_that_the_layout_lacks_or_has_too_many(self):
        rows = "| `step/` | core, tooth | |\n| `tools/` | files%s | |\n"
        self.expect({"README.md": rows % ""}, "README.md", "tools/ lacks the module live")
        self.expect({"README.md": rows % ", live, old"}, "has old, which is no module")
        self.assertEqual(self.breaches({"README.md": rows % ", live"}), [])

    def test_link_to_nowhere(self):
        self.expect({"lib/toothprep/step/core/README.md": "a\n[b](../b.md)"}, "core/README.md:2", "links to ../b.md")

    def test_link_to_a_heading_that_is_missing(self):
        self.expect({"lib/toothprep/step/core/README.md": "# A\n[b](#b)"}, "no such heading")

    def test_path_that_moved(self):
        self.expect({"lib/toothprep/step/core/README.md": "`lib/toothprep/step/core/b.h`"}, "names lib/toothprep/step/core/b.h")
        self.expect({"lib/toothprep/step/core/README.md": "```\ncat data/b.toml\n```"}, "README.md:2", "data/b.toml")

    def test_path_in_a_comment_or_help_text_that_moved(self):
        self.expect({"apps/toothprep/main.cpp": '// a\nhelp("see data/b/README.md")\n'}, "main.cpp:2", "data/b/README.md")

    def test_undeclared_edge(self):
        self.expect({"lib/toothprep/step/core/a.h": '#include "toothprep/step/tooth/t.h"\n'},
                    "core/a.h:1", "does not declare the module tooth")

    def test_edge_declared_only_in_a_comment(self):
        self.expect({"lib/toothprep/step/tooth/t.cpp": '#  include <toothprep/tools/files/f.h>\n'},
                    "tooth/t.cpp:1")

    def test_include_of_a_module_that_does_not_exist(self):
        self.expect({"lib/toothprep/step/tooth/t.cpp": '#include "toothprep/tools/core/a.h"\n'},
                    "tooth/t.cpp:1", "no module tools/core")

    def test_cycle(self):
        found = self.breaches({"lib/toothprep/step/core/CMakeLists.txt":
                               "toothprep_module(core SOURCES a.cpp MODULES tooth)\n"})
        self.assertEqual(len(found), 2)  # seen from both ends
        self.assertIn("core -> tooth -> core", found[0])

    def test_unknown_module(self):
        self.expect({"lib/toothprep/tools/files/CMakeLists.txt":
                     "toothprep_module(files SOURCES f.cpp MODULES tooth teeth)\n"}, "'teeth'")

    def test_a_light_module_needs_a_heavy_one(self):
        self.expect({"lib/toothprep/tools/live/CMakeLists.txt":
                     "toothprep_module(live SOURCES l.cpp MODULES files)\n"}, "live", "light", "'files'")

    def test_a_tool_needs_the_proof(self):
        found = self.breaches({"lib/toothprep/tools/live/CMakeLists.txt":
                               "toothprep_module(live SOURCES l.cpp MODULES specimen)\n"})
        self.assertIn("live: belongs to the ring 'tools' but needs 'specimen' of the ring 'proof'", found)

    def test_a_folder_beside_the_rings(self):
        self.expect({"lib/toothprep/misc/a.h": ""}, "lib/toothprep/misc", "none of the rings")

    def test_heavy_header_outside_its_module(self):
        self.expect({"lib/toothprep/step/tooth/t.cpp": "#include <openvdb/openvdb.h>\n"},
                    "tooth/t.cpp:1", "openvdb")
        self.expect({"lib/toothprep/step/tooth/t.h": "#include <CLI/CLI.hpp>\n"}, "CLI/CLI.hpp")
        self.expect({"apps/toothprep/info.cpp": '#include "itkImage.h"\n'}, "itkImage.h")
        self.expect({"tests/step/tooth/test_g.cpp": "#include <hdf5.h>\n"}, "hdf5.h")

    def test_missing_readme(self):
        self.expect({"lib/toothprep/step/tooth/README.md": None}, "no README.md")

    def test_source_that_is_not_built(self):
        self.expect({"lib/toothprep/step/tooth/forgotten.cpp": ""}, "forgotten.cpp", "SOURCES")

    def test_module_under_another_name(self):
        found = self.breaches({"lib/toothprep/step/tooth/CMakeLists.txt":
                               "toothprep_module(teeth SOURCES t.cpp)\n"})
        self.assertTrue(any("instead of tooth" in b for b in found), found)

    def test_large_file(self):
        self.expect({"data/scan.raw": "x" * 1_000_001}, "data/scan.raw", "1.0 MB")


if __name__ == "__main__":
    unittest.main()
