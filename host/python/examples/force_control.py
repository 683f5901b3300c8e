#!/usr/bin/env python3
"""Force control: presses the tool on a workpiece below it, with a PI law and anti-windup.

    force_control.py [HOST:PORT] [--forces 30,60] [--each 4000] [--robot robots/l2.toml] [--gantry-tau PROGRAM]

Against `gantry-tau serve --workpiece 2e5`. The law sets how far the tool moves in -z, m; `gantry-tau solve` says by how much each axis
moves for it. For an L2, as compensation.py. Stays in Submit while it tares the sensor.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import gantry_tau
from gantry_tau import Solver
from load import Load

# Direction of the press, world axes.
DIRECTION = (0.0, 0.0, -1.0)
# Farthest that the tool presses, m: the anti-windup holds the integral where the command is cut.
REACH_M = 500e-6
# Gains for the stiffness of workpiece and machine in series up to some 1e6 N/m, m/N and m/(N s).
PROPORTIONAL, INTEGRAL = 2e-7, 6e-5


class PI:
    """PI law with the output cut to 0..reach; anti-windup by conditional integration."""

    def __init__(self, proportional, integral, reach, cycle_s):
        self.proportional, self.step, self.reach = proportional, integral * cycle_s, reach
        self.integral = 0.0

    def output(self, error):
        wanted = self.proportional * error + self.integral
        cut = max(0.0, min(self.reach, wanted))
        # Where the output is cut, the integral only goes back: otherwise it would grow for as long as the end is held.
        if wanted == cut or (wanted > cut) == (error < 0.0):
            self.integral += self.step * error
        return cut


class ForceControl:
    def __init__(self, solver, forces_n, each):
        self.solver, self.forces_n, self.each = solver, forces_n, each
        self.obtain = False
        self.since = None

    def start(self, welcome):
        self.load = Load(welcome.cycle_us)
        self.law = PI(PROPORTIONAL, INTEGRAL, REACH_M, welcome.cycle_us * 1e-6)

    def step(self, state, wrench):
        load = self.load.update(wrench)
        if load is None:
            return [0] * len(state.nominal_nm)
        if self.since is None:
            self.since = state.tick
            self.obtain = True
            self.nm_per_m = self.axes_per_metre([nm * 1e-9 for nm in state.nominal_nm])
        wanted_n = self.forces_n[min((state.tick - self.since) // self.each, len(self.forces_n) - 1)]
        # The workpiece pushes against the direction of the press.
        pressed_n = -sum(force * along for force, along in zip(load, DIRECTION))
        # Until the server has taken the command that asks for Obtain, nothing moves, and nothing may be integrated.
        depth_m = self.law.output(wanted_n - pressed_n) if state.phase == "Obtain" else 0.0
        return [scale * depth_m for scale in self.nm_per_m]

    def axes_per_metre(self, q):
        """Movement of each axis for one metre of the tool in the direction of the press, nm, by differences over 0.2 mm."""
        tool, half = self.solver.ask("fk", q=q)["T"], 1e-4
        near, far = (self.solver.ask("ik", T=[t + way * along for t, along in zip(tool, DIRECTION)])["q"] for way in (-half, half))
        return [(there - here) / (2.0 * half) * 1e9 for there, here in zip(far, near)]


if __name__ == "__main__":
    parser = gantry_tau.arguments(__doc__)
    parser.add_argument("--forces", default="30,60", help="set points, N, one after the other; the last one stays")
    parser.add_argument("--each", type=int, default=4_000, help="ticks of each set point")
    parser.add_argument("--robot", default="robots/l2.toml", help="robot file of the machine")
    parser.add_argument("--gantry-tau", metavar="PROGRAM", help="default: gantry-tau of the PATH")
    options = parser.parse_args()
    forces_n = [float(force) for force in options.forces.split(",")]
    controller = ForceControl(Solver(options.robot, options.gantry_tau), forces_n, options.each)
    # A server in lock-step waits for an answer, and a busy computer may let it wait for more than a second.
    gantry_tau.main(controller, options, needs_wrench=True, patience_s=10.0)
