"""Pinocchio as the peer of `gantry-tau solve`: mass matrix, accelerations, tensions, the sensor's load.

    of_pinocchio.py PROGRAM ROBOT.toml

A uniform rod moves as three points do: a sixth of its mass at either end, the rest in its middle. The middles are bodies of their own
that constraints hold there; Pinocchio has matrices, Jacobians and accelerations, and numpy solves for motion and constraints together.
"""

import sys

import numpy as np
import pinocchio as pin

from machine import ARM, Machine, Worst

ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def point(mass, at):
    return pin.Inertia(mass, np.asarray(at, float), np.zeros((3, 3)))


def rigid(body):
    return pin.Inertia(body.mass, body.centre, body.inertia)


class Peer:
    def __init__(self, machine):
        self.machine, self.model = machine, pin.Model()
        model = self.model
        self.axis_joints = {}
        bearers = []
        for arm in range(3):
            cart = self.add(0, pin.JointModelPrismaticUnaligned(machine.guideways[arm]), machine.carts[arm], f"cart{arm}")
            self.axis_joints[arm] = cart
            model.appendBodyToJoint(cart, point(machine.cart_kg[arm], np.zeros(3)), pin.SE3.Identity())
            bearer = cart
            if machine.is_six and arm == 1:
                bearer = self.plate(cart, 3, machine.signs[0] * machine.turn_axis)
            if machine.is_six and arm == 2:
                turned = self.plate(cart, 4, machine.signs[1] * machine.turn_axis)
                bearer = self.plate(turned, 5, machine.tilt_axis)
            bearers.append(bearer)
        self.platform = self.add(0, pin.JointModelFreeFlyer(), np.zeros(3), "platform")
        for body in (machine.platform, machine.tool):
            model.appendBodyToJoint(self.platform, rigid(body), pin.SE3.Identity())
        self.starts, self.ends, self.middles = [], [], []
        for link, mass in enumerate(machine.rods):
            for joint, place, frames in (
                (bearers[ARM[link]], machine.levers[link], self.starts),
                (self.platform, machine.ends[link], self.ends),
            ):
                model.appendBodyToJoint(joint, point(mass / 6, place), pin.SE3.Identity())
                frames.append(self.frame(joint, place, f"{len(frames)} on {joint}"))
            middle = self.add(0, pin.JointModelTranslation(), np.zeros(3), f"middle{link}")
            model.appendBodyToJoint(middle, point(4 * mass / 6, np.zeros(3)), pin.SE3.Identity())
            self.middles.append(self.frame(middle, np.zeros(3), f"middle{link}"))
        self.tcp = self.frame(self.platform, np.zeros(3), "tcp")
        model.gravity.linear = np.array([0, 0, -9.80665])
        self.data = model.createData()

    def add(self, parent, joint, place, name):
        return self.model.addJoint(parent, joint, pin.SE3(np.eye(3), np.asarray(place, float)), name)

    def plate(self, parent, axis, about):
        joint = self.add(parent, pin.JointModelRevoluteUnaligned(np.asarray(about, float)), np.zeros(3), f"axis{axis}")
        self.axis_joints[axis] = joint
        armature = self.model.armature.copy()
        armature[self.model.joints[joint].idx_v] = self.machine.plates[axis - 3]
        self.model.armature = armature
        return joint

    def frame(self, joint, place, name):
        frame = pin.Frame(name, joint, 0, pin.SE3(np.eye(3), np.asarray(place, float)), pin.FrameType.OP_FRAME)
        return self.model.addFrame(frame)

    def place(self, state):
        """Configuration and velocity."""
        model, data = self.model, self.data
        q, v = pin.neutral(model), np.zeros(model.nv)
        for axis, joint in self.axis_joints.items():
            q[model.joints[joint].idx_q] = state.axes[axis]
        at = model.joints[self.platform].idx_q
        q[at : at + 7] = pin.SE3ToXYZQUAT(pin.SE3(state.rotation, state.tcp))
        pin.framesForwardKinematics(model, data, q)
        for link in range(6):
            at = model.joints[model.frames[self.middles[link]].parentJoint].idx_q
            ends = data.oMf[self.starts[link]].translation + data.oMf[self.ends[link]].translation
            q[at : at + 3] = ends / 2
        self.q = q
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        self.jacobians = [[self.jacobian(frame) for frame in frames] for frames in (self.starts, self.ends, self.middles)]
        self.full = self.expansion(state)
        return q, self.full @ state.nu

    def jacobian(self, frame):
        return pin.getFrameJacobian(self.model, self.data, frame, ALIGNED)[:3]

    def expansion(self, state):
        """All velocities by nu."""
        full = np.zeros((self.model.nv, 6 + self.machine.axes))
        for axis, joint in self.axis_joints.items():
            full[self.model.joints[joint].idx_v, 6 + axis] = 1
        at = self.model.joints[self.platform].idx_v
        full[at : at + 3, :3] = full[at + 3 : at + 6, 3:6] = state.rotation.T
        for link in range(6):
            at = self.model.joints[self.model.frames[self.middles[link]].parentJoint].idx_v
            full[at : at + 3] = (self.jacobians[0][link] + self.jacobians[1][link]) @ full / 2
        return full

    def motion(self, state):
        machine, model, data = self.machine, self.model, self.data
        q, v = self.place(state)
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        forces = -pin.nonLinearEffects(model, data, q, v)
        starts, ends, middles = self.jacobians
        tensions = np.zeros(6)
        for link in range(6):
            along = data.oMf[self.ends[link]].translation - data.oMf[self.starts[link]].translation
            length = np.linalg.norm(along)
            tensions[link] = (length - machine.lengths[link]) / machine.c_link[link]
            pull = along / length * tensions[link]
            forces += starts[link].T @ pull - ends[link].T @ pull
        for axis, joint in self.axis_joints.items():
            forces[model.joints[joint].idx_v] -= (state.axes[axis] - state.drives[axis]) / machine.c_axis[axis]
        forces += pin.getFrameJacobian(model, data, self.tcp, ALIGNED).T @ state.wrench
        # What constraints of points lack at constant velocities.
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        drift = [
            self.classical(self.middles[link]) - (self.classical(self.starts[link]) + self.classical(self.ends[link])) / 2
            for link in range(6)
        ]
        rows = np.vstack([middle - (start + end) / 2 for start, end, middle in zip(starts, ends, middles)])
        none = np.zeros((18, 18))
        solved = np.linalg.solve(np.block([[mass, rows.T], [rows, none]]), np.concatenate([forces, -np.concatenate(drift)]))
        accelerations = solved[: model.nv]
        pin.forwardKinematics(model, data, q, v, accelerations)
        pin.updateFramePlacements(model, data)
        tcp = pin.getFrameClassicalAcceleration(model, data, self.tcp, ALIGNED)
        rates = [accelerations[model.joints[self.axis_joints[axis]].idx_v] for axis in range(machine.axes)]
        return {
            "mass_matrix": self.full.T @ mass @ self.full,
            "accelerations": np.concatenate([tcp.linear, tcp.angular, rates]),
            "link_tensions": tensions,
            "sensor_load": state.wrench - self.inertia_of_tool(state, tcp),
        }

    def classical(self, frame):
        return pin.getFrameClassicalAcceleration(self.model, self.data, frame, ALIGNED).linear

    def inertia_of_tool(self, state, tcp):
        """Load that moves the tool alone, about the tool centre point, world axes."""
        model = pin.Model()
        joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "tool")
        model.appendBodyToJoint(joint, rigid(self.machine.tool), pin.SE3.Identity())
        model.gravity.linear = np.zeros(3)
        turn = state.rotation
        linear, angular = turn.T @ state.nu[:3], turn.T @ state.nu[3:6]
        # Of a body's frame: the classical acceleration less what turns.
        spatial = turn.T @ tcp.linear - np.cross(angular, linear)
        q = pin.SE3ToXYZQUAT(pin.SE3(turn, state.tcp))
        load = pin.rnea(model, model.createData(), q, np.concatenate([linear, angular]), np.concatenate([spatial, turn.T @ tcp.angular]))
        return np.concatenate([turn @ load[:3], turn @ load[3:]])


def main(program, robot):
    machine = Machine(program, robot)
    peer, worst = Peer(machine), Worst()
    states = machine.states(25, np.random.default_rng(40))
    for state, answer in zip(states, machine.motions(states)):
        for name, expected in peer.motion(state).items():
            worst.see(name, answer[name], expected)
    # Of tensions 1e-16 m / 5e-9 m/N are 2e-8 N, of some 1e3 N.
    worst.judge(f"Pinocchio, {machine.path}", dict.fromkeys(worst.found, 1e-9))


main(*sys.argv[1:])
