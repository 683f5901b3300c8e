"""MuJoCo as the peer of `gantry-tau solve`.

    of_mujoco.py PROGRAM ROBOT.toml

Twice. *Matrices*: the middle of each rod is a body of its own, MuJoCo has mass matrix, Jacobians and forces at rates, numpy solves for
motion and constraints together. *Soft*: each rod turns about its joint on the cart and stretches, a joint's equality holds its middle,
MuJoCo's constraints hold its end on the platform, and its force sensor reads between platform and tool; at rest, since constraints of
MuJoCo know no centripetal accelerations.
"""

import sys

import mujoco
import numpy as np

from machine import ARM, GRAVITY, Machine, Worst


# Inertia of a rod about itself, kg m^2: it may spin.
SPIN = 1e-9
# As hard as MuJoCo makes a constraint.
HARD = 'solimp="0.9999 0.9999 0.001" solref="1e-4 1"'


def numbers(values):
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def tensor(matrix):
    return numbers([matrix[0, 0], matrix[1, 1], matrix[2, 2], matrix[0, 1], matrix[0, 2], matrix[1, 2]])


def inertial(body):
    return f'<inertial pos="{numbers(body.centre)}" mass="{body.mass:.17g}" fullinertia="{tensor(body.inertia)}"/>'


def point(name, mass, place):
    """A point mass: MuJoCo wants some inertia."""
    return f'<body name="{name}" pos="{numbers(place)}"><inertial pos="0 0 0" mass="{mass:.17g}" diaginertia="1e-12 1e-12 1e-12"/></body>'


def starts(machine):
    """What hangs on each arm's cart or plate: the ends of its rods."""
    hung = ["", "", ""]
    for link, mass in enumerate(machine.rods):
        hung[ARM[link]] += point(f"start{link}", mass / 6, machine.levers[link])
    return hung


def stretching(machine):
    """The same, and the rest of the rods on them, along z in MuJoCo's first configuration."""
    hung = ["", "", ""]
    for link, mass in enumerate(machine.rods):
        length = machine.lengths[link]
        parts = "".join(
            f'<body name="{name}{link}" pos="0 0 {share * length:.17g}"><joint name="{name}{link}" type="slide" axis="0 0 1"/>'
            f'<inertial pos="0 0 0" mass="{sixths * mass / 6:.17g}" diaginertia="{SPIN} {SPIN} {SPIN}"/><site name="{name}{link}"/></body>'
            for name, share, sixths in (("half", 0.5, 4), ("whole", 1.0, 1))
        )
        hung[ARM[link]] += (
            f'<body name="start{link}" pos="{numbers(machine.levers[link])}"><joint name="turn{link}" type="ball"/>'
            f'<inertial pos="0 0 0" mass="{mass / 6:.17g}" diaginertia="{SPIN} {SPIN} {SPIN}"/>{parts}</body>'
        )
    return hung


def carts(machine, hung):
    text = ""
    for arm in range(3):
        bearer = hung[arm]
        if machine.is_six and arm == 1:
            bearer = plate(machine, 3, machine.signs[0] * machine.turn_axis, bearer)
        if machine.is_six and arm == 2:
            tilted = plate(machine, 5, machine.tilt_axis, bearer)
            bearer = plate(machine, 4, machine.signs[1] * machine.turn_axis, tilted)
        text += (
            f'<body pos="{numbers(machine.carts[arm])}"><joint name="axis{arm}" type="slide" axis="{numbers(machine.guideways[arm])}"/>'
            f'<inertial pos="0 0 0" mass="{machine.cart_kg[arm]:.17g}" diaginertia="1e-6 1e-6 1e-6"/>{bearer}</body>'
        )
    return text


def plate(machine, axis, about, inner):
    inertia = machine.plates[axis - 3]
    return (
        f'<body><joint name="axis{axis}" type="hinge" axis="{numbers(about)}" armature="{inertia:.17g}"/>'
        f'<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>{inner}</body>'
    )


