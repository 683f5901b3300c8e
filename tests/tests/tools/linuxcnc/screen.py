#!/usr/bin/python3
"""Screen for tests: each line of the standard input is a command; each answer is lines that begin with `> `, the last one `> .`.

    pins NAME...          values of pins
    sets SIGNAL VALUE     as of halcmd
    on, home, off, estop, abort, run
    wait SECONDS EXPRESSION   until it is true; `p(NAME)` is a pin, `s` the status
    try STATEMENT         of Python, as it is
    errors                messages for the operator since the last time
"""

import subprocess
import sys
import time

sys.path.insert(0, "..")

import hal
import linuxcnc
import run

component = hal.component("screen")
component.ready()


def p(name):
    return hal.get_value(name)


def halcmd(*words):
    done = subprocess.run(["halcmd", *words], capture_output=True, text=True)
    return (done.stdout + done.stderr).strip()


def wait(seconds, expression):
    end = time.monotonic() + float(seconds)
    while True:
        run.status.poll()
        if eval(expression, globals(), {"s": run.status}):
            return "done"
        if time.monotonic() > end:
            return "late"
        time.sleep(0.002)


def begin():
    """Starts the part program, and returns when it moves."""
    run.command.mode(linuxcnc.MODE_AUTO)
    run.wait("automatic mode", lambda: run.status.task_mode == linuxcnc.MODE_AUTO)
    run.wait("world mode", lambda: run.status.motion_mode != linuxcnc.TRAJ_MODE_FREE)
    run.command.program_open("part.ngc")
    run.wait("the program to be opened", lambda: run.status.file.endswith("part.ngc"))
    run.command.auto(linuxcnc.AUTO_RUN, 0)
    run.wait("the program to move", lambda: run.status.current_vel > 0)


def errors():
    texts = []
    message = run.messages.poll()
    while message:
        texts.append(message[1])
        message = run.messages.poll()
    return "\n".join(texts)


def state(name):
    return lambda: run.command.state(getattr(linuxcnc, name))


SIMPLE = {
    "on": run.switch_on,
    "home": run.home,
    "off": state("STATE_OFF"),
    "estop": state("STATE_ESTOP"),
    "abort": run.command.abort,
    "run": begin,
    "errors": errors,
}


def answer(word, rest):
    if word in SIMPLE:
        return SIMPLE[word]()
    if word == "pins":
        return " ".join(str(float(p(name))) for name in rest.split())
    if word == "sets":
        return halcmd("sets", *rest.split())
    if word == "wait":
        return wait(*rest.split(" ", 1))
    if word == "try":
        exec(rest, globals())
        return ""
    return f"unknown: {word}"


print("> .", flush=True)
for line in sys.stdin:
    word, _, rest = line.strip().partition(" ")
    try:
        text = answer(word, rest)
    except (Exception, SystemExit) as error:
        text = f"failed: {error}"
    for said in (text or "").splitlines():
        print(">", said)
    print("> .", flush=True)
