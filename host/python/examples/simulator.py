#!/usr/bin/env python3
"""A simulator of one's own as the machine: `gantry-tau serve --plant socket:127.0.0.1:7020 --pace lockstep`.

    simulator.py [--port 7020] [--force 100]   # in one terminal
    gantry-tau serve --plant socket:127.0.0.1:7020 --pace lockstep
    gantry-tau client

Its drives are where their references are. Press Enter to pull the tool along x, and again to let go.
"""
import argparse
import json
import socket
import sys
import threading


class Machine:
    """Three or six axes at home. Every call returns the fields of its answer."""

    def __init__(self, pull_n):
        self.axes = None
        self.ticks = 0
        self.pull_n = pull_n
        self.force_n = 0.0

    def start(self, home_mm, **_):
        if self.axes is None:  # a server that comes back finds the machine as it left it
            still = [0] * len(home_mm)
            self.axes = {"nominal_mm": home_mm, "offset_um": still, "velocity_mm_s": still, "torque_permille": still}
            self.home_mm = self.actual_mm = home_mm
        return {}

    def in_force(self):
        return {"axes": self.axes}

    def read(self, elapsed):
        self.ticks += elapsed
        tool = {"force_n": [self.force_n, 0, 0], "moment_nm": [0, 0, 0]}
        return {"nominal_mm": self.home_mm, "actual_mm": self.actual_mm, "tool": tool}

    def write(self, motors, axes):
        self.axes = axes
        self.actual_mm = [nominal + offset / 1e3 for nominal, offset in zip(axes["nominal_mm"], axes["offset_um"])]
        if self.ticks % 1000 == 0:
            print(f"{self.ticks / 1000:.0f} s: force {self.force_n} N, offsets {axes['offset_um']} um", flush=True)
        return {}

    def reset(self):
        return {}

    def pull(self):
        self.force_n = self.pull_n - self.force_n


def answer_calls(server, machine):
    """Answers one server until it leaves."""
    connection, _ = server.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    with connection.makefile("rw") as lines:
        for line in lines:
            call = json.loads(line)
            number, name = call.pop("n"), call.pop("call")
            answer = getattr(machine, name)(**call)
            print(json.dumps({"n": number} | answer), file=lines, flush=True)


def serve(machine, port):
    """Waits for servers, one after the other. Enter pulls, or lets go."""

    def read_keys():
        for _ in sys.stdin:
            machine.pull()

    threading.Thread(target=read_keys, daemon=True).start()
    with socket.create_server(("127.0.0.1", port)) as server:
        print(f"waiting for a server at 127.0.0.1:{server.getsockname()[1]}", flush=True)
        try:
            while True:
                answer_calls(server, machine)
        except KeyboardInterrupt:
            pass


def options(description):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--port", type=int, default=7020, help="0 for any that is free; default %(default)s")
    parser.add_argument("--force", type=float, default=100.0, help="N along x; default %(default)s")
    return parser


if __name__ == "__main__":
    given = options(__doc__.splitlines()[0]).parse_args()
    serve(Machine(given.force), given.port)