def platform(machine, ends):
    return (
        f'<body name="platform"><freejoint name="platform"/>{inertial(machine.platform)}{ends}'
        f'<body name="tool">{inertial(machine.tool)}<site name="tool"/></body></body>'
    )


def world(bodies, rest=""):
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="0 0 -{GRAVITY}" timestep="1e-5" tolerance="0" iterations="1000" solver="Newton" cone="elliptic"/>'
        f"<worldbody>{bodies}</worldbody>{rest}</mujoco>"
    )


def quaternion(rotation):
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, rotation.ravel())
    return found


class Matrices:
    def __init__(self, machine):
        self.machine = machine
        middles = "".join(
            f'<body name="middle{link}">'
            + "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
            + f'<inertial pos="0 0 0" mass="{4 * mass / 6:.17g}" diaginertia="1e-12 1e-12 1e-12"/></body>'
            for link, mass in enumerate(machine.rods)
        )
        ends = "".join(point(f"end{link}", mass / 6, machine.ends[link]) for link, mass in enumerate(machine.rods))
        self.model = world(carts(machine, starts(machine)) + platform(machine, ends) + middles)
        self.data = mujoco.MjData(self.model)

    def jacobian(self, name):
        model, data = self.model, self.data
        body = model.body(name).id
        rows, drift = np.zeros((3, model.nv)), np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, rows, None, data.xpos[body], body)
        mujoco.mj_jacDot(model, data, drift, None, data.xpos[body], body)
        return rows, drift @ data.qvel

    def motion(self, state):
        machine, model, data = self.machine, self.model, self.data
        for axis in range(machine.axes):
            data.joint(f"axis{axis}").qpos[:] = state.axes[axis]
        data.joint("platform").qpos[:] = np.concatenate([state.tcp, quaternion(state.rotation)])
        mujoco.mj_kinematics(model, data)
        for link in range(6):
            at = model.jnt_qposadr[model.body(f"middle{link}").jntadr[0]]
            data.qpos[at : at + 3] = (data.body(f"start{link}").xpos + data.body(f"end{link}").xpos) / 2
        data.qvel[:] = 0
        mujoco.mj_forward(model, data)
        full = self.expansion(state)
        data.qvel[:] = full @ state.nu
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        forces = -data.qfrc_bias.copy()
        rows, drifts, tensions = [], [], np.zeros(6)
        for link in range(6):
            (start, of_start), (end, of_end), (middle, of_middle) = (self.jacobian(f"{name}{link}") for name in ("start", "end", "middle"))
            along = data.body(f"end{link}").xpos - data.body(f"start{link}").xpos
            length = np.linalg.norm(along)
            tensions[link] = (length - machine.lengths[link]) / machine.c_link[link]
            forces += (start - end).T @ (along / length * tensions[link])
            rows.append(middle - (start + end) / 2)
            drifts.append(of_middle - (of_start + of_end) / 2)
        for axis in range(machine.axes):
            at = model.joint(f"axis{axis}").dofadr[0]
            forces[at] -= (state.axes[axis] - state.drives[axis]) / machine.c_axis[axis]
        at = model.joint("platform").dofadr[0]
        forces[at : at + 3] += state.wrench[:3]
        forces[at + 3 : at + 6] += state.rotation.T @ state.wrench[3:]
        rows, none = np.vstack(rows), np.zeros((18, 18))
        solved = np.linalg.solve(np.block([[mass, rows.T], [rows, none]]), np.concatenate([forces, -np.concatenate(drifts)]))
        return {
            "mass_matrix": full.T @ mass @ full,
            "accelerations": np.concatenate(
                [
                    solved[at : at + 3],
                    state.rotation @ solved[at + 3 : at + 6],
                    [solved[model.joint(f"axis{axis}").dofadr[0]] for axis in range(machine.axes)],
                ]
            ),
            "link_tensions": tensions,
        }

    def expansion(self, state):
        """All velocities by nu: of a free body MuJoCo turns in its own axes."""
        model = self.model
        full = np.zeros((model.nv, 6 + self.machine.axes))
        for axis in range(self.machine.axes):
            full[model.joint(f"axis{axis}").dofadr[0], 6 + axis] = 1
        at = model.joint("platform").dofadr[0]
        full[at : at + 3, :3] = np.eye(3)
        full[at + 3 : at + 6, 3:6] = state.rotation.T
        for link in range(6):
            at = model.body(f"middle{link}").dofadr[0]
            full[at : at + 3] = (self.jacobian(f"start{link}")[0] + self.jacobian(f"end{link}")[0]) @ full / 2
        return full


