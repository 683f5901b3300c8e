"""The model that `gantry-tau export` writes, in MuJoCo.

    of_mjcf.py PROGRAM ROBOT.toml

At poses about home the links have their lengths, and carry what statics says; about home the first modes are those of `solve`, and the
lowest has its damping; under 300 N the tool goes where the springs balance them.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from scipy.linalg import eigh
from scipy.optimize import fsolve

from machine import ARM, GRAVITY, LINKS, Machine, Worst, turn
from of_mujoco import quaternion

# Displacements and turns that the search begins with, m and rad.
SCALE = 1e-4
# Speed of a tool that rests, m/s.
REST = 1e-6


def exported(program, robot):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "machine.xml"
        subprocess.run([program, "export", "--robot", robot, "--mjcf", path], check=True, stdout=subprocess.DEVNULL)
        return mujoco.MjModel.from_xml_path(str(path))


def place(model, data, tcp, rotation, axes):
    """Puts carts, plates and platform somewhere, and turns the links to it."""
    mujoco.mj_resetData(model, data)
    for axis, position in enumerate(axes):
        data.joint(f"axis{axis + 1}").qpos[:] = position
    data.joint("platform").qpos[:] = np.concatenate([tcp, quaternion(rotation)])
    mujoco.mj_kinematics(model, data)
    for link in LINKS:
        start = data.body(f"link{link}")
        along = data.site(f"on_platform{link}").xpos - start.xpos
        bearer = data.xmat[model.body(f"link{link}").parentid[0]].reshape(3, 3)
        # Of a ball joint: behind the orientation that the body has in the model.
        wanted, own = np.zeros(4), np.zeros(4)
        mujoco.mju_quatZ2Vec(wanted, bearer.T @ along)
        mujoco.mju_negQuat(own, model.body(f"link{link}").quat)
        turned = np.zeros(4)
        mujoco.mju_mulQuat(turned, own, wanted)
        data.joint(f"link{link}").qpos[:] = turned
    mujoco.mj_forward(model, data)


def kinematics(machine, model, data, worst):
    random = np.random.default_rng(42)
    places = machine.places(50, random)
    loads = random.uniform(-1, 1, (50, 6)) * ([300.0] * 3 + [30.0] * 3)
    poses = [{"id": 0, "T": tcp.tolist(), "R": rotation.tolist()} for tcp, rotation, _ in places]
    answers = machine.ask({**pose, "op": "statics", "w": load.tolist()} for pose, load in zip(poses, loads))
    for (tcp, rotation, axes), load, answer in zip(places, loads, answers):
        place(model, data, tcp, rotation, axes)
        columns = []
        for link, length in zip(LINKS, machine.lengths):
            end, on_platform = (data.site(f"{name}{link}").xpos for name in ("end", "on_platform"))
            worst.see_within("ends, m", np.abs(end - on_platform).max(), 0, 1)
            along = (on_platform - data.body(f"link{link}").xpos) / length
            columns.append(np.concatenate([along, np.cross(on_platform - tcp, along)]))
        worst.see("link tensions", np.linalg.solve(np.array(columns).T, load), answer["f"])


def modes(machine, model, data, worst):
    """Of the machine about home, as far as its constraints let it move."""
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    stiffness, damping = np.zeros(model.nv), model.dof_damping.copy()
    for joint in range(model.njnt):
        stiffness[model.jnt_dofadr[joint]] += np.ravel(model.jnt_stiffness[joint])[0]
    for actuator in range(model.nu):
        at = model.jnt_dofadr[model.actuator_trnid[actuator, 0]]
        gear = model.actuator_gear[actuator, 0]
        stiffness[at] += model.actuator_gainprm[actuator, 0] * gear**2
        damping[at] -= model.actuator_biasprm[actuator, 2] * gear**2
    _, sizes, basis = np.linalg.svd(data.efc_J.reshape(data.nefc, model.nv))
    free = basis[np.sum(sizes > 1e-9 * sizes[0]) :].T
    mass, stiffness, damping = (free.T @ matrix @ free for matrix in (mass, np.diag(stiffness), np.diag(damping)))
    squares, shapes = eigh(stiffness, mass)
    # The links may spin.
    rates, shapes = np.sqrt(squares[len(LINKS) :]), shapes[:, len(LINKS) :]
    (answer,) = machine.ask([{"id": 0, "op": "modes", "tcp_m": machine.home.tolist()}])
    for rate, expected in zip(rates, answer["first_five_modes_hz"]):
        worst.see("modes", rate / (2 * np.pi), expected)
    worst.see("damping ratio", shapes[:, 0] @ damping @ shapes[:, 0] / (2 * rates[0]), machine.damping)
    parts = machine.rods.sum() + machine.cart_kg.sum() + machine.platform.mass + machine.tool.mass
    worst.see("weight", model.opt.gravity * mujoco.mj_getTotalmass(model), np.array([0, 0, -GRAVITY * parts]))


def equilibrium(machine, axes, force):
    """Displacement of the tool with the drives held, as far as springs balance a force: the roots of all balances."""

    def balances(unknown):
        tool, turned, bent = np.split(unknown * SCALE, [3, 6])
        rotation = turn(turned)
        on_tool, moment, on_axes = force.copy(), np.zeros(3), -bent / machine.c_axis
        for link, arm in enumerate(ARM):
            (start, slopes), lever = machine.joint(link, axes + bent), rotation @ machine.ends[link]
            along = machine.home + tool + lever - start
            length = np.linalg.norm(along)
            pull = (length - machine.lengths[link]) / machine.c_link[link] * along / length
            on_tool -= pull
            moment -= np.cross(lever, pull)
            on_axes += slopes.T @ pull
        return np.concatenate([on_tool, moment, on_axes])

    return fsolve(balances, np.zeros(6 + machine.axes), xtol=1e-10)[:3] * SCALE


def settled(model, data, force):
    """Displacement of the tool under a force, once it rests."""
    tool = model.body("tool").id
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    home, speed = data.site("tool").xpos.copy(), np.inf
    while speed > REST:
        for _ in range(1000):
            lever = data.site("tool").xpos - data.xipos[tool]
            data.xfrc_applied[tool] = np.concatenate([force, np.cross(lever, force)])
            mujoco.mj_step(model, data)
        speed = np.linalg.norm(data.joint("platform").qvel)
    return data.site("tool").xpos - home


def displacement(machine, model, data, worst):
    model.opt.gravity[:] = 0
    # It rests sooner.
    model.dof_damping *= 4
    model.actuator_biasprm[:, 2] *= 4
    (answer,) = machine.ask([{"id": 0, "op": "ik", "T": machine.home.tolist()}])
    force = np.array([200.0, -100.0, 200.0])
    worst.see("displacement", settled(model, data, force), equilibrium(machine, np.array(answer["q"]), force))


def main(program, robot):
    machine = Machine(program, robot)
    model = exported(program, robot)
    data, worst = mujoco.MjData(model), Worst()
    kinematics(machine, model, data, worst)
    modes(machine, model, data, worst)
    displacement(machine, model, data, worst)
    # MuJoCo's constraints give way a little.
    limits = {"ends, m": 1e-9, "link tensions": 1e-6, "modes": 0.01, "damping ratio": 0.01, "weight": 1e-6, "displacement": 1e-3}
    worst.judge(f"exported, {machine.path}", limits)


if __name__ == "__main__":
    main(*sys.argv[1:])
