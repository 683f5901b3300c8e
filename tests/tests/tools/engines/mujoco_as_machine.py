"""MuJoCo as the machine of a server, by the programs of docs/simulators.md: a client holds the tool under 300 N.

    mujoco_as_machine.py PROGRAM ROBOT.toml

The offsets end where `solve compensate` says, as with the simulated machine of `serve`; the tool moves back by 98 %.
"""

import ast
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from machine import Machine, Worst

FORCE = 300.0
# Longest time for all of it, s.
PATIENCE = 240
# Change of the tool's place in a second once its swing has ended, um.
QUIET = 5.0
EXAMPLE = Path(__file__).resolve().parents[4] / "host/python/examples/mujoco_machine.py"
ROW = re.compile(r"force (\S+) N, offsets (\[.*?\]) um, tool moved by (\[.*?\]) um")


class Programs:
    """Processes in a folder of their own, which end with it."""

    def __init__(self, folder):
        self.folder, self.all = folder, []

    def begin(self, *arguments, said=subprocess.DEVNULL, logged=subprocess.DEVNULL):
        begun = subprocess.Popen(arguments, cwd=self.folder, text=True, stdin=subprocess.PIPE, stdout=said, stderr=logged)
        self.all.append(begun)
        return begun

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for program in reversed(self.all):
            program.kill()
            program.wait()


def find(lines, pattern):
    """The groups of the first line with a pattern."""
    for line in lines:
        print(line, end="")
        if found := re.search(pattern, line):
            return found.groups()
    sys.exit(f"the program ended before it said {pattern!r}")


def rows(lines, force):
    """Offsets and movement of the tool, um, once per second under a force."""
    while True:
        said, offsets, moved = find(lines, ROW)
        if float(said) == force:
            yield np.array(ast.literal_eval(offsets)), np.array(ast.literal_eval(moved))


def held(programs, program, robot):
    """Offsets and movement of the tool, um, once it has swung out."""
    subprocess.run([program, "export", "--robot", robot, "--mjcf", "machine.xml"], cwd=programs.folder, check=True)
    simulator = programs.begin(sys.executable, "-B", EXAMPLE, "machine.xml", "--port", "0", "--force", str(FORCE), said=subprocess.PIPE)
    (address,) = find(simulator.stdout, r"waiting for a server at (\S+)")
    plant = ["--plant", f"socket:{address}", "--pace", "lockstep"]
    own = ["--listen", "127.0.0.1:0", "--epoch-file", "epoch"]
    server = programs.begin(program, "serve", "--robot", robot, *own, *plant, said=subprocess.PIPE)
    (address,) = find(server.stdout, r"listening on ([^;\s]+)")
    client = programs.begin(program, "client", address, "--robot", robot, logged=subprocess.PIPE)
    find(client.stderr, "(obtaining)")
    print(file=simulator.stdin, flush=True)
    last, quiet = np.inf, 0
    for offsets, moved in rows(simulator.stdout, FORCE):
        quiet = quiet + 1 if np.abs(moved - last).max() < QUIET else 0
        last = moved
        if quiet == 2:
            break
    client.send_signal(signal.SIGINT)
    for line in client.stderr:
        print(line, end="")
    if client.wait() != 0:
        sys.exit(f"the client ended with {client.returncode}")
    return offsets, moved


def main(program, robot):
    program, robot = str(Path(program).resolve()), str(Path(robot).resolve())
    machine, worst = Machine(program, robot), Worst()
    signal.signal(signal.SIGALRM, lambda *_: sys.exit(f"not done within {PATIENCE} s"))
    signal.alarm(PATIENCE)
    with tempfile.TemporaryDirectory() as folder, Programs(folder) as programs:
        offsets, moved = held(programs, program, robot)
    load = {"id": 0, "T": machine.home.tolist(), "w": [FORCE, 0, 0, 0, 0, 0]}
    nominal, corrected, given = machine.ask({**load, "op": operation} for operation in ("ik", "compensate", "deflection"))
    expected = 1e6 * (np.array(corrected["q"]) - nominal["q"]) * machine.metres_per_q
    worst.see("offsets", offsets, expected)
    worst.see("tool", np.array(given["dx_total"][:3]) + 1e-6 * moved, given["dx_total"][:3])
    worst.judge(f"held in MuJoCo, {machine.path}", dict.fromkeys(worst.found, 0.02))


if __name__ == "__main__":
    main(*sys.argv[1:])
