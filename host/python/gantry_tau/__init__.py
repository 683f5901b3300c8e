"""Gantry-Tau parallel robots from Python.

| name | what it is |
|---|---|
| `main`, `run`, `arguments` and the rest of `gantry_tau.client` | a client of the server at its full rate, for a controller of your own; standard library only |
| `Session` | a session for a program that is slower: targets with times, played by `gantry-tau pace` |
| `Machine` | kinematics and statics of a machine, on numpy arrays |
| `recording.read` | a recording as numpy arrays |
| `identify`, `calibrate` | springs and geometry from measurements, as the commands of these names |

`Session`, `Machine`, `identify` and `calibrate` run the program `gantry-tau`, which the wheel brings with it.
"""

from . import client, recording
from .client import *  # noqa: F403: its public names are those of this package, so that it can be copied as one file
from .commands import calibrate, identify
from .machine import Machine
from .program import ProgramFailed, SolveError, Solver
from .session import Session

__all__ = [*client.__all__, "Machine", "ProgramFailed", "Session", "SolveError", "Solver", "calibrate", "client", "identify", "recording"]
