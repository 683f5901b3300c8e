"""The description that `gantry-tau export --urdf` writes, in Pinocchio.

    of_urdf.py PROGRAM ROBOT.toml

At home every link ends at its joint on the platform; an axis moves the joints on its cart and plate as the robot file says.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pinocchio

from machine import LINKS, Machine, Worst


def described(program, robot):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "machine.urdf"
        subprocess.run([program, "export", "--robot", robot, "--urdf", path], check=True, stdout=subprocess.DEVNULL)
        return pinocchio.buildModelFromUrdf(str(path))


def frames(model, positions):
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, positions)
    return {frame.name: place for frame, place in zip(model.frames, data.oMf)}


def main(program, robot):
    machine, worst = Machine(program, robot), Worst()
    model = described(program, robot)
    (answer,) = machine.ask([{"id": 0, "op": "ik", "T": machine.home.tolist()}])
    home, at_home = np.array(answer["q"]), frames(model, np.zeros(machine.axes))
    worst.see("platform", at_home["platform"].translation, machine.home)
    for link, (name, length) in enumerate(zip(LINKS, machine.lengths)):
        end = at_home[f"link{name}"].act(np.array([0, 0, length]))
        worst.see("ends of links", end, machine.home + machine.ends[link])
    for axis in range(machine.axes):
        at, positions = model.joints[model.getJointId(f"axis{axis + 1}")].idx_q, np.zeros(machine.axes)
        positions[at] = 0.01
        travel = machine.travel_m[axis] / machine.metres_per_q[axis] - home[axis]
        worst.see("travel", [model.lowerPositionLimit[at], model.upperPositionLimit[at]], travel)
        moved, axes = frames(model, positions), home.copy()
        axes[axis] += 0.01
        for link, name in enumerate(LINKS):
            worst.see("joints of links", moved[f"link{name}"].translation, machine.joint(link, axes)[0])
    worst.judge(f"described, {machine.path}", dict.fromkeys(worst.found, 1e-9))


if __name__ == "__main__":
    main(*sys.argv[1:])
