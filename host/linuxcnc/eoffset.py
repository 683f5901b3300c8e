#!/usr/bin/python3
"""LinuxCNC's own external offsets (`axis.L.eoffset-*`), tried on the L2 and judged period by period.

    eoffset.py [FOLDER]       runs LinuxCNC with config/l2 in FOLDER (default: a temporary one), and prints a table (Markdown)

Needs the modules of the L2 among those of LinuxCNC, and an ordinary user. LinuxCNC starts this file again as its screen, with `-ini FILE`.
Exit code 0: the table; 1: LinuxCNC did not run, or did not do what a row says.
"""

import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import trial

PERIOD_S = 1e-3
# Share of the limits of [AXIS_X], 500 mm/s and 1000 mm/s^2, that LinuxCNC may use for an offset.
SHARE = 0.4
# Largest acceleration of an offset then, m/s^2.
ALLOWED = 0.4
# Offset at which it is disabled, and the end of the axis, mm. The speed there is sqrt(2 a s): 23 and 100 mm/s.
DISABLED_AT = 0.66
LIMIT = 12.45

# Signals of the comparison: `enable` is `wanted`, but off beyond comp.0.in1 mm.
HAL = """
loadrt comp
loadrt and2
loadrt sampler depth=8000 cfg=ffffbbbbu
addf comp.0 servo-thread
addf and2.0 servo-thread
addf sampler.0 servo-thread
setp axis.x.eoffset-scale 0.001
newsig part u32
newsig wanted bit
net offset axis.x.eoffset => comp.0.in0
net below comp.0.out => and2.0.in0
net wanted => and2.0.in1
net enabled-offset and2.0.out => axis.x.eoffset-enable
net path axis.x.pos-cmd => sampler.0.pin.0
net offset => sampler.0.pin.1
net request axis.x.eoffset-request => sampler.0.pin.2
net command-0 => sampler.0.pin.3
net drives-on => sampler.0.pin.4
net enabled-offset => sampler.0.pin.5
net limited motion.eoffset-limited => sampler.0.pin.6
net world motion.coord-mode => sampler.0.pin.7
net part => sampler.0.pin.8
loadusr halsampler -t record.txt
"""
COLUMNS = ("row", "path", "offset", "request", "cart", "is_on", "enabled", "limited", "world", "part")

# Parts of the record.
JOG, PROGRAM, ABORT, SILENT, OFF, AT_LIMIT, NAN = range(1, 8)


def hal(*words):
    done = subprocess.run(["halcmd", *map(str, words)], check=True, capture_output=True, text=True)
    return done.stdout.strip()


def offset():
    return float(hal("getp", "axis.x.eoffset"))


