"""The program `gantry-tau`, and questions to it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sysconfig
import threading
from collections.abc import Iterable

NAME = "gantry-tau.exe" if os.name == "nt" else "gantry-tau"


class ProgramFailed(Exception):
    """The program is missing, or has ended with an error. The text is what it said."""


class SolveError(ValueError):
    """A question has no answer. `kind` is a word for it, as of `gantry-tau solve`."""

    index = 0
    """Number of the question, of many."""

    def __init__(self, kind: str, message: str):
        super().__init__(message)
        self.kind = kind


def path() -> str:
    """Returns the path of the program: `GANTRY_TAU`, that of the wheel, or the one of the `PATH`."""
    named = os.environ.get("GANTRY_TAU")
    if named:
        return named
    of_wheel = os.path.join(sysconfig.get_path("scripts"), NAME)
    found = of_wheel if os.path.exists(of_wheel) else shutil.which("gantry-tau")
    if found is None:
        raise ProgramFailed("the program gantry-tau is neither in this environment nor in the PATH; the variable GANTRY_TAU may name it")
    return found


def run(*arguments: str) -> tuple[int, str]:
    """Runs a command to its end. Returns its exit code, 0 or 3 (done, and to be doubted), and what it printed."""
    ended = subprocess.run([path(), *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if ended.returncode not in (0, 3):
        raise ProgramFailed(sentence(ended.stderr) or f"exit code {ended.returncode}")
    return ended.returncode, ended.stdout


def sentence(said: str) -> str:
    """Returns what the program says of an error, without its name and the hint at its help."""
    lines = [line for line in said.strip().splitlines() if line and not line.startswith("For more information")]
    return "\n".join(lines).removeprefix("gantry-tau: ").removeprefix("error: ")


class Solver:
    """Kinematics, statics and dynamics of a machine, by `gantry-tau solve`: one line of JSON in, one out.

    `robot` is "l2", "f1" or the path of a robot file, `program` that of `gantry-tau`.
    """

    def __init__(self, robot: str | os.PathLike[str] = "l2", program: str | None = None):
        self.robot = os.fspath(robot)
        # In a session of its own: Ctrl-C is for the caller, whose end ends the solver as well.
        self._process = subprocess.Popen([program or path(), "solve"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         start_new_session=True)
        assert self._process.stdin and self._process.stdout
        self._questions, self._answers = self._process.stdin, self._process.stdout
        self._lock = threading.Lock()

    def ask(self, op: str, **arguments: object) -> dict:
        """Returns the answer to a question; raises `SolveError` if there is none."""
        return self.ask_all([{"op": op, **arguments}])[0]

    def ask_all(self, questions: Iterable[dict]) -> list[dict]:
        """Returns the answers to many questions, in their order. A `SolveError` has the number of its question, `index`."""
        lines = [json.dumps({"robot": self.robot, **question}).encode() + b"\n" for question in questions]
        with self._lock:
            # Beside the reading: neither pipe has room for all.
            writer = threading.Thread(target=self._write, args=(lines,), daemon=True)
            writer.start()
            answers = [self._answers.readline() for _ in lines]
            writer.join()
        return [_result(index, answer) for index, answer in enumerate(answers)]

    def _write(self, lines: list[bytes]) -> None:
        try:
            self._questions.writelines(lines)
            self._questions.flush()
        except OSError:
            pass  # The program has ended, which its reader finds.

    def close(self) -> None:
        """Ends the program."""
        self._questions.close()
        self._answers.close()
        self._process.wait()

    def __enter__(self) -> Solver:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _result(index: int, line: bytes) -> dict:
    if not line:
        raise ProgramFailed("gantry-tau solve has ended")
    answer = json.loads(line)
    if "ok" in answer:
        return answer["ok"]
    failure = SolveError(answer["error"]["kind"], answer["error"]["message"])
    failure.index = index
    raise failure
