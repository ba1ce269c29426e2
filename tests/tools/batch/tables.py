"""batch.h5 against batch.csv, cell by cell."""
import csv
import math
import os

import h5py


def check_same_table(test, folder):
    """Columns, rows and types of both tables; gives the columns of batch.h5 by name."""
    with open(os.path.join(folder, "batch.csv"), newline="", encoding="utf-8") as file:
        head, *lines = csv.reader(file)
    with h5py.File(os.path.join(folder, "batch.h5")) as file:
        test.assertEqual(file.attrs["schema"], "toothprep-batch")
        columns = {name: column.asstr()[()] if column.dtype.kind == "S" else column[()]
                   for name, column in file["items"].items()}
    test.assertEqual(list(columns), head)
    for place, (name, column) in enumerate(columns.items()):
        test.assertEqual(len(column), len(lines), name)
        cells = [line[place] for line in lines]
        for cell, value in zip(cells, column):
            if column.dtype.kind == "O":
                test.assertEqual(value, cell, name)
            elif cell == "":
                test.assertTrue(column.dtype.kind == "f" and math.isnan(value), (name, value))
            elif cell in ("true", "false"):
                test.assertEqual(value, cell == "true", name)
            else:
                test.assertEqual(value, float(cell), name)
        if all(cell.lstrip("-").isdigit() for cell in cells):
            test.assertEqual(column.dtype, "int64", name)
        if all(cell in ("true", "false") for cell in cells):
            test.assertEqual(column.dtype, "bool", name)
    return columns
