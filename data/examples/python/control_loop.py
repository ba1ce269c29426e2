#!/usr/bin/env python3
"""A control loop of your own, with a simulated device in the place of yours.

Each millisecond the loop reads the handle's position from the device, makes one step of the session, and gives the force
back to the device. The device here is a mass that a hand moves by a spring and a damper; put your own in its place: it
needs `read()` (a position in mm, W) and `write(force)` (N, W).

    control_loop.py [SECONDS]
"""
import math
import sys

import numpy as np
import toothprep

UPRIGHT = (-math.sqrt(0.5), 0, 0, math.sqrt(0.5))  # x, y, z, w: the bur's +z (to the shank) to W's +y
FORCE_LIMIT_N = 3.0


class SimulatedDevice:
    """A stylus of 50 g that a hand leads along a path by 0.6 N/mm and 0.01 N s/mm."""

    def __init__(self, hand, step_s):
        self.hand, self.step_s = hand, step_s
        self.mass, self.stiffness, self.damping = 50e-6, 0.6, 0.01  # N s^2/mm, N/mm, N s/mm
        self.position, self.velocity, self.time = np.array(hand(0.0)), np.zeros(3), 0.0

    def read(self):
        """Position, mm."""
        return self.position

    def write(self, force):
        """The motors' force, N, until the next call; a step of time goes by."""
        pull = self.stiffness * (self.hand(self.time) - self.position) - self.damping * self.velocity
        self.velocity = self.velocity + (pull + force) / self.mass * self.step_s
        self.position = self.position + self.velocity * self.step_s
        self.time += self.step_s


def hand(time):
    """Where the hand wants to be: down onto the block, then along it."""
    return np.array([max(0.0, time - 1.0) * 0.8, 0.5 - min(time, 1.0) * 0.9, 0.0])


def main():
    """Runs the loop and prints what happened."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
    tooth = toothprep.block(size_mm=8, enamel_mm=2)
    session = toothprep.Session(tooth, "cylinder:D1.2xL3.0", {"coupling": {"stiffness_n_per_mm": 1.0}},
                                position=hand(0.0), orientation=UPRIGHT)
    device = SimulatedDevice(hand, session.time_step_s)
    largest = 0.0
    for tick in range(round(seconds / session.time_step_s)):
        record = session.step(device.read())
        force = record.force_device
        size = np.linalg.norm(force)
        if size > FORCE_LIMIT_N:
            force = force * (FORCE_LIMIT_N / size)
        device.write(force)
        largest = max(largest, size)
        if tick % 500 == 499:
            print(f"{record.time:5.2f} s  bur {np.round(record.bur_position, 2)} mm  force {np.round(force, 2)} N"
                  f"{'  stalled' if record.stalled else ''}")
    session.finish()
    totals = session.totals
    print(f"largest force {largest:.2f} N; removed {sum(totals['removed_mm3'].values()):.3f} mm^3; "
          f"energy ratio {totals['energy_ratio']:.3f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
