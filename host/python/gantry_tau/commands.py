"""Springs and geometry from measurements: the commands `identify` and `calibrate`, with their files."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from typing import NamedTuple

from .program import run


class Found(NamedTuple):
    """Result of a command. Its robot file is written."""

    robot_file: str   # path
    answer: dict      # parameters, intervals, covariance and more: `--json` of the command
    is_doubted: bool  # True: not to be trusted as it is, for the reasons in `text`
    text: str         # what the command says


def identify(setup: str | os.PathLike[str], output: str | os.PathLike[str], *, robot: str | os.PathLike[str] = "l2", **options: object) -> Found:
    """Finds springs, or the weight of the tool, from the measurements of a set-up, and writes the robot file `output`.

    Options are those of `gantry-tau identify`: `raw="ticks.csv"`, `report="page.html"`, `scale=True`, `overwrite=True` and so on.
    Raises `ProgramFailed` with the reason where nothing is written.
    """
    return _learned("identify", setup, output, robot, options)


def calibrate(poses: str | os.PathLike[str], output: str | os.PathLike[str], *, robot: str | os.PathLike[str] = "l2", **options: object) -> Found:
    """Finds the geometry from measured poses, and writes the robot file `output`.

    Options are those of `gantry-tau calibrate`: `guideways="parallel"`, `target=(0, 0, 0.1)`, `tolerance=0.2`, `overwrite=True` and so on.
    Raises `ProgramFailed` with the reason where nothing is written.
    """
    return _learned("calibrate", poses, output, robot, options)


def _learned(command: str, setup: str | os.PathLike[str], output: str | os.PathLike[str], robot: str | os.PathLike[str], options: dict) -> Found:
    with tempfile.TemporaryDirectory() as folder:
        answer = os.path.join(folder, "answer.json")
        arguments = [os.fspath(setup), f"--robot={os.fspath(robot)}", f"--output={os.fspath(output)}", f"--json={answer}"]
        code, text = run(command, *arguments, *_options(options))
        with open(answer) as file:
            return Found(os.fspath(output), json.load(file), code == 3, text)


def _options(options: dict) -> Iterator[str]:
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is True:
            yield option
        elif value not in (False, None):
            values = value if isinstance(value, (list, tuple)) else [value]
            yield f"{option}={','.join(os.fspath(one) if isinstance(one, os.PathLike) else str(one) for one in values)}"