class Soft:
    def __init__(self, machine):
        self.machine = machine
        ends = "".join(f'<site name="end{link}" pos="{numbers(machine.ends[link])}"/>' for link in range(6))
        held = "".join(
            f'<connect site1="whole{link}" site2="end{link}" {HARD}/>'
            f'<joint joint1="half{link}" joint2="whole{link}" polycoef="0 0.5 0 0 0" {HARD}/>'
            for link in range(6)
        )
        sensors = '<sensor><force name="force" site="tool"/><torque name="torque" site="tool"/></sensor>'
        bodies = carts(machine, stretching(machine)) + platform(machine, ends)
        self.model = world(bodies, f"<equality>{held}</equality>{sensors}")
        self.data = mujoco.MjData(self.model)

    def motion(self, state):
        machine, model, data = self.machine, self.model, self.data
        mujoco.mj_resetData(model, data)
        data.joint("platform").qpos[:] = np.concatenate([state.tcp, quaternion(state.rotation)])
        for axis in range(machine.axes):
            joint = data.joint(f"axis{axis}")
            joint.qpos[:] = state.axes[axis]
            joint.qfrc_applied[:] = (state.drives[axis] - state.axes[axis]) / machine.c_axis[axis]
        mujoco.mj_kinematics(model, data)
        for link in range(6):
            start = data.body(f"start{link}")
            along = data.site(f"end{link}").xpos - start.xpos
            stretch = np.linalg.norm(along) - machine.lengths[link]
            bearer = data.xmat[model.body(f"start{link}").parentid[0]].reshape(3, 3)
            turned = np.zeros(4)
            mujoco.mju_quatZ2Vec(turned, bearer.T @ along)
            data.joint(f"turn{link}").qpos[:] = turned
            data.joint(f"half{link}").qpos[:] = stretch / 2
            data.joint(f"whole{link}").qpos[:] = stretch
            data.joint(f"whole{link}").qfrc_applied[:] = -stretch / machine.c_link[link]
        centre = state.rotation @ machine.tool.centre
        force, moment = state.wrench[:3], state.wrench[3:]
        data.body("tool").xfrc_applied[:] = np.concatenate([force, moment - np.cross(centre, force)])
        mujoco.mj_forward(model, data)
        weight = np.array([0, 0, -GRAVITY * machine.tool.mass])
        found = [data.sensor(name).data for name in ("force", "torque")]
        # MuJoCo's is of the platform on the tool.
        force, moment = (-state.rotation @ shown for shown in found)
        rates = data.joint("platform").qacc
        return {
            "accelerations": np.concatenate(
                [rates[:3], state.rotation @ rates[3:], [data.joint(f"axis{axis}").qacc[0] for axis in range(machine.axes)]]
            ),
            "sensor_load": np.concatenate([force - weight, moment - np.cross(centre, weight)]),
        }


def compare(machine, peer, states, title, limit):
    worst = Worst()
    for state, answer in zip(states, machine.motions(states)):
        for name, expected in peer.motion(state).items():
            worst.see(name, answer[name], expected)
    worst.judge(f"MuJoCo, {title}, {machine.path}", dict.fromkeys(worst.found, limit))


def main(program, robot):
    machine, random = Machine(program, robot), np.random.default_rng(41)
    compare(machine, Matrices(machine), machine.states(25, random), "matrices", 1e-5)
    compare(machine, Soft(machine), machine.states(25, random, at_rest=True), "soft constraints", 1e-3)


if __name__ == "__main__":
    main(*sys.argv[1:])
