#!/usr/bin/python3
"""Screen without a display: switches the machine on, homes it, runs one part program, prints where it ended, and leaves.

LinuxCNC starts it as `[DISPLAY]DISPLAY` with `-ini FILE`, and shuts down when it ends. The program is `[DISPLAY]OPEN_FILE`. Lines on stdout,
in mm and degrees, each beginning with `gantry-tau`:

    gantry-tau error TEXT       a message for the operator
    gantry-tau start POSE       commanded pose before the program
    gantry-tau pose POSE        commanded pose after it
    gantry-tau joints POSITIONS
    gantry-tau ended done|error

Exit code 0: the program ran to its end without a message.
"""

import sys
import time

import linuxcnc

PATIENCE_S = 60.0
ERRORS = (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR)

command = linuxcnc.command()
status = linuxcnc.stat()
messages = linuxcnc.error_channel()


def say(*words):
    print("gantry-tau", *words, flush=True)


def errors():
    """Prints the messages that have come; returns their number."""
    count = 0
    message = messages.poll()
    while message:
        kind, text = message
        if kind in ERRORS:
            say("error", text)
            count += 1
        message = messages.poll()
    return count


def wait(what, condition):
    """Polls until `condition()`; `wait_complete` returns before the state is the new one."""
    end = time.monotonic() + PATIENCE_S
    while True:
        status.poll()
        if condition():
            return
        if time.monotonic() > end:
            errors()
            raise SystemExit(f"run.py: waited {PATIENCE_S:.0f} s for: {what}")
        time.sleep(0.01)


def reached(state):
    return lambda: status.task_state == state


def switch_on():
    command.state(linuxcnc.STATE_ESTOP_RESET)
    wait("leaving emergency stop", lambda: status.task_state != linuxcnc.STATE_ESTOP)
    command.state(linuxcnc.STATE_ON)
    wait("machine on", reached(linuxcnc.STATE_ON))


def home():
    """Absolute encoders: nothing moves."""
    command.mode(linuxcnc.MODE_MANUAL)
    command.teleop_enable(0)
    wait("joint mode", lambda: status.motion_mode == linuxcnc.TRAJ_MODE_FREE)
    command.home(-1)
    wait("homing", lambda: all(status.homed[: status.joints]))


def pose():
    """Letters and numbers of the axes of this machine."""
    axes = [(letter, number) for number, letter in enumerate("XYZABCUVW") if status.axis_mask & 1 << number]
    return " ".join(f"{letter}{status.position[number]:.9f}" for letter, number in axes)


def run(program, each=lambda: None):
    """Runs a part program, and calls `each` about every 10 ms. Returns the number of error messages."""
    command.mode(linuxcnc.MODE_AUTO)
    wait("automatic mode", lambda: status.task_mode == linuxcnc.MODE_AUTO)
    wait("world mode", lambda: status.motion_mode != linuxcnc.TRAJ_MODE_FREE)
    say("start", pose())
    command.program_open(program)
    wait("the program to be opened", lambda: status.file.endswith(program.rsplit("/", 1)[-1]))
    command.auto(linuxcnc.AUTO_RUN, 0)
    started = time.monotonic()
    count = 0
    # The interpreter is idle before it begins as well: the first moments do not count.
    while True:
        count += errors()
        status.poll()
        each()
        idle = status.interp_state == linuxcnc.INTERP_IDLE and status.inpos and status.queue == 0
        if idle and time.monotonic() - started > 0.5:
            return count + errors()
        if time.monotonic() - started > PATIENCE_S:
            raise SystemExit(f"run.py: {program} did not end within {PATIENCE_S:.0f} s")
        time.sleep(0.01)


def main():
    ini = linuxcnc.ini(sys.argv[sys.argv.index("-ini") + 1])
    switch_on()
    home()
    count = run(ini.find("DISPLAY", "OPEN_FILE"))
    # The planner is ahead of the joints by some periods, and messages come later than what they are about.
    time.sleep(0.2)
    count += errors()
    status.poll()
    say("pose", pose())
    say("joints", " ".join(f"{position:.9f}" for position in status.joint_position[: status.joints]))
    say("ended", "error" if count else "done")
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
