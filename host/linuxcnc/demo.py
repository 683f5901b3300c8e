#!/usr/bin/python3
"""The demonstration: a part on our kinematics, 300 N held by a client on the network, which is killed in mid-path; the ramp; the next client.

    demo.py [--robot l2|f1|FILE] [--real] [--gantry-tau PROGRAM] [--report PROGRAM] FOLDER

Needs the modules of the machine among those of LinuxCNC, and an ordinary user. Records every servo period, and lets the
program of the folder `report` write FOLDER/report.html. Servo thread and client run in lock-step, unless `--real`: then a computer that does not hold 1 kHz
ends the sessions. LinuxCNC starts this file again as its screen, with `-ini FILE`.
"""

import argparse
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from math import cos, pi, radians, sin
from pathlib import Path

import trial

# Force on the tool in x, world axes, N.
FORCE_N = 300.0
# The client is killed when this share of the program's lines has begun.
KILLED_AT = 0.5
# Rest after a change of the force, s.
REST_S = 0.5
LISTENING, OBTAIN, SAFE_DISCONNECT, FAULT = 0, 3, 4, 5

# Joints in nm, as the server counts them: commands, references, offsets. Other outputs of the server and its sensor.
HAL = """
set joints $::KINS(JOINTS)
loadrt sampler depth=4000,4000 cfg=[string repeat f [expr {3 * $joints}]],ffffffssuu
loadrt scale count=[expr {3 * $joints}]
for {set joint 0} {$joint < $joints} {incr joint} {
    set gain [lindex [join $::DEMO(NM_PER_UNIT)] $joint]
    net offset-$joint gantry-tau.$joint.offset
    foreach {place signal} [list $joint command-$joint [expr {$joints + $joint}] reference-$joint [expr {2 * $joints + $joint}] offset-$joint] {
        addf scale.$place servo-thread
        setp scale.$place.gain $gain
        net $signal => scale.$place.in
        net sampled-$place scale.$place.out => sampler.0.pin.$place
    }
}
for {set i 0} {$i < 6} {incr i} { net wrench-$i => sampler.1.pin.$i }
net phase gantry-tau.phase => sampler.1.pin.6
net cause gantry-tau.cause => sampler.1.pin.7
net missed gantry-tau.missed => sampler.1.pin.8
net tick gantry-tau.tick => sampler.1.pin.9
addf sampler.0 servo-thread
addf sampler.1 servo-thread
loadusr halsampler -c 0 -t joints.txt
loadusr halsampler -c 1 -t server.txt
"""


def turned(rows, vector):
    """Transpose of a matrix times a vector."""
    return [sum(rows[k][i] * vector[k] for k in range(3)) for i in range(3)]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Sensor:
    """The force sensor of a robot file, at the tool: raw samples on the signals wrench-0 to wrench-5, without noise."""

    def __init__(self, robot, joints):
        import hal

        self.hal, self.force_n = hal, 0.0
        sensor = robot["sensor"]
        tool = sensor.get("tool", {"weight_n": [0.0] * 3, "centre_m": [0.0] * 3})
        self.axes, self.lever_m = sensor["rotation"], sensor["lever_m"]
        self.weight_n, self.centre_m = tool["weight_n"], tool["centre_m"]
        self.angles = [f"axis.{letter}.pos-cmd" for letter in "abc"] if joints == 6 else []
        self.pins = hal.component("hand")
        for i in range(6):
            self.pins.newpin(f"wrench-{i}", hal.HAL_FLOAT, hal.HAL_OUT)
        self.show()
        self.pins.ready()
        for i in range(6):
            subprocess.run(["halcmd", "net", f"wrench-{i}", f"hand.wrench-{i}"], check=True)
        threading.Thread(target=self.follow, daemon=True).start()

    def platform(self):
        """Orientation of the unloaded platform: Rz(C) Ry(B) Rx(A)."""
        a, b, c = [radians(self.hal.get_value(pin)) for pin in self.angles] or (0.0, 0.0, 0.0)
        return [
            [cos(c) * cos(b), cos(c) * sin(b) * sin(a) - sin(c) * cos(a), cos(c) * sin(b) * cos(a) + sin(c) * sin(a)],
            [sin(c) * cos(b), sin(c) * sin(b) * sin(a) + cos(c) * cos(a), sin(c) * sin(b) * cos(a) - cos(c) * sin(a)],
            [-sin(b), cos(b) * sin(a), cos(b) * cos(a)],
        ]

    def show(self):
        platform = self.platform()
        weight = turned(platform, self.weight_n)
        force = [load + own for load, own in zip(turned(platform, [self.force_n, 0.0, 0.0]), weight)]
        lever, centre = cross(self.lever_m, force), cross(self.centre_m, weight)
        moment = [at_centre - at_sensor for at_centre, at_sensor in zip(centre, lever)]
        for i, value in enumerate(turned(self.axes, force) + turned(self.axes, moment)):
            self.pins[f"wrench-{i}"] = value

    def follow(self):
        """A platform that turns takes its sensor along."""
        while True:
            self.show()
            time.sleep(0.002)


