#!/usr/bin/env python3
"""A calibration whose truth is known: u and alpha of enamel and dentin from noisy forces.

A session with other u and alpha than the preset's stands for the rig; a sensor's noise and bias are put on its forces.
Then calibrate() has to find the truth again, from the recording alone. With a rig of your own, begin at `calibrate`.

    calibrate_tissue.py [FOLDER]      (the recording goes there; default: the present one)
"""
import math
import sys
from pathlib import Path

import numpy as np
import toothprep

BUR = "cylinder:D1.2xL3.0"
TRUTH = {"enamel": (0.42, 0.31), "dentin": (0.12, 0.27)}  # u in J/mm^3 at 100 rev/s, alpha
UPRIGHT = (-math.sqrt(0.5), 0, 0, math.sqrt(0.5))  # x, y, z, w: the bur's +z (to the shank) to W's +y


def motion():
    """Slots in different directions, through enamel alone and into the dentin: time, position."""
    corners = [(-1.5, 0.3, -1.5), (-1.5, -0.6, -1.5), (1.5, -0.6, -1.5), (1.5, -0.6, 1.5), (1.5, -1.6, 1.5),
               (-1.0, -1.6, 1.5), (-1.0, -1.6, -0.2)]
    speed, step = 1.5, 1e-3  # mm/s, s
    points = [np.array([corners[0]], float)]
    for a, b in zip(map(np.array, corners), map(np.array, corners[1:])):
        steps = max(1, round(np.linalg.norm(b - a) / speed / step))
        points.append(a + (b - a) * np.arange(1, steps + 1)[:, None] / steps)
    position = np.concatenate(points)
    return np.arange(len(position)) * step, position


def record(tooth, path):
    """What a rig would have written."""
    parameters = {"handpiece": {"stall_torque_mnm": math.inf}, "tissue": {
        name: {"specific_energy_j_per_mm3": u, "force_ratio": alpha} for name, (u, alpha) in TRUTH.items()}}
    time, position = motion()
    session = toothprep.Session(tooth, BUR, parameters, drive="direct", position=position[0], orientation=UPRIGHT)
    trace = session.run(time, position)
    noise = np.random.default_rng(1).normal(0, 0.05, (len(time), 3))  # N
    trace["force/measured"] = trace["force/grinding"] + noise + (0.1, -0.05, 0.2)
    trace.save(path)


def main():
    """Records, fits, compares."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    tooth = toothprep.block(size_mm=6, enamel_mm=1, voxel_mm=0.1)
    record(tooth, folder / "measured.h5")
    fit = toothprep.calibrate(tooth, folder / "measured.h5", BUR, rotation_rate_rev_s=100, bootstrap=200)
    print("tissue    u J/mm^3 (true)            alpha (true)")
    for name, (u, alpha) in TRUTH.items():
        found = fit["tissues"][name]
        print(f"{name}  {found['u_j_per_mm3']:.4f} +- {found['u_std_j_per_mm3']:.4f} ({u})   "
              f"{found['alpha']:.4f} +- {found['alpha_std']:.4f} ({alpha})")
    print(f"bias N: {np.round(fit['bias_n'], 3)}   residual: {fit['residual_rms_n']:.3f} N")
    (folder / "fit.toml").write_text(fit.parameters_toml)  # for Session(..., parameters=...) and replay --params
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
