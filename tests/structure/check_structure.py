"""The house rules that a reviewer would otherwise have to remember, read from the sources.

- A room includes only rooms that its CMakeLists.txt declares (ROOMS), directly or through them; there are
  no cycles, and the rooms of the haptic step need no room of file formats.
- Heavy headers stay in the rooms that need them.
- Every source is built, every room has a README, and no file is large.

Usage: check_structure.py [ROOT]; prints one line per breach and exits 1 if there is one.
"""
import re
import subprocess
import sys
from pathlib import Path

# Header prefix -> folders that may include it. Tests of a room may do what the room may do.
HEAVY = {
    "openvdb": ["lib/toothprep/toothfile", "tests"],
    "nanovdb": ["tests"],
    "itk": ["lib/toothprep/scan"],
    "gdcm": ["lib/toothprep/scan"],
    "hdf5": ["lib/toothprep/trace"],
    "H5": ["lib/toothprep/trace"],
    "CGAL": ["lib/toothprep/mesh", "tests"],
    "ceres": ["lib/toothprep/calibrate"],
    "embree": ["lib/toothprep/raycast"],
    "OpenEXR": ["lib/toothprep/render"],
    "Imf": ["lib/toothprep/render"],
    "png": ["lib/toothprep/render"],
    "CLI/": ["apps"],
    "openssl": ["lib/toothprep/core"],
}
LARGEST_FILE = 1_000_000  # bytes
SOURCES = {".h", ".cpp", ".cc", ".hpp"}


def includes(path):
    """(line number, header) of each #include."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        match = re.match(r'\s*#\s*include\s*[<"]([^>"]+)[>"]', line)
        if match:
            yield number, match.group(1)


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


def reachable(rooms, start):
    """All rooms that `start` may include, itself among them; and a cycle, if there is one."""
    seen, stack = {start}, [(start, (start,))]
    cycle = None
    while stack:
        room, path = stack.pop()
        for needed in rooms.get(room, {}).get("ROOMS", []):
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


def check(root):
    root = Path(root).resolve()
    library = root / "lib" / "toothprep"
    breaches, rooms = [], {}
    keys = ["SOURCES", "ROOMS", "PUBLIC", "PRIVATE"]
    folders = sorted(p for p in library.iterdir() if p.is_dir())
    for folder in folders:
        place = folder.relative_to(root)
        if not (folder / "README.md").is_file():
            breaches.append(f"{place}: has no README.md")
        if not (folder / "CMakeLists.txt").is_file():
            breaches.append(f"{place}: has no CMakeLists.txt")
            continue
        calls = declared(cmake_text(folder / "CMakeLists.txt"), "toothprep_room", keys)
        if list(calls) != [folder.name]:
            breaches.append(f"{place}/CMakeLists.txt: declares {', '.join(calls) or 'no room'} "
                            f"instead of {folder.name}")
        rooms.update(calls)

    for name, room in sorted(rooms.items()):
        for needed in room["ROOMS"]:
            if needed not in rooms:
                breaches.append(f"lib/toothprep/{name}/CMakeLists.txt: ROOMS names '{needed}', which does "
                                "not exist")
        cycle = reachable(rooms, name)[1]
        if cycle:
            breaches.append(f"lib/toothprep/{name}/CMakeLists.txt: ROOMS form a cycle: {' -> '.join(cycle)}")

    top = root / "CMakeLists.txt"
    step = re.search(r"set\s*\(STEP_ROOMS\s+([^)]*)\)", cmake_text(top)) if top.is_file() else None
    step = set(step.group(1).split()) if step else set()
    for name in sorted(step & set(rooms)):
        for needed in sorted(reachable(rooms, name)[0] - step):
            breaches.append(f"lib/toothprep/{name}: belongs to the haptic step but needs '{needed}', which "
                            "does not")

    for folder in folders:
        allowed = reachable(rooms, folder.name)[0]
        built = rooms.get(folder.name, {}).get("SOURCES", [])
        for path in sorted(folder.rglob("*")):
            if path.suffix not in SOURCES:
                continue
            place = path.relative_to(root)
            if path.suffix in {".cpp", ".cc"} and str(path.relative_to(folder)) not in built:
                breaches.append(f"{place}: is not among the SOURCES of its room")
            for number, header in includes(path):
                match = re.match(r"toothprep/(\w+)/", header)
                if match and match.group(1) not in allowed:
                    breaches.append(f"{place}:{number}: includes {header}, but {folder.name} does not "
                                    f"declare the room {match.group(1)} (ROOMS in its CMakeLists.txt)")

    for part in ("lib", "apps", "tests"):
        for path in sorted((root / part).rglob("*")):
            if path.suffix not in SOURCES:
                continue
            place = str(path.relative_to(root))
            for number, header in includes(path):
                for prefix, homes in HEAVY.items():
                    homes = homes + [h.replace("lib/toothprep/", "tests/") for h in homes]
                    if header.startswith(prefix) and not any(place.startswith(h + "/") for h in homes):
                        breaches.append(f"{place}:{number}: includes {header}, which belongs in "
                                        f"{' or '.join(homes[:1])}")

    for path in repository_files(root):
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
