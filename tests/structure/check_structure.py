"""The rules of the source tree, checked.

- A module includes only modules that its CMakeLists.txt declares (MODULES), directly or through them; there are
  no cycles.
- Three rings, lib/toothprep/step, tools and proof: the step needs modules of the step only, the tools nothing of the
  proof; the light modules (CMakeLists.txt) need light modules only.
- Heavy headers stay in the modules that need them. Public headers (PUBLIC_HEADERS) include public ones only.
- Every source is built, every module has a README and stands in the layout of the top README, and no file is large.
- In Markdown every relative link leads to a file, and to a heading where it names one; every path of the tree that
  Markdown, sources or help texts name exists.

Usage: check_structure.py [ROOT]; prints one line per breach and exits 1 if there is one.
"""
import re
import subprocess
import sys
from pathlib import Path

# Header prefix -> folders that may include it. Tests of a module may do what the module may do.
HEAVY = {
    "openvdb": ["lib/toothprep/tools/files", "tests"],
    "nanovdb": ["tests"],
    "itk": ["lib/toothprep/tools/scan_files", "lib/toothprep/tools/segmentation"],
    "gdcm": ["lib/toothprep/tools/scan_files"],
    "hdf5": ["lib/toothprep/tools/files"],
    "H5": ["lib/toothprep/tools/files"],
    "CGAL": ["lib/toothprep/tools/shells", "lib/toothprep/tools/decimation", "tests"],
    "ceres": ["lib/toothprep/tools/calibrate"],
    "embree": ["lib/toothprep/tools/mesh"],
    "boost/asio": ["lib/toothprep/tools/view"],
    "boost/beast": ["lib/toothprep/tools/view"],
    "OpenEXR": ["lib/toothprep/tools/render"],
    "Imf": ["lib/toothprep/tools/render"],
    "png": ["lib/toothprep/tools/render"],
    "archive": ["lib/toothprep/tools/models"],
    "CLI/": ["apps"],
    "pybind11": ["lib/python"],
    "openssl": ["lib/toothprep/step/core"],
}
RINGS = ["step", "tools", "proof"]  # each may use itself and what stands before it
LARGEST_FILE = 1_000_000  # bytes
LONGEST_FUNCTION = 100  # lines, of the library and the commands
SOURCES = {".h", ".cpp", ".cc", ".hpp"}
# A path from the root, or from lib/toothprep, ending in a name; one with a capital in a folder's name is a placeholder.
TREE_PATH = re.compile(r"(?<![\w/.~$*-])((?:lib/toothprep|apps/toothprep|data|tests|scripts|step|tools|proof)/[\w./*+-]*[\w*])")


def includes(path):
    """(line number, header) of each #include."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match = re.match(r'\s*#\s*include\s*[<"]([^>"]+)[>"]', line)
        if match:
            yield number, match.group(1)


def without_texts(code):
    """C++ with blanks for comments, strings and characters; the lines stay where they are."""
    return re.sub(r'R"(\w*)\(.*?\)\1"|//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|(?<![0-9a-fA-F])\'(?:\\.|[^\'\\\n])+\'',
                  lambda match: re.sub(r"[^\n]", " ", match.group()), code, flags=re.DOTALL)


def functions(code):
    """(first line, lines) of each function that isn't inside another one: a block whose head, back to the last
    semicolon or brace, has parentheses and makes neither a type, a namespace nor a value. A brace without a space
    before it makes a value, too."""
    code = without_texts(code)
    blocks, head = [], 0  # of the open ones: what they are, where their head begins
    for at, c in enumerate(code):
        if c == "{":
            text = code[head:at]
            if not text.endswith((" ", "\n")):
                blocks.append(("value", head))
                continue
            is_type = re.search(r"\b(namespace|class|struct|enum|union)\b[^()]*$", text)
            is_function = ")" in text and not is_type and not text.rstrip().endswith("=")
            blocks.append(("function" if is_function else "other", head + len(text) - len(text.lstrip())))
        elif c == "}" and blocks:
            kind, begin = blocks.pop()
            if kind == "value":
                continue
            if kind == "function" and not any(outer == "function" for outer, _ in blocks):
                yield code.count("\n", 0, begin) + 1, code.count("\n", begin, at) + 1
        if c in "{};":
            head = at + 1


def cmake_text(path):
    return re.sub(r"#[^\n]*", "", path.read_text(encoding="utf-8"))


def declared(cmake, function, keys):
    """{name: {key: [values]}} of the calls of `function`."""
    calls = {}
    for call in re.findall(function + r"\s*\(([^)]*)\)", cmake):
        words, key = call.split(), None
        entry = calls.setdefault(words[0], {k: [] for k in keys})
        for word in words[1:]:
            if word in keys:
                key = word
            elif key:
                entry[key].append(word)
    return calls


def reachable(modules, start):
    """All modules that `start` may include, itself among them; and a cycle, if there is one."""
    seen, stack = {start}, [(start, (start,))]
    cycle = None
    while stack:
        module, path = stack.pop()
        for needed in modules.get(module, {}).get("MODULES", []):
            if needed == start:
                cycle = path + (start,)
            if needed not in seen:
                seen.add(needed)
                stack.append((needed, path + (needed,)))
    return seen, cycle


def repository_files(root):
    """The files that git tracks or would add; without git, all but builds, results and hidden folders."""
    try:
        names = subprocess.run(
            ["git", "-c", f"safe.directory={root}", "-C", root, "ls-files", "-z", "--cached", "--others",
             "--exclude-standard"], check=True, capture_output=True).stdout
        return [root / n for n in names.decode().split("\0") if n and (root / n).is_file()]
    except (OSError, subprocess.CalledProcessError):
        return [p for p in root.rglob("*") if p.is_file() and not any(
            part.startswith((".", "build", "quickstart-results")) for part in p.relative_to(root).parts[:-1])]


def headings(path):
    """The anchors of a Markdown file, as the usual viewers make them."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.S | re.M)
    titles = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w -]", "", t.strip().lower()).replace(" ", "-") for t in titles}


