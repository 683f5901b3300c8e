"""The package gantry_tau, beside the program: of_package.py PROGRAM FOLDER, that of host/python. Needs numpy, pandas,
mcap and mypy.
"""

import ctypes
import json
import os
import subprocess
import sys
import tempfile

PROGRAM, PACKAGE = map(os.path.abspath, sys.argv[1:])
os.environ["GANTRY_TAU"] = PROGRAM
sys.path.insert(0, PACKAGE)
import numpy

import gantry_tau
from gantry_tau import Ended, Machine, ProgramFailed, Session, SolveError, recording



def raised(kind, words, call):
    """Returns the exception that a call raises, of a kind, with these words."""
    try:
        found = call()
    except kind as failure:
        assert words in str(failure), f"{failure!r} does not say {words!r}"
        return failure
    raise AssertionError(f"no {kind.__name__}, but {found!r}")


def solved(robot, **question):
    asked = subprocess.run([PROGRAM, "solve"], input=json.dumps({"robot": robot, **question}), capture_output=True, text=True, check=True)
    return json.loads(asked.stdout)["ok"]


def machines_are_solve_to_the_bit():
    places = {"l2": [0.0, 0.5, 0.65], "f1": [0.1, 0.0, 0.3]}
    load = [30.0, -20.0, -300.0, 1.0, 2.0, -3.0]
    random = numpy.random.default_rng(2)
    for robot, place in places.items():
        with Machine(robot) as machine:
            T = place + random.uniform(-0.05, 0.05, (4, 5, 3))
            q = machine.ik(T)
            results = {"ik": (q, "q"), "jacobian": (machine.jacobian(T), "J"), "compliance": (machine.compliance(T), "C"),
                       "deflection": (machine.deflection(T, load), "dx_total"), "compensate": (machine.compensate(T, load), "q")}
            for op, (array, name) in results.items():
                assert array.shape[:2] == (4, 5), op
                for at in [(0, 0), (3, 4)]:
                    expected = solved(robot, op=op, T=T[at].tolist(), w=load)[name]
                    assert array[at].tolist() == expected, op
            step = 1e-6 * numpy.eye(3)[0]
            per_m = (machine.ik(T + step) - machine.ik(T - step)) / 2e-6
            moved = (machine.jacobian(T) @ per_m[..., None])[..., 0]
            # Differences of a function with a radius of some tenths of a metre, over 2 um.
            assert abs(moved - numpy.eye(moved.shape[-1])[0]).max() < 1e-8, "the Jacobian is not that of ik"
            again, R = machine.fk(q)
            assert abs(again - T).max() < 1e-9 and R.shape == (4, 5, 3, 3)
            one = machine.ik(T[0, 0])
            assert one.shape == q.shape[2:] and (one == q[0, 0]).all()
            loads = random.uniform(-100.0, 100.0, (5, 6))
            assert machine.deflection(T, loads).shape == (4, 5, 6)


def wrong_arguments_are_named():
    with Machine("l2") as machine:
        T = numpy.tile([0.0, 0.5, 0.65], (7, 1))
        T[5] = [90.0, 0.0, 0.0]
        assert raised(SolveError, "reach", lambda: machine.ik(T)).index == 5
        raised(ValueError, "T: not all numbers are finite", lambda: machine.ik([0.0, numpy.nan, 0.0]))
        raised(ValueError, "T has 0 dimensions, and needs 1", lambda: machine.ik(0.5))
        raised(ValueError, "T", lambda: machine.ik([0.0, 0.5]))
        assert machine.ik(T[:5]).shape == (5, 3), "a refused question ends nothing"
    raised(ValueError, "nowhere.toml", lambda: Machine("nowhere.toml"))
    raised(ValueError, "a recording is a file of", lambda: recording.read("run.txt"))
    raised(ProgramFailed, "nowhere.toml", lambda: gantry_tau.identify("nowhere.toml", "out.toml"))
    raised(ProgramFailed, "--no-such-option", lambda: gantry_tau.identify("nowhere.toml", "out.toml", no_such_option=(1, 2)))


