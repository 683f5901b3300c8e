#!/usr/bin/env python3
"""Constant offset: moves every axis by so many micrometres, given in the order of the axes, and holds it until Ctrl-C.

    constant_offset.py [HOST:PORT] [--offset-um 10,-5,0]
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import gantry_tau


class ConstantOffset:
    def __init__(self, offset_um):
        self.offset_nm = [1e3 * offset for offset in offset_um]

    def step(self, state, wrench):
        # The server approaches the target from zero as fast as its limits allow: no ramp is needed here.
        return self.offset_nm


if __name__ == "__main__":
    parser = gantry_tau.arguments(__doc__)
    parser.add_argument("--offset-um", default="10,-5,0", help="offset of each axis, um")
    options = parser.parse_args()
    gantry_tau.main(ConstantOffset([float(offset) for offset in options.offset_um.split(",")]), options)
