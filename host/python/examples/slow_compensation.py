#!/usr/bin/env python3
"""Compensation by a program that pauses: holds the tool under a load, 20 times a second, with numpy.

    gantry-tau serve --pace lockstep --quasi-static    # in one terminal
    slow_compensation.py [HOST:PORT]                   # in another

The pauses of 50 ms stand for whatever a program does besides. For an L2 whose coordinates q are the positions of the carts in metres.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from gantry_tau import Failure, Machine, Session
from load import Load

PAUSE_S = 0.05
TARE_SAMPLES = 40


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("server", nargs="?", default="127.0.0.1:7000", metavar="HOST:PORT", help="address of the server")
    parser.add_argument("--robot", default="l2", help="l2, or the robot file of the machine")
    parser.add_argument("--key", metavar="FILE", help="key file, for a server with keys")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the server's time; default %(default)s")
    options = parser.parse_args()
    with Machine(options.robot) as machine, open_session(options) as session:
        compensate(machine, session, options.seconds)


def open_session(options):
    # A pause of a second holds the offsets, one of ten ends the session.
    return Session(options.server, robot=options.robot, key=options.key, hold_s=1.0, give_up_s=10.0)


def compensate(machine, session, seconds):
    load = Load(PAUSE_S * 1e6, tare_samples=TARE_SAMPLES)
    begun = session.state.t
    for state in session:
        if state.t - begun > seconds:
            return
        wrench = load.update(state.force_n and state.force_n + state.moment_nm)
        offset_um = numpy.zeros(len(state.offset_um))
        if wrench is not None:
            nominal = numpy.array(state.nominal_mm) * 1e-3
            tool, _ = machine.fk(nominal)
            offset_um = (machine.compensate(tool, wrench) - nominal) * 1e6
            print(f"{state.t:.2f} s, {state.phase}: force {numpy.round(wrench[:3], 1)} N, offset {numpy.round(offset_um, 1)} um")
        session.target(offset_um, t=state.t, mode="submit" if wrench is None else "obtain")
        time.sleep(PAUSE_S)


if __name__ == "__main__":
    try:
        main()
    except Failure as failure:
        sys.exit(f"slow_compensation: {failure}")