def named_path_exists(root, path):
    """Of a path in a text: from the root or from lib/toothprep, with wildcards, a header's name without its ending."""
    if any(part.isupper() for part in path.split("/")[:-1]) or re.search(r"(^|/)(NAME|FILE|DIR)\b", path):
        return True
    for base in (root, root / "lib" / "toothprep"):
        if (base / path).exists() or any(base.glob(path + ".*" if "*" not in path else path)):
            return True
    return False


def check_texts(root, files):
    """Links and paths that lead nowhere."""
    for path in files:
        place = path.relative_to(root)
        if path.suffix not in SOURCES | {".md"} or place.parts[:2] == ("tests", "structure"):
            continue
        lines = path.read_text(encoding="utf-8").splitlines()
        fenced = False
        for number, line in enumerate(lines, 1):
            fenced ^= path.suffix == ".md" and line.startswith("```")
            if path.suffix == ".md" and not fenced:
                for link in re.findall(r"\]\(([^)\s]+)\)", line):
                    if re.match(r"\w+:", link):
                        continue
                    file, _, anchor = link.partition("#")
                    target = (path.parent / file).resolve() if file else path
                    if not target.exists():
                        yield f"{place}:{number}: links to {link}, which does not exist"
                    elif anchor and anchor not in headings(target):
                        yield f"{place}:{number}: links to {link}, but there is no such heading"
                line = re.sub(r"\]\([^)]*\)", "]", line)
            elif path.suffix != ".md":  # in sources, what comments and texts name as files
                if re.match(r"\s*#\s*include", line):
                    continue
                line = " ".join(m for m in TREE_PATH.findall(line) if re.search(r"\.(md|h|cpp|toml|py)$", m))
            for named in TREE_PATH.findall(line):
                if not named_path_exists(root, named):
                    yield f"{place}:{number}: names {named}, which does not exist"


