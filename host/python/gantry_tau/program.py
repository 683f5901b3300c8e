"""The program `gantry-tau`, and questions to it."""

import json
import os
import shutil
import subprocess
import sysconfig
import threading

NAME = "gantry-tau.exe" if os.name == "nt" else "gantry-tau"


class ProgramFailed(Exception):
    """The program is missing, or has ended with an error. The text is what it said."""


class SolveError(ValueError):
    """A question has no answer. `kind` is a word for it, as of `gantry-tau solve`."""

    def __init__(self, kind, message):
        super().__init__(message)
        self.kind = kind


def path():
    """Returns the path of the program: `GANTRY_TAU`, that of the wheel, or the one of the `PATH`."""
    named = os.environ.get("GANTRY_TAU")
    if named:
        return named
    of_wheel = os.path.join(sysconfig.get_path("scripts"), NAME)
    found = of_wheel if os.path.exists(of_wheel) else shutil.which("gantry-tau")
    if found is None:
        raise ProgramFailed("gantry-tau is not in the PATH: pip install gantry-tau, or set GANTRY_TAU to the program")
    return found


def run(*arguments):
    """Runs a command to its end. Returns its exit code, 0 or 3 (done, and to be doubted), and what it printed."""
    ended = subprocess.run([path(), *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if ended.returncode not in (0, 3):
        raise ProgramFailed(ended.stderr.strip().removeprefix("gantry-tau: ") or f"exit code {ended.returncode}")
    return ended.returncode, ended.stdout


class Solver:
    """Kinematics, statics and dynamics of a machine, by `gantry-tau solve`: one line of JSON in, one out.

    `robot` is "l2", "f1" or the path of a robot file, `program` that of `gantry-tau`.
    """

    def __init__(self, robot="l2", program=None):
        self.robot = os.fspath(robot)
        # In a session of its own: Ctrl-C is for the caller, whose end ends the solver as well.
        self._process = subprocess.Popen([program or path(), "solve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         start_new_session=True)
        self._lock = threading.Lock()

    def ask(self, op, **arguments):
        """Returns the answer to a question; raises `SolveError` if there is none."""
        return self.ask_all([{"op": op, **arguments}])[0]

    def ask_all(self, questions):
        """Returns the answers to many questions, in their order. A `SolveError` has the number of its question, `index`."""
        lines = [json.dumps({"robot": self.robot, **question}).encode() + b"\n" for question in questions]
        with self._lock:
            # Beside the reading: neither pipe has room for all.
            writer = threading.Thread(target=self._write, args=(lines,), daemon=True)
            writer.start()
            answers = [self._process.stdout.readline() for _ in lines]
            writer.join()
        return [_result(index, answer) for index, answer in enumerate(answers)]

    def _write(self, lines):
        try:
            self._process.stdin.writelines(lines)
            self._process.stdin.flush()
        except OSError:
            pass  # The program has ended, which its reader finds.

    def close(self):
        """Ends the program."""
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def _result(index, line):
    if not line:
        raise ProgramFailed("gantry-tau solve has ended")
    answer = json.loads(line)
    if "ok" in answer:
        return answer["ok"]
    failure = SolveError(answer["error"]["kind"], answer["error"]["message"])
    failure.index = index
    raise failure