class Screen:
    """Does all parts; what happened is in the record."""

    def __init__(self):
        sys.path.insert(0, str(trial.HERE / "config"))
        import run

        self.run, self.linuxcnc = run, run.linuxcnc
        self.command, self.status = run.command, run.status

    def enable(self, up_to_mm, counts):
        """Enables an offset of `counts` micrometres, until it has reached a value."""
        hal("setp", "comp.0.in1", up_to_mm)
        hal("sets", "wanted", 1)
        # LinuxCNC adds up what the counts change by while they are enabled.
        time.sleep(0.05)
        hal("setp", "axis.x.eoffset-counts", counts)

    def settle(self, value):
        self.run.wait(f"an offset of {value} mm", lambda: abs(offset() - value) < 1e-6)

    def clear(self):
        # A disabled offset cannot be cleared.
        hal("setp", "comp.0.in1", 1e3)
        hal("sets", "wanted", 1)
        hal("setp", "axis.x.eoffset-clear", 1)
        self.settle(0)
        hal("sets", "wanted", 0)
        time.sleep(0.05)
        hal("setp", "axis.x.eoffset-counts", 0)
        hal("setp", "axis.x.eoffset-clear", 0)

    def manual(self):
        self.command.mode(self.linuxcnc.MODE_MANUAL)
        self.run.wait("manual mode", lambda: self.status.task_mode == self.linuxcnc.MODE_MANUAL)
        self.command.teleop_enable(1)
        self.run.wait("teleop", lambda: self.status.motion_mode == self.linuxcnc.TRAJ_MODE_TELEOP)

    def mdi(self, text):
        self.command.mode(self.linuxcnc.MODE_MDI)
        self.run.wait("MDI", lambda: self.status.task_mode == self.linuxcnc.MODE_MDI)
        self.run.wait("coordinated mode", lambda: self.status.motion_mode == self.linuxcnc.TRAJ_MODE_COORD)
        self.command.mdi(text)

    def reach(self, text, what, condition):
        """Sends a command, and again while nothing comes of it: one that comes while a mode changes is forgotten."""
        sent = []

        def is_reached():
            if not sent or time.monotonic() - sent[-1] > 5:
                self.mdi(text)
                sent.append(time.monotonic())
            return condition()

        self.run.wait(what, is_reached)

    def disable_at_speed(self, part):
        hal("sets", "part", part)
        self.enable(DISABLED_AT, 5000)
        self.run.wait("the offset to be disabled", lambda: offset() >= DISABLED_AT)
        time.sleep(2)
        hal("sets", "part", 0)
        self.clear()

    def parts(self):
        self.manual()
        self.disable_at_speed(JOG)
        self.mdi("G21 G90")
        self.disable_at_speed(PROGRAM)

        self.enable(1e3, 1000)
        self.settle(1)
        self.mdi("G1 Y520 F600")
        time.sleep(0.5)
        hal("sets", "part", ABORT)
        self.command.abort()
        time.sleep(0.5)

        # Nothing writes the counts any more: each halcmd was a process that has ended.
        hal("sets", "part", SILENT)
        self.mdi("G1 Y500 F600")
        time.sleep(3)

        hal("sets", "part", OFF)
        self.command.state(self.linuxcnc.STATE_OFF)
        self.run.wait("machine off", lambda: self.status.task_state != self.linuxcnc.STATE_ON)
        time.sleep(0.3)
        self.command.state(self.linuxcnc.STATE_ON)
        self.run.wait("machine on", self.run.reached(self.linuxcnc.STATE_ON))
        self.mdi("G21")
        time.sleep(0.3)
        hal("sets", "part", 0)
        hal("sets", "wanted", 0)
        hal("setp", "axis.x.eoffset-counts", 0)
        self.reach("G0 X0", "X0", lambda: abs(self.status.position[0]) < 1e-6 and self.status.inpos)

        hal("sets", "part", AT_LIMIT)
        self.enable(1e3, 50000)
        self.run.wait("the end of the axis", lambda: hal("getp", "motion.eoffset-limited") == "TRUE")
        time.sleep(0.2)
        hal("sets", "part", 0)
        self.clear()

        hal("sets", "part", NAN)
        hal("setp", "axis.x.eoffset-scale", "nan")
        self.enable(1e3, 1000)
        time.sleep(0.2)
        hal("setp", "axis.x.eoffset-scale", 0.001)
        hal("setp", "axis.x.eoffset-counts", 2000)
        time.sleep(0.5)

    def main(self):
        self.run.switch_on()
        self.run.home()
        names = [line.split()[4] for line in hal("show", "pin").splitlines() if "eoffset-enable" in line]
        Path("pins.txt").write_text("\n".join(names))
        self.parts()
        self.run.errors()
        self.run.say("ended done")


class Part:
    """Rows of one part, by column."""

    def __init__(self, record, number):
        rows = [row for row in record if row[-1] == number]
        assert len(rows) > 100, f"part {number} has {len(rows)} rows"
        for name, column in zip(COLUMNS, zip(*rows)):
            setattr(self, name, column)

    def falls(self, name):
        values = getattr(self, name)
        return next(i for i in range(1, len(values)) if values[i - 1] and not values[i])


def acceleration(values):
    """Largest second difference, m/s^2, of values in mm."""
    triples = zip(values, values[1:], values[2:])
    return max(abs(c - 2 * b + a) for a, b, c in triples) * 1e-3 / PERIOD_S**2


def speed(values, at):
    """mm/s."""
    return (values[at] - values[at - 1]) / PERIOD_S


