"""SciPy as the peer of `gantry-tau solve`: natural frequencies, and loops with drives that are where their references are.

    of_scipy.py PROGRAM ROBOT.toml

Exact motion over a cycle (matrix exponential) where gantry-tau takes sixteen steps; filters of `scipy.signal`; eigenvalues of the whole
loop in one matrix; the margin over a dense grid of frequencies.
"""

import sys

import numpy as np
from scipy import linalg, optimize, signal

from machine import ARM, Machine, Worst, turn

CYCLE_S = 1e-3
FILTERS = ["first_order_20", "first_order_5", "butterworth2_6", "butterworth2_3", "butterworth2_6_notch_1_2_q0.7", "butterworth2_10_notch_1_3_q0.5"]


def skew(vector):
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


class Place:
    """Mass and stiffness about a place, in the coordinates of nu."""

    def __init__(self, machine, tcp, rotation, axes, tool_kg):
        self.size, self.axes = 6 + machine.axes, machine.axes
        self.stiffness = np.zeros((self.size, self.size))
        self.mass = np.zeros((self.size, self.size))
        for arm in range(3):
            self.mass[6 + arm, 6 + arm] += machine.cart_kg[arm]
        if machine.is_six:
            self.mass[9:, 9:] += np.diag(machine.plates)
        for body, kg in ((machine.platform, machine.platform.mass), (machine.tool, tool_kg)):
            self.mass[:6, :6] += about(rotation @ body.centre, kg, rotation @ body.inertia @ rotation.T)
        self.tool = about(rotation @ machine.tool.centre, tool_kg, rotation @ machine.tool.inertia @ rotation.T)
        for link, kg in enumerate(machine.rods):
            start, slopes = machine.joint(link, axes)
            lever = rotation @ machine.ends[link]
            of_start = np.hstack([np.zeros((3, 6)), slopes])
            of_end = np.hstack([np.eye(3), -skew(lever), np.zeros((3, self.axes))])
            along = tcp + lever - start
            stretch = along @ (of_end - of_start) / np.linalg.norm(along)
            self.stiffness += np.outer(stretch, stretch) / machine.c_link[link]
            both = of_start.T @ of_end
            self.mass += kg / 3 * (of_start.T @ of_start + of_end.T @ of_end) + kg / 6 * (both + both.T)
        self.springs = np.diag(1 / machine.c_axis)
        self.stiffness[6:, 6:] += self.springs
        squares, self.shapes = linalg.eigh(self.stiffness, self.mass)
        self.rates = np.sqrt(squares)


def about(centre, kg, inertia):
    """Mass matrix of a body about the tool centre point."""
    across = skew(centre)
    return np.block([[kg * np.eye(3), -kg * across], [kg * across, inertia - kg * across @ across]])


def linear(place, damping):
    """x' = A x + B theta + D theta' of x = (places, rates), and the reading y = H x + E theta, between two cycles: the drives at rest."""
    size, axes = place.size, place.axes
    shapes = place.mass @ place.shapes
    friction = shapes @ np.diag(2 * damping * place.rates) @ shapes.T
    pull = np.vstack([np.zeros((6, axes)), place.springs])
    rigid = linalg.solve(place.stiffness, pull)
    rigid[6:] = np.eye(axes)
    back = linalg.inv(place.mass)
    accelerations = [-back @ place.stiffness, -back @ friction, back @ pull, back @ friction @ rigid]
    none = np.zeros((size, size))
    state = np.block([[none, np.eye(size)], [accelerations[0], accelerations[1]]])
    by_drives, by_rates = (np.vstack([np.zeros((size, axes)), part]) for part in accelerations[2:])
    reading = [-place.tool @ part[:6] for part in accelerations]
    return state, by_drives, by_rates, np.hstack(reading[:2]), reading[2]


def sections(name, hz):
    """Filter as (b, a) by its name."""
    parts = name.split("_notch_")
    if name.startswith("first_order_"):
        share = 2 * np.pi * float(parts[0].removeprefix("first_order_")) * CYCLE_S
        share /= 1 + share
        return [share], [1, share - 1]
    b, a = signal.butter(2, float(parts[0].removeprefix("butterworth2_")), fs=1 / CYCLE_S)
    if len(parts) == 2:
        modes, q = parts[1].split("_q")
        for mode in modes.split("_"):
            # Its frequency is that of the notch after the transformation.
            rate = 2 / CYCLE_S * np.tan(np.pi * hz[int(mode) - 1] * CYCLE_S)
            notch = signal.bilinear([1, 0, rate**2], [1, rate / float(q), rate**2], fs=1 / CYCLE_S)
            b, a = np.convolve(b, notch[0]), np.convolve(a, notch[1])
    return b, a