def recordings_say_the_same(folder):
    runs = {}
    for extension in ["csv", "labcomm", "mcap"]:
        path = f"{folder}/run.{extension}"
        subprocess.run([PROGRAM, "demo", "--pace", "lockstep", "--record", path, "--report", f"{folder}/{extension}.html"], check=True,
                       capture_output=True)
        runs[extension] = recording.read(path)
    table = runs["csv"]
    assert len(table["tick"]) > 1000 and table["tick"].dtype == numpy.int64 and "Obtain" in table["state"]
    assert table.units["offset_1_nm"] == "nm" and table.units["moment_x_n_m"] == "N m" and "state" not in table.units
    assert table.frame().index.name == "tick"
    labcomm, mcap = runs["labcomm"], runs["mcap"]
    assert labcomm.units["axes.axis.velocity_offset_um_s"] == "um/s"
    for other in (labcomm, mcap):
        # Of two runs, whose noise is not the same.
        offsets = other["axes.axis.position_offset_nm"]
        assert offsets.shape[1] == 3 and other["tool.load"].shape == (len(other["tool.tick"]), 6)
        most_nm = max(abs(table[f"offset_{axis}_nm"]).max() for axis in (1, 2, 3))
        assert abs(abs(offsets).max() / most_nm - 1.0) < 0.05, most_nm
        assert other.frame("axes").columns.tolist() == labcomm.frame("axes").columns.tolist()
        raised(ValueError, "name one of axes, ", other.frame)
    whole = open(f"{folder}/run.csv").read()
    with open(f"{folder}/cut.csv", "w") as cut:
        cut.write(whole[:len(whole) // 2])
    assert len(recording.read(f"{folder}/cut.csv")["tick"]) < len(table["tick"])


class Server:
    """`gantry-tau serve` on a free port, in lock-step: the pacer answers once per ms of the clock, and a busy computer ends no session."""

    def __init__(self, *options):
        self.folder = tempfile.TemporaryDirectory()
        environment = {**os.environ, "STATE_DIRECTORY": self.folder.name}
        self.process = subprocess.Popen([PROGRAM, "serve", "--listen", "127.0.0.1:0", "--pace", "lockstep", *options], stdout=subprocess.PIPE, text=True,
                                        stderr=subprocess.DEVNULL, env=environment, cwd=self.folder.name)
        line = self.process.stdout.readline()
        self.address = line.split()[2].rstrip(",;")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()


def pauses_of_the_interpreter_end_nothing():
    # On a busy computer a pause is longer.
    with Server() as server, Session(server.address, hold_s=30.0, give_up_s=60.0) as session:
        assert session.state.phase == "submit"
        lib = ctypes.PyDLL(None)
        for number in range(10):
            before = session.state.t
            session.target([5.0, -5.0, 0.0], t=before)
            # Holds the interpreter's lock, as an extension may: the thread that reads stands still.
            lib.usleep(100_000)
            session.wait()
            assert session.wait().t > before + 0.08, "the server's time stood still"
        state = session.wait()
        assert state.phase == "obtain" and state.offset_um == [5.0, -5.0, 0.0], state
        assert (state.late, state.limited) == (0, 0), state
        raised(ValueError, "2 numbers for 3 axes", lambda: session.target([0.0, 0.0]))
        raised(ValueError, "not all numbers are finite", lambda: session.target([0.0, 0.0, float("inf")]))
        raised(ValueError, "one number for 3 axes", lambda: session.target(5.0))
        raised(ValueError, "neither 'submit' nor 'obtain'", lambda: session.target([0.0, 0.0, 0.0], mode="Obtain"))
        session.target([5000.0, 0.0, 0.0])
        while not session.refused:
            session.wait()
        assert "is not within" in session.refused[-1]
        first, second = (next(iter(session)) for _ in range(2))
        assert second.t >= first.t


def silence_is_an_end_with_its_cause():
    with Server() as server, Session(server.address, hold_s=0.05, give_up_s=0.2) as session:
        session.target([1.0, 0.0, 0.0], t=session.state.t + 9.0)
        ended = raised(Ended, "no target for 200 ms", lambda: [state for state in session])
        assert str(raised(Ended, "", lambda: session.target([0.0, 0.0, 0.0]))) == str(ended)


def a_server_that_stops_is_an_end_with_its_cause():
    with Server() as server, Session(server.address) as session:
        server.process.terminate()
        raised(Ended, "", lambda: [state for state in session])


def an_absent_server_is_an_end_with_its_cause():
    raised(Ended, "cannot be reached", lambda: Session("127.0.0.1:1"))
    raised(Ended, "--give-up-ms", lambda: Session("127.0.0.1:1", hold_s=2.0, give_up_s=1.0))
    said = str(raised(Ended, "invalid value 'localhost'", lambda: Session("localhost")))
    assert "\n" not in said and not said.startswith("error"), said
    raised(Ended, "nowhere.key", lambda: Session("127.0.0.1:1", key="nowhere.key"))


def types_are_as_written():
    checked = subprocess.run([sys.executable, "-m", "mypy", "--ignore-missing-imports", "--cache-dir", os.devnull, "-p", "gantry_tau"], cwd=PACKAGE, capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def a_pacer_of_another_version_is_an_end_with_its_cause(folder):
    pacer = f"{folder}/pacer"
    with open(pacer, "w") as script:
        script.write("#!/bin/sh\necho '{\"t\": 1.0}'\nexec sleep 600\n")
    os.chmod(pacer, 0o755)
    os.environ["GANTRY_TAU"] = pacer
    try:
        raised(Ended, "the pacer said", Session)
    finally:
        os.environ["GANTRY_TAU"] = PROGRAM


types_are_as_written()
machines_are_solve_to_the_bit()
wrong_arguments_are_named()
with tempfile.TemporaryDirectory() as folder:
    recordings_say_the_same(folder)
    a_pacer_of_another_version_is_an_end_with_its_cause(folder)
pauses_of_the_interpreter_end_nothing()
silence_is_an_end_with_its_cause()
a_server_that_stops_is_an_end_with_its_cause()
an_absent_server_is_an_end_with_its_cause()
