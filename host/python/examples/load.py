"""The load on the tool from the force sensor."""

import math

# Samples of the tare, one per State: keep the tool unloaded meanwhile.
TARE_SAMPLES = 1_000
# Corner of the low-pass filter, Hz.
CUTOFF_HZ = 20.0
# `[sensor]` of robots/l2.toml: the sensor's axes in those of the platform, by rows, and its origin from the tool centre point, m.
L2_ROTATION = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
L2_LEVER_M = (0.0, 0.0, -0.08)


class Load:
    """Load on the tool from raw samples: tare, low-pass filter, axes of the world, moment about the tool centre point.

    The weight of the tool becomes part of the tare; the platform is taken as unturned.
    """

    def __init__(self, cycle_us, rotation=L2_ROTATION, lever_m=L2_LEVER_M, tare_samples=TARE_SAMPLES):
        self.rotation, self.lever_m, self.tare_samples = rotation, lever_m, tare_samples
        self.share = 1.0 - math.exp(-2.0 * math.pi * CUTOFF_HZ * cycle_us * 1e-6)
        self.samples, self.sum, self.filtered = 0, [0.0] * 6, [0.0] * 6

    def update(self, raw):
        """Takes the sample of a cycle; returns force (N) and moment (N m), or None while it tares."""
        if raw is None:
            return None
        if self.samples < self.tare_samples:
            self.samples += 1
            self.sum = [total + value for total, value in zip(self.sum, raw)]
            return None
        unloaded = (total / self.tare_samples for total in self.sum)
        load = [value - zero for value, zero in zip(raw, unloaded)]
        self.filtered = [old + self.share * (new - old) for old, new in zip(self.filtered, load)]
        force, moment = self._turned(self.filtered[:3]), self._turned(self.filtered[3:])
        return force + [m + about for m, about in zip(moment, _cross(self.lever_m, force))]

    def _turned(self, vector):
        return [sum(r * v for r, v in zip(row, vector)) for row in self.rotation]


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
