"""A machine of a robot file, in numbers that no code of gantry-tau has touched but its inverse kinematics."""

import json
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

GRAVITY = 9.80665
# Arm of each link, from 0.
ARM = [0, 1, 1, 2, 2, 2]
LINKS = ["11", "21", "22", "31", "32", "33"]


@dataclass
class Body:
    mass: float
    centre: np.ndarray
    inertia: np.ndarray  # about its centre


@dataclass
class State:
    tcp: np.ndarray
    rotation: np.ndarray
    axes: np.ndarray
    drives: np.ndarray
    nu: np.ndarray
    wrench: np.ndarray


def inertia(key):
    given = np.array(key, float)
    return np.diag(given) if given.ndim == 1 else given


def turn(vector):
    """Rotation by a vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle < 1e-300:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


class Machine:
    def __init__(self, program, path):
        self.program, self.path = program, str(path)
        file = tomllib.loads(Path(path).read_text())
        self.is_six = file["model"] == "f1"
        self.axes = 6 if self.is_six else 3
        self.guideways, self.ends = np.array(file["V"], float), np.array(file["b"], float)
        assert np.allclose(np.linalg.norm(self.guideways, axis=1), 1.0), "guideways of unit length"
        # Joints on carts and plates, from where a cart is at q = 0.
        self.carts = np.array(file.get("C", np.zeros((3, 3))), float)
        self.levers = np.array(file["P" if self.is_six else "A0"], float)
        lengths = np.array(file["L"], float)
        self.lengths = lengths[ARM] if len(lengths) == 3 else lengths
        self.c_link, self.c_axis = np.array(file["c_link"]), np.array(file["c_act" if self.is_six else "c_cart"])
        masses = file["masses"]
        self.travel_m = np.array(file["axes"]["machine_travel_m"], float)
        self.rods, self.cart_kg = np.array(masses["link_kg"]), np.array(masses["cart_kg"])
        self.platform = Body(
            masses["platform_kg"],
            np.array(masses.get("platform_centre_m", [0.0] * 3)),
            inertia(masses["platform_inertia_kgm2"]),
        )
        tool = file["sensor"]["tool"]
        self.tool = Body(
            np.linalg.norm(tool["weight_n"]) / GRAVITY,
            np.array(tool["centre_m"], float),
            inertia(masses["tool_inertia_kgm2"]),
        )
        self.damping = masses.get("damping_ratio", 0.02)
        self.home = np.array(file["simulation"]["home_m"], float)
        self.metres_per_q = np.array(file["axes"]["metres_per_q"], float)
        if self.is_six:
            self.turn_axis, self.tilt_axis = np.array(file["ax"], float), np.array(file["ax6"], float)
            self.signs = file["sigma4"], file["sigma5"]
            self.plates = np.array(masses["plate_inertia_kgm2"])

    def joint(self, link, axes):
        """Joint on a cart or plate, and its slopes (3 x axes)."""
        arm, slopes = ARM[link], np.zeros((3, self.axes))
        slopes[:, arm] = self.guideways[arm]
        lever = self.levers[link]
        if self.is_six and arm > 0:
            about_axes = [(3, self.signs[0] * self.turn_axis)] if arm == 1 else [(5, self.tilt_axis), (4, self.signs[1] * self.turn_axis)]
            for axis, direction in about_axes:
                turned = turn(direction * axes[axis])
                slopes[:, 3:] = turned @ slopes[:, 3:]
                lever = turned @ lever
                slopes[:, axis] = np.cross(direction, lever)
        return self.carts[arm] + self.guideways[arm] * axes[arm] + lever, slopes

    def ask(self, requests):
        """Answers of `gantry-tau solve`."""
        lines = "".join(json.dumps({"robot": self.path, **request}) + "\n" for request in requests)
        ran = subprocess.run([self.program, "solve"], input=lines, capture_output=True, text=True, check=True)
        answers = [json.loads(line) for line in ran.stdout.splitlines()]
        return [answer["ok"] for answer in answers]

    def places(self, count, random):
        """Poses about home with their axes."""
        offsets = random.uniform(-0.12, 0.12, (count, 3))
        turns = random.uniform(-0.05, 0.05, (count, 3)) * self.is_six
        poses = [(self.home + offset, turn(vector)) for offset, vector in zip(offsets, turns)]
        asked = [{"id": 0, "op": "ik", "T": tcp.tolist(), "R": rotation.tolist()} for tcp, rotation in poses]
        return [(*pose, np.array(answer["q"])) for pose, answer in zip(poses, self.ask(asked))]

    def states(self, count, random, at_rest=False):
        """Places where springs are bent, in motion and under a load."""
        return [
            State(
                tcp,
                rotation,
                axes + random.uniform(-1e-5, 1e-5, self.axes),
                axes + random.uniform(-1e-5, 1e-5, self.axes),
                random.uniform(-1, 1, 6 + self.axes) * (not at_rest),
                random.uniform(-1, 1, 6) * ([300.0] * 3 + [30.0] * 3),
            )
            for tcp, rotation, axes in self.places(count, random)
        ]

    def motions(self, states):
        """Answers to the operation `dynamics`."""
        return self.ask(
            {
                "id": 0,
                "op": "dynamics",
                "tcp_m": state.tcp.tolist(),
                "rotation": state.rotation.tolist(),
                "axes": state.axes.tolist(),
                "drives": state.drives.tolist(),
                "nu": state.nu.tolist(),
                "wrench": state.wrench.tolist(),
            }
            for state in states
        )


class Worst:
    """Largest deviations by name: shares of the largest component, or of what is allowed."""

    def __init__(self):
        self.found = {}

    def see(self, name, one, other):
        one, other = np.asarray(one), np.asarray(other)
        share = np.abs(one - other).max() / np.abs(other).max()
        self.found[name] = max(self.found.get(name, 0.0), share)

    def see_within(self, name, one, other, allowed):
        self.found[name] = max(self.found.get(name, 0.0), abs(one - other) / allowed)

    def judge(self, title, limits):
        print(title, {name: f"{share:.1e}" for name, share in self.found.items()})
        beyond = {name: share for name, share in self.found.items() if not share <= limits[name]}
        if beyond:
            sys.exit(f"{title}: beyond {limits}: {beyond}")
