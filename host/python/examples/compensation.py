#!/usr/bin/env python3
"""Compensation: offsets that hold the tool where it would be without the measured load, computed by `gantry-tau solve`.

    compensation.py [HOST:PORT] [--robot robots/l2.toml] [--gantry-tau PROGRAM]

For an L2 whose coordinates q are the positions of the carts in metres (`metres_per_q` of 1). Stays in Submit while it tares the sensor.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import gantry_tau
from gantry_tau import Solver
from load import Load


class Compensation:
    def __init__(self, solver):
        self.solver = solver
        self.obtain = False
        self.nominal_nm = None

    def start(self, welcome):
        self.load = Load(welcome.cycle_us)

    def step(self, state, wrench):
        load = self.load.update(wrench)
        if load is None:
            return [0] * len(state.nominal_nm)
        self.obtain = True
        if state.nominal_nm != self.nominal_nm:
            self.nominal_nm = state.nominal_nm
            self.q = [nm * 1e-9 for nm in state.nominal_nm]
            self.tool = self.solver.ask("fk", q=self.q)["T"]
        loaded = self.solver.ask("compensate", T=self.tool, w=load)["q"]
        return [(there - here) * 1e9 for there, here in zip(loaded, self.q)]


if __name__ == "__main__":
    parser = gantry_tau.arguments(__doc__)
    parser.add_argument("--robot", default="robots/l2.toml", help="robot file of the machine")
    parser.add_argument("--gantry-tau", metavar="PROGRAM", help="default: gantry-tau of the PATH")
    options = parser.parse_args()
    controller = Compensation(Solver(options.robot, options.gantry_tau))
    # A server in lock-step waits for an answer, and a busy computer may let it wait for more than a second.
    gantry_tau.main(controller, options, needs_wrench=True, patience_s=10.0)
