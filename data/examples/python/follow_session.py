#!/usr/bin/env python3
"""A live session followed while it grows.

    toothprep live --tooth tooth.vdb --bur cylinder:D1.2xL3.0 --device simulated --duration-s 60 -o session.h5 &
    follow_session.py session.h5

The recorder writes every half second. load_trace() reads what is there by then; the audit among the attributes is NaN
until the session is closed. (h5py.File(path, "r", swmr=True) reads the same file, and what the device did beside it.)
"""
import math
import sys
import time
from pathlib import Path

import numpy as np
import toothprep

PATIENCE_S = 10.0  # without a new row


def main():
    """Prints a line for what is new, until the session is closed."""
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    path, rows, last_news, trace = Path(sys.argv[1]), 0, time.monotonic(), None
    while time.monotonic() - last_news < PATIENCE_S:
        try:
            trace = toothprep.load_trace(path)
        except toothprep.Error:  # not there yet, or without a row
            time.sleep(0.2)
            continue
        new = {name: values[rows:] for name, values in trace.items()}
        if len(new["time"]):
            force = np.linalg.norm(new["force/device"], axis=1).max()
            print(f"{len(new['time']):6d} rows more, up to {new['time'][-1]:7.3f} s: force up to {force:.2f} N, "
                  f"removed {trace['removed/volume'][-1].sum():.3f} mm^3", flush=True)
            rows, last_news = len(trace["time"]), time.monotonic()
        if not math.isnan(trace.attributes["torque_work_mJ"]):
            print(f"closed after {rows} rows; energy ratio {trace.attributes['energy_ratio']:.3f}")
            return 0
        time.sleep(0.5)
    print("no news: the session was cut off", file=sys.stderr)
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