class Screen:
    """Plays the demonstration."""

    def __init__(self, ini):
        sys.path.insert(0, str(trial.HERE / "config"))
        import run

        self.run, self.status = run, run.status
        self.ini = run.linuxcnc.ini(ini)
        self.robot = self.ini.find("DEMO", "ROBOT")
        self.client, self.sensor = None, None

    def say(self, text):
        self.run.say("demo", f"{self.pin('gantry-tau.tick') / 1e3:6.1f} s  {text}")

    def pin(self, name):
        return self.sensor.hal.get_value(name)

    def wait_for(self, phase, what):
        self.run.wait(what, lambda: self.pin("gantry-tau.phase") == phase)

    def rearm(self):
        for value in "010":
            subprocess.run(["halcmd", "sets", "rearm", value], check=True)
            time.sleep(0.05)
        self.wait_for(LISTENING, "the server to be re-armed")

    def connect(self):
        """Starts a client."""
        server = f"127.0.0.1:{self.ini.find('DEMO', 'PORT')}"
        program = shlex.split(self.ini.find("DEMO", "GANTRY_TAU"))
        command = [*program, "client", server, "--robot", self.robot]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        return subprocess.Popen(command, **pipes)

    def obtain(self):
        self.client = self.connect()
        self.wait_for(OBTAIN, "a client in Obtain")
        self.say("a client has tared its sensor, and may move the references (Obtain)")

    def push(self, force_n):
        self.sensor.force_n = force_n
        time.sleep(REST_S)
        self.say(f"force on the tool: {force_n:.0f} N in x")

    def settle(self):
        """Waits until the filter of the client has brought the offsets back: a goodbye before that is a ramp."""
        offsets = [f"gantry-tau.{joint}.offset" for joint in range(self.status.joints)]
        self.run.wait("offsets of zero", lambda: not any(self.pin(name) for name in offsets))

    def kill(self):
        """In mid-path, once."""
        if self.client is None or self.status.motion_line < self.killed_at:
            return
        self.client.send_signal(signal.SIGKILL)
        self.client.communicate()
        self.client = None
        self.wait_for(SAFE_DISCONNECT, "the end of the session")
        self.say(f"line {self.status.motion_line}: the client is killed; offsets ramp to zero, the path goes on")
        newcomer = self.connect()
        said = newcomer.communicate(timeout=30)[0].strip().splitlines()
        self.say(f"a newcomer meanwhile: {said[-1] if said else ''}")

    def main(self):
        program = self.ini.find("DISPLAY", "OPEN_FILE")
        lines = Path(program).read_text().splitlines()
        self.killed_at = round(KILLED_AT * len(lines))
        self.run.switch_on()
        self.run.home()
        self.sensor = Sensor(tomllib.loads(Path(self.ini.find("DEMO", "FILE")).read_text()), self.status.joints)
        self.rearm()
        self.say("machine on, homed, server re-armed")
        self.obtain()
        self.push(FORCE_N)
        self.say(f"part program {program}")
        count = self.run.run(program, self.kill)
        self.wait_for(LISTENING, "the end of the ramp")
        self.say("the program has ended, the offsets are zero")
        self.push(0)
        self.obtain()
        self.push(FORCE_N)
        self.say(f"part program {program}, again")
        count += self.run.run(program)
        self.push(0)
        self.settle()
        self.client.send_signal(signal.SIGINT)
        said = self.client.communicate(timeout=30)[0].strip().splitlines()
        self.say(f"the client: {said[-1] if said else ''}")
        self.wait_for(LISTENING, "the end of the session")
        time.sleep(REST_S)
        self.run.say("ended", "error" if count else "done")
        return 1 if count else 0


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as held:
        return held.getsockname()[1]


def play(options):
    robot, file = options.robot, Path(options.robot).resolve()
    if robot in ("l2", "f1"):
        file = trial.HERE.parents[1] / "robots" / f"{robot}.toml"
    elif not file.is_file():
        sys.exit(f"demo.py: {robot} is neither l2 nor f1 nor a robot file")
    else:
        robot = file
    keys = tomllib.loads(file.read_text())
    metres_per_q = keys["axes"]["metres_per_q"]
    # Carts are in mm; plates in degrees, and q in radians.
    nm = [repr(1e6 if joint < 3 else metres * 1e9 * pi / 180) for joint, metres in enumerate(metres_per_q)]
    port = free_port()
    demo = f"[DEMO]\nROBOT = {robot}\nFILE = {file}\nGANTRY_TAU = {options.gantry_tau}\nPORT = {port}\nNM_PER_UNIT = {' '.join(nm)}\n\n"
    server = f"PARAMETERS = port={port} lockstep={int(not options.real)} "
    changes = [("[KINS]\n", demo + "[KINS]\n"), ("PARAMETERS = ", server)]
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder / "config", ignore_errors=True)
    ini = trial.prepare(folder, keys["model"], Path(__file__).resolve(), HAL, changes)
    output = trial.linuxcnc(ini)
    start = "gantry-tau demo "
    said = [line.removeprefix(start) for line in output.splitlines() if line.startswith(start)]
    print("\n".join(said), end="\n\n", flush=True)
    (folder / "said.txt").write_text("\n".join(said) + "\n")
    for name in ("joints.txt", "server.txt"):
        shutil.move(ini.parent / name, folder / name)
    return subprocess.run([*shlex.split(options.report), folder, "--robot", robot]).returncode


if __name__ == "__main__":
    if "-ini" in sys.argv:
        sys.exit(Screen(sys.argv[sys.argv.index("-ini") + 1]).main())
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--robot", default="l2", metavar="l2|f1|FILE")
    parser.add_argument("--real", action="store_true", help="in real time; the default is lock-step")
    parser.add_argument("--gantry-tau", default="gantry-tau", metavar="PROGRAM")
    parser.add_argument("--report", default="gantry-tau-linuxcnc-report", metavar="PROGRAM")
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    sys.exit(play(parser.parse_args()))