class Loop:
    def __init__(self, place, damping, name, latency):
        axes = place.axes
        state, by_drives, by_rates, *self.reading = linear(place, damping)
        count = len(state)
        # Over a cycle the drives go from one reference to the next: theta and theta' are states of the exponential.
        whole = np.zeros((count + 2 * axes, count + 2 * axes))
        whole[:count] = np.hstack([state, by_drives, by_rates])
        whole[count : count + axes, count + axes :] = np.eye(axes)
        over = linalg.expm(whole * CYCLE_S)[:count]
        rates = over[:, count + axes :] / CYCLE_S
        self.map, self.previous, self.current = over[:, :count], over[:, count : count + axes] - rates, rates
        compliance = linalg.inv(place.stiffness)
        motion = compliance[:axes, 6:] @ place.springs
        self.correction = -linalg.solve(motion, compliance[:axes, :6])
        self.filter, self.latency = sections(name, place.rates / (2 * np.pi)), latency

    def at(self, z):
        """Loop at e^jw, without the phase of filter and latency."""
        states = np.linalg.solve(z * np.eye(len(self.map)) - self.map, self.current + self.previous / z)
        by_states, by_drives = self.reading
        seen = by_states @ states + by_drives
        gain = np.abs(np.polyval(self.filter[0][::-1], 1 / z) / np.polyval(self.filter[1][::-1], 1 / z))
        return self.correction @ seen * gain

    def radius(self, hz):
        return np.abs(np.linalg.eigvals(self.at(np.exp(2j * np.pi * hz * CYCLE_S)))).max()

    def gain(self, rates):
        """Largest spectral radius over all frequencies."""
        about_modes = (rate / (2 * np.pi) * np.linspace(0.9, 1.1, 31) for rate in rates)
        hz = np.sort(np.concatenate([np.geomspace(0.2, 490, 300), *about_modes]))
        hz = hz[hz < 490]
        best = np.clip(np.argmax([self.radius(one) for one in hz]), 1, len(hz) - 2)
        peak = optimize.minimize_scalar(lambda one: -self.radius(one), bounds=(hz[best - 1], hz[best + 1]), method="bounded")
        return -peak.fun

    def growth(self):
        """Largest growth of the closed loop, 1/s: filter and references of the past are states."""
        axes, count = self.correction.shape[0], len(self.map)
        b, a = self.filter
        inner, into, out, direct = signal.tf2ss(np.pad(b, (0, len(a) - len(b))), a)
        order = len(inner)
        # From the one that this cycle's reading asks for to the one where the drives are.
        queue = self.latency + 2
        total = count + axes * order + axes * queue
        machine, filters, asked = slice(0, count), slice(count, total - axes * queue), slice(total - axes * queue, total - axes * (queue - 1))
        current, previous = slice(total - 2 * axes, total - axes), slice(total - axes, total)
        closed = np.zeros((total, total))
        closed[machine, machine], closed[machine, current], closed[machine, previous] = self.map, self.current, self.previous
        by_states, by_drives = self.reading
        seen = by_states @ closed[machine]
        seen[:, current] += by_drives
        correction = self.correction @ seen
        closed[filters, filters] = np.kron(np.eye(axes), inner)
        closed[filters] += np.kron(np.eye(axes), into) @ correction
        closed[asked, filters] = np.kron(np.eye(axes), out)
        closed[asked] += direct[0, 0] * correction
        closed[asked.stop :, asked.start : previous.start] = np.eye(axes * (queue - 1))
        return np.log(np.abs(np.linalg.eigvals(closed)).max()) / CYCLE_S


def main(program, robot):
    machine, random, worst = Machine(program, robot), np.random.default_rng(42), Worst()
    places = machine.places(18, random)
    tools = random.uniform(0.5, 8, len(places))
    asked = [
        {"id": 0, "tcp_m": tcp.tolist(), "rotation": rotation.tolist(), "axes": axes.tolist(), "tool_kg": kg}
        for (tcp, rotation, axes), kg in zip(places, tools)
    ]
    loops = [
        {
            "op": "loop",
            "drives": "ideal",
            "filter": FILTERS[number % len(FILTERS)],
            "latency_cycles": 1 + number % 6,
            "damping_ratio": random.uniform(0.005, 0.05),
        }
        for number in range(len(places))
    ]
    modes = machine.ask({**place, "op": "modes"} for place in asked)
    closed = machine.ask({**place, **loop} for place, loop in zip(asked, loops))
    for (tcp, rotation, axes), kg, of_modes, loop, of_loop in zip(places, tools, modes, loops, closed):
        place = Place(machine, tcp, rotation, axes, kg)
        worst.see("modes", of_modes["first_five_modes_hz"], place.rates[:5] / (2 * np.pi))
        peer = Loop(place, loop["damping_ratio"], loop["filter"], loop["latency_cycles"])
        growth, gain = peer.growth(), peer.gain(place.rates)
        # Sixteen steps instead of an exponential, and a grid of frequencies, 3 % apart where there is no mode.
        worst.see_within("growth", of_loop["closed_loop_growth_per_s"], growth, 0.02 + 0.01 * abs(growth))
        worst.see_within("margin", 1 / of_loop["any_phase_margin"], gain, 0.02 * gain + 0.001)
    worst.judge(f"SciPy, {machine.path}", {"modes": 1e-9, "growth": 1.0, "margin": 1.0})


main(*sys.argv[1:])
