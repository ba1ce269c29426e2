#!/usr/bin/env python3
"""Force against feed, with the closed form beside it.

A cylinder mills a slot of a known depth into enamel at several feeds. For a full slot the law gives, with the specific
energy u, the rotation rate N, alpha = F_t / F_n and the depth d,
    force across the feed  u v d / (4 N)
    force against the feed u v d / (4 N alpha)
so the force grows in proportion to the feed v, and doesn't depend on the diameter.

    force_against_feed.py [--plot FILE.png]
"""
import argparse
import math

import numpy as np
import toothprep

DEPTH_MM = 1.0
FEEDS_MM_S = (0.1, 0.2, 0.4, 0.8)
UPRIGHT = (-math.sqrt(0.5), 0, 0, math.sqrt(0.5))  # x, y, z, w: the bur's +z (to the shank) to W's +y


def slot_force(tooth, feed_mm_s):
    """Mean of |force|, N, over the last part of a slot that begins within the block."""
    time = np.arange(0, 1.5, 1e-3)
    position = np.stack([feed_mm_s * time, np.full_like(time, -DEPTH_MM), np.zeros_like(time)], axis=1)
    # The bur starts inside the block: the tissue there is removed first, and from then on the slot is full.
    session = toothprep.Session(tooth, "cylinder:D1.2xL3.0", {"handpiece": {"stall_torque_mnm": math.inf}},
                                drive="direct", position=position[0], orientation=UPRIGHT)
    force = session.run(time, position)["force/grinding"]
    return np.linalg.norm(force[len(force) // 2:], axis=1).mean()


def main():
    """Prints the table; draws it, if asked."""
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--plot", metavar="FILE")
    plot = arguments.parse_args().plot

    enamel = toothprep.parameters("paper")["tissue"]["enamel"]
    rate = toothprep.parameters("paper")["handpiece"]["rotation_rate_rev_s"]
    u, alpha = 1e3 * enamel["specific_energy_j_per_mm3"], enamel["force_ratio"]  # N/mm^2
    tooth = toothprep.block(size_mm=8, enamel_mm=2, voxel_mm=0.1)
    measured, exact = [], []
    print("feed mm/s   force N   closed form N   ratio")
    for feed in FEEDS_MM_S:
        measured.append(slot_force(tooth, feed))
        exact.append(u * feed * DEPTH_MM / (4 * rate) * math.hypot(1, 1 / alpha))
        print(f"{feed:9.2f} {measured[-1]:9.4f} {exact[-1]:15.4f} {measured[-1] / exact[-1]:7.4f}")
    if plot:
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot
        pyplot.plot(FEEDS_MM_S, exact, label="closed form")
        pyplot.plot(FEEDS_MM_S, measured, "o", label="session")
        pyplot.xlabel("feed, mm/s")
        pyplot.ylabel("force, N")
        pyplot.legend()
        pyplot.savefig(plot)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
