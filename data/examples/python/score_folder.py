#!/usr/bin/env python3
"""A folder of preparations scored, one row each.

    score_folder.py ORIGINAL.vdb FOLDER [SCORES.csv]

Every .vdb, .stl and .ply in the folder is scored against the original by the rubric that is shipped for its type. What
can't be scored gets a row that says why.
"""
import csv
import sys
from pathlib import Path

import toothprep

COLUMNS = ["file", "type", "points_percent", "passed", "depth_mm", "removed_mm3", "error"]


def row_of(original, prepared):
    """The figures of one preparation."""
    row = {"file": prepared.name}
    try:
        score = toothprep.score(original, prepared)
    except toothprep.Error as error:
        return {**row, "error": error.condition}
    depth = score.get("depth_mm")
    return {**row, "type": score["options"]["type"], "points_percent": score.get("points_percent"),
            "passed": score.get("passed"), "depth_mm": depth, "removed_mm3": score["removed_mm3"]["total"]}


def main():
    """Scores the folder."""
    if len(sys.argv) not in (3, 4):
        raise SystemExit(__doc__)
    original, folder = Path(sys.argv[1]), Path(sys.argv[2])
    out = open(sys.argv[3], "w", newline="") if len(sys.argv) == 4 else sys.stdout
    table = csv.DictWriter(out, COLUMNS)
    table.writeheader()
    for prepared in sorted(folder.iterdir()):
        if prepared.suffix in (".vdb", ".stl", ".ply"):
            table.writerow(row_of(original, prepared))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
