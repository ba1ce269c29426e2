"""The C++ reference: Doxygen over the public headers. Its warnings are faults."""
import re
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = """
PROJECT_NAME = toothprep
PROJECT_BRIEF = "C++ reference"
FILTER_PATTERNS = *.h={filter}
OUTPUT_DIRECTORY = {out}
HTML_OUTPUT = .
GENERATE_LATEX = NO
STRIP_FROM_PATH = {lib}
STRIP_FROM_INC_PATH = {lib}
JAVADOC_AUTOBRIEF = YES
DISTRIBUTE_GROUP_DOC = YES
EXTRACT_PRIVATE = NO
HAVE_DOT = NO
BUILTIN_STL_SUPPORT = YES
SORT_MEMBER_DOCS = NO
VERBATIM_HEADERS = NO
SHOW_USED_FILES = NO
QUIET = YES
WARN_IF_UNDOCUMENTED = YES
WARN_IF_INCOMPLETE_DOC = NO
WARN_NO_PARAMDOC = NO
WARN_LOGFILE = {log}
"""

FIRST_PAGE = """/** @mainpage
<a href="../index.html">All pages of toothprep</a>. How to build against it: <a href="../data/library.html">the C++ library</a>.

What a program includes, header by header: <a href="files.html">files</a>. Types: <a href="annotated.html">classes</a>.
Functions: <a href="namespacetoothprep.html">namespace</a>. Inside, lengths are in mm, times in s, forces in N
(@ref units.h); frames are W, B and D (@ref geometry.h).
*/
/** @namespace toothprep
Everything public. */
/** @namespace toothprep::units
Named conversions between the internal units and those of files and options. */
"""


def public_headers():
    """Those that are installed: PUBLIC_HEADERS of each module's CMakeLists.txt."""
    for declaration in sorted(ROOT.glob("lib/toothprep/*/*/CMakeLists.txt")):
        names = re.search(r"PUBLIC_HEADERS((?:\s+[\w/]+\.h)+)", declaration.read_text(encoding="utf-8"))
        for name in names[1].split() if names else []:
            yield declaration.parent / name


def build_cpp_reference(out, headers=None):
    """Writes the pages into `out`; returns the faults, a line each."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder, "warnings")
        settings = SETTINGS.format(filter=ROOT / "scripts" / "site" / "doxygen-comments", out=out, lib=ROOT / "lib", log=log)
        first_page = Path(folder, "first_page.dox")
        first_page.write_text(FIRST_PAGE, encoding="utf-8")
        inputs = " \\\n".join(str(header) for header in headers or [first_page, *public_headers()])
        out.mkdir(parents=True)
        subprocess.run(["doxygen", "-"], input=f"{settings}INPUT = {inputs}\n".encode(), check=True)
        return log.read_text(encoding="utf-8").replace(f"{ROOT}/", "").splitlines()