def check(root):
    root = Path(root).resolve()
    library = root / "lib" / "toothprep"
    breaches, modules, ring_of = [], {}, {}
    keys = ["SOURCES", "MODULES", "PUBLIC", "PRIVATE", "PUBLIC_HEADERS"]
    folders = sorted(p for ring in RINGS for p in (library / ring).glob("*") if p.is_dir())
    for path in library.iterdir():
        if path.is_dir() and path.name not in RINGS:
            breaches.append(f"{path.relative_to(root)}: is none of the rings {', '.join(RINGS)}")
    for folder in folders:
        place = folder.relative_to(root)
        ring_of[folder.name] = folder.parent.name
        if not (folder / "README.md").is_file():
            breaches.append(f"{place}: has no README.md")
        if not (folder / "CMakeLists.txt").is_file():
            breaches.append(f"{place}: has no CMakeLists.txt")
            continue
        calls = declared(cmake_text(folder / "CMakeLists.txt"), "toothprep_(?:module|plugin)", keys)
        if list(calls) != [folder.name]:
            breaches.append(f"{place}/CMakeLists.txt: declares {', '.join(calls) or 'no module'} "
                            f"instead of {folder.name}")
        modules.update(calls)

    readme = root / "README.md"
    rows = dict(re.findall(r"^\| `(\w+)/` \| ([^|]*) \|", readme.read_text(encoding="utf-8"), re.M)) if readme.is_file() else {}
    for ring, row in rows.items():
        listed = set(re.findall(r"\w+", row))
        there = {name for name, its in ring_of.items() if its == ring}
        for name in sorted(listed ^ there):
            breaches.append(f"README.md: the layout of {ring}/ " +
                            (f"lacks the module {name}" if name in there else f"has {name}, which is no module of it"))

    for name, module in sorted(modules.items()):
        for needed in module["MODULES"]:
            if needed not in modules:
                breaches.append(f"{name}'s CMakeLists.txt: MODULES names '{needed}', which does not exist")
        cycle = reachable(modules, name)[1]
        if cycle:
            breaches.append(f"{name}'s CMakeLists.txt: MODULES form a cycle: {' -> '.join(cycle)}")
        for needed in sorted(reachable(modules, name)[0]):
            if name in ring_of and needed in ring_of and (
                    RINGS.index(ring_of[needed]) > RINGS.index(ring_of[name])):
                breaches.append(f"{name}: belongs to the ring '{ring_of[name]}' but needs '{needed}' of the "
                                f"ring '{ring_of[needed]}'")

    top = root / "CMakeLists.txt"
    top = cmake_text(top) if top.is_file() else ""
    lists = {name: set(values.split()) for name, values in
             re.findall(r"set\s*\((\w+)_MODULES\s+([^)]*)\)", top)}
    light = set()
    for word in lists.get("LIGHT", ()):
        light |= lists.get("STEP", set()) if word == "${STEP_MODULES}" else {word}
    for name in sorted(light & set(modules)):
        for needed in sorted(reachable(modules, name)[0] - light):
            breaches.append(f"{name}: is a light module but needs '{needed}', which is not")

    for folder in folders:
        allowed = reachable(modules, folder.name)[0]
        built = modules.get(folder.name, {}).get("SOURCES", [])
        for path in sorted(folder.rglob("*")):
            if path.suffix not in SOURCES:
                continue
            place = path.relative_to(root)
            if path.suffix in {".cpp", ".cc"} and str(path.relative_to(folder)) not in built:
                breaches.append(f"{place}: is not among the SOURCES of its module")
            for number, header in includes(path):
                match = re.match(r"toothprep/(\w+)/(\w+)/", header)
                if not match:
                    continue
                ring, module = match.groups()
                if not (library / ring / module).is_dir():
                    breaches.append(f"{place}:{number}: includes {header}, but there is no module {ring}/{module}")
                elif module not in allowed:
                    breaches.append(f"{place}:{number}: includes {header}, but {folder.name} does not "
                                    f"declare the module {module} (MODULES in its CMakeLists.txt)")

    public = {f"toothprep/{ring_of[name]}/{name}/{header}" for name, module in modules.items() if name in ring_of
              for header in module["PUBLIC_HEADERS"]}
    for name in sorted(public):
        path = root / "lib" / name
        if not path.is_file():
            breaches.append(f"lib/{name}: is among the PUBLIC_HEADERS of its module, but does not exist")
            continue
        for number, header in includes(path):
            if header.startswith("toothprep/") and header not in public:
                breaches.append(f"lib/{name}:{number}: is installed, but includes {header}, which is not "
                                f"(PUBLIC_HEADERS in its CMakeLists.txt)")

    for part in ("lib", "apps", "tests"):
        for path in sorted((root / part).rglob("*")):
            if path.suffix not in SOURCES:
                continue
            place = str(path.relative_to(root))
            for number, header in includes(path):
                for prefix, homes in HEAVY.items():
                    allowed = homes + [h.replace("lib/toothprep/", "tests/") for h in homes]
                    if header.startswith(prefix) and not any(place.startswith(h + "/") for h in allowed):
                        breaches.append(f"{place}:{number}: includes {header}, which belongs in "
                                        f"{homes[0]}")

    for part in ("lib", "apps"):
        for path in sorted((root / part).rglob("*")):
            if path.suffix in SOURCES:
                for number, lines in functions(path.read_text(encoding="utf-8")):
                    if lines > LONGEST_FUNCTION:
                        breaches.append(f"{path.relative_to(root)}:{number}: a function of {lines} lines, more than "
                                        f"{LONGEST_FUNCTION}")

    files = repository_files(root)
    breaches.extend(check_texts(root, sorted(files)))
    for path in files:
        if path.stat().st_size > LARGEST_FILE:
            breaches.append(f"{path.relative_to(root)}: has {path.stat().st_size / 1e6:.1f} MB, more than "
                            f"{LARGEST_FILE / 1e6:g} MB")
    return breaches


def main():
    breaches = check(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[2])
    for breach in breaches:
        print(breach)
    sys.exit(1 if breaches else 0)


if __name__ == "__main__":
    main()