def judge(l2):
    """Returns rows of the table; fails where LinuxCNC did something else."""
    text = (l2 / "record.txt").read_text()
    assert "overrun" not in text, "the sampler lost rows"
    lines = text[: text.rfind("\n")].split("\n")
    record = [tuple(map(float, line.split())) for line in lines]
    assert all(row[0] == number for number, row in enumerate(record)), "the sampler lost rows"
    jog, program, abort, silent, off, limit, nan = (Part(record, part) for part in range(JOG, NAN + 1))

    pins = (l2 / "pins.txt").read_text().split()
    assert len(pins) == 9 and all(pin.startswith("axis.") for pin in pins), pins
    yield "offsets of", "axes (X Y Z A B C U V W), none of a joint or a motor", "each joint, in its drive's nanometres"

    at = jog.falls("enabled")
    before, stop, rest = speed(jog.offset, at), acceleration(jog.offset), jog.offset[at + 3 :]
    assert stop > 10 * ALLOWED and set(rest) == {rest[0]}, (stop, set(rest))
    yield (
        "disabled while it changes, in teleop",
        f"from {before:.0f} mm/s to 0 within one period: {stop:.0f} m/s² ({acceleration(jog.cart):.0f} m/s² of a cart) at a limit of {ALLOWED} m/s²",
        "a ramp of 0.1 µm per period",
    )
    at = program.falls("enabled")
    slow, rest = acceleration(program.offset), program.offset[at + 100 :]
    assert slow < 1.1 * ALLOWED and set(rest) == {rest[0]}, (slow, set(rest))
    yield (
        "disabled while it changes, in a program",
        f"slowed down at {slow:.1f} m/s², {rest[0] - program.offset[at]:.2f} mm farther on",
        "the same ramp",
    )
    yield "after that", f"holds {rest[0]:.3f} mm for ever ({len(rest) * PERIOD_S:.0f} s seen); cannot be cleared while it is disabled", "at zero after the ramp"
    assert set(abort.offset) == {1.0}
    yield "program aborted", f"keeps {abort.offset[-1]:.0f} mm", "goes on holding the tool under its load; the path stops"
    assert set(silent.offset) == {1.0} and len(set(silent.cart)) > 500
    yield "whoever writes it is gone", f"no watchdog: keeps {silent.offset[-1]:.0f} mm ({len(silent.row) * PERIOD_S:.0f} s seen) while the path goes on", "ramp after the second missed deadline"

    moved, stood = off.path[-1] - off.path[0], max(off.cart) - min(off.cart)
    assert abs(moved - 1) < 1e-6 and off.offset[-1] == 0 and stood < 2e-6, (moved, stood)
    yield "machine off and on", f"becomes part of the path: X is {moved:.3f} mm farther, the offset 0, and no cart has moved", "ramp; the path is where it was"

    at = next(i for i, limited in enumerate(limit.limited) if limited)
    stop = acceleration(limit.offset)
    assert stop > 10 * ALLOWED
    yield (
        "soft limit of the axis",
        f"from {speed(limit.offset, at - 1):.0f} mm/s to 0: {stop:.0f} m/s² ({acceleration(limit.cart):.0f} m/s² of a cart)",
        "limits of its own: size, change per period, change of that; clamped to the travel of the machine",
    )
    spoiled = [i for i, request in enumerate(nan.request) if math.isnan(request)]
    assert spoiled and all(map(math.isnan, nan.request[spoiled[0] : -1])), "the request"
    assert set(nan.offset) == {0.0}
    yield "scale of NaN", "accepted: the request is NaN from then on, also after the scale was corrected; counts have no effect", "offsets are integers; a NaN for the position of a drive is a stop"


def compare(folder):
    changes = [("[AXIS_X]\n", f"[AXIS_X]\nOFFSET_AV_RATIO = {SHARE}\n"), ("MAX_LIMIT = 400\n", f"MAX_LIMIT = {LIMIT}\n")]
    ini = trial.prepare(folder, "l2", Path(__file__).resolve(), HAL, changes)
    trial.linuxcnc(ini)
    print("| event | `axis.L.eoffset` | `gantry_tau` |\n|---|---|---|")
    for row in judge(ini.parent):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    if "-ini" in sys.argv:
        Screen().main()
    elif len(sys.argv) > 1:
        compare(Path(sys.argv[1]).resolve())
    else:
        with tempfile.TemporaryDirectory() as place:
            compare(Path(place))
