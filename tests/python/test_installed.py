"""The module as it is installed: where Python looks under the prefix, complete, with the installed data."""
import os
import subprocess
import sys
from pathlib import Path

import toothprep
from module_test import SOURCE, CommandTest, main

BUILD = Path(toothprep.__file__).resolve().parents[2]
VERSION = f"python{sys.version_info[0]}.{sys.version_info[1]}"


class Installed(CommandTest):
    def install(self, prefix, *options, **environment):
        done = subprocess.run(["cmake", f"-DCMAKE_INSTALL_PREFIX={prefix}", *options, "-P",
                               BUILD / "lib" / "python" / "cmake_install.cmake"], capture_output=True, text=True,
                              env={**os.environ, **environment})
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_a_prefix_of_ones_own(self):
        prefix = Path(self.path("prefix"))
        self.install(prefix)
        (prefix / "share" / "toothprep").mkdir(parents=True)
        os.symlink(SOURCE / "data" / "burs", prefix / "share" / "toothprep" / "burs")
        environment = {**os.environ, "PYTHONPATH": str(prefix / "lib" / VERSION / "site-packages")}
        code = "import toothprep; print(toothprep.__file__); print(toothprep.data_folder()); toothprep.Bur('paper-cylinder')"
        done = subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True, env=environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        module, data = done.stdout.splitlines()
        self.assertEqual(Path(module).parent, prefix / "lib" / VERSION / "site-packages" / "toothprep")
        self.assertEqual(data, str(prefix / "share" / "toothprep"))
        there = {path.name for path in Path(module).parent.iterdir()}
        self.assertLessEqual({"__init__.py", "__init__.pyi", "py.typed"}, there)
        self.assertNotIn("__pycache__", there)

    def test_a_package_for_the_system(self):
        self.install("/usr", DESTDIR=self.path("root"))
        self.assertTrue(Path(self.path("root/usr/lib/python3/dist-packages/toothprep/__init__.py")).exists())


if __name__ == "__main__":
    main()
