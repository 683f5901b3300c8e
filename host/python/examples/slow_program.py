#!/usr/bin/env python3
"""A controller at 30 Hz behind `gantry-tau pace`: moves the first axis to and fro by 20 micrometres.

    gantry-tau serve --pace lockstep       # in one terminal
    gantry-tau pace                        # in another
    slow_program.py [--port 7010] [--seconds 10]
"""
import argparse
import json
import math
import socket
import sys

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--port", type=int, default=7010)
parser.add_argument("--seconds", type=float, default=10.0, help="of the server's time; default %(default)s")
options = parser.parse_args()

port = socket.create_connection(("127.0.0.1", options.port)).makefile("rw")
begun = None
for number, line in enumerate(port):
    row = json.loads(line)
    if "error" in row:
        print(row["error"], file=sys.stderr)
        continue
    t = row["t"]
    begun = t if begun is None else begun
    if t - begun > options.seconds:
        break
    if number % 3:  # a hundred rows a second
        continue
    print(f"{t:.2f} s, {row['phase']}: offset {row['offset_um'][0]:.1f} um, force {row['force_n']} N")
    offsets = [0.0] * len(row["offset_um"])
    offsets[0] = 20.0 * math.sin(t - begun)
    wanted = {"mode": "obtain", "t": t, "offset_um": offsets}
    print(json.dumps(wanted), file=port, flush=True)
sys.exit("no session" if begun is None else 0)
