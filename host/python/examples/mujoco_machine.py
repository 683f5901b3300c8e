#!/usr/bin/env python3
"""A machine with masses in MuJoCo as the machine of a server (`pip install mujoco`).

    gantry-tau export --robot l2 --mjcf machine.xml
    mujoco_machine.py machine.xml                   # in one terminal
    gantry-tau serve --plant socket:127.0.0.1:7020 --pace lockstep
    gantry-tau client

Its drives are where their references are; springs, links and platform swing. Press Enter to pull the tool along x, and again to let go.
"""
import mujoco
import numpy as np

import simulator

# The tool hangs still below this speed, m/s; at the start its weight sets it in motion. It swings for at most so long, s.
REST, LONGEST = 1e-5, 20.0


class Machine(simulator.Machine):
    """Three or six axes that stay at home, with masses and springs."""

    def __init__(self, path, pull_n):
        super().__init__(pull_n)
        self.model = mujoco.MjModel.from_xml_path(path)
        self.data = mujoco.MjData(self.model)

    def start(self, home_mm, cycle_us, axis_of_motor, **_):
        is_new = self.axes is None
        super().start(home_mm)
        if is_new:
            if len(home_mm) != self.model.nu:
                raise SystemExit(f"the server's machine has {len(home_mm)} axes, that of the model {self.model.nu}")
            # The control of an actuator is where its drive is, m.
            self.motor_of_axis = [axis_of_motor.index(axis) for axis in range(len(home_mm))]
            self.steps_per_cycle = round(cycle_us * 1e-6 / self.model.opt.timestep)
            mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key("home").id)
            self.data.ctrl[:] = np.array(home_mm) / 1e3
            self.settle()
            self.rest = self.data.site("tool").xpos.copy()
        return {}

    def settle(self):
        self.step(1000)
        while np.linalg.norm(self.data.joint("platform").qvel) > REST and self.data.time < LONGEST:
            self.step(1000)

    def step(self, steps):
        tool, force = self.model.body("tool").id, np.array([self.force_n, 0, 0])
        for _ in range(steps):
            # MuJoCo's acts at the centre of mass.
            lever = self.data.site("tool").xpos - self.data.xipos[tool]
            self.data.xfrc_applied[tool] = np.concatenate([force, np.cross(lever, force)])
            mujoco.mj_step(self.model, self.data)

    def read(self, elapsed):
        self.ticks += elapsed
        self.step(elapsed * self.steps_per_cycle)
        # Its sensor has what the platform does to the tool.
        force, moment = (-self.data.sensor(name).data for name in ("force", "torque"))
        self.moved_um = 1e6 * (self.data.site("tool").xpos - self.rest)
        tool = {
            "force_n": force.tolist(),
            "moment_nm": moment.tolist(),
            "load_force_n": [self.force_n, 0, 0],
            "load_moment_nm": [0, 0, 0],
            "displacement_um": self.moved_um.tolist(),
        }
        return {"nominal_mm": self.home_mm, "actual_mm": (1e3 * self.data.ctrl).tolist(), "tool": tool}

    def write(self, motors, axes):
        self.axes = axes
        self.data.ctrl[:] = [motors["position_mm"][motor] / 1e3 for motor in self.motor_of_axis]
        if self.ticks % 1000 == 0:
            moved = ", ".join(f"{along:.1f}" for along in self.moved_um)
            print(f"{self.ticks / 1000:.0f} s: force {self.force_n} N, offsets {axes['offset_um']} um, tool moved by [{moved}] um", flush=True)
        return {}


if __name__ == "__main__":
    parser = simulator.options(__doc__.splitlines()[0])
    parser.add_argument("model", help="file of `gantry-tau export --mjcf`")
    given = parser.parse_args()
    simulator.serve(Machine(given.model, given.force), given.port)
