"""Kinematics and statics of a machine, on numpy arrays."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Callable

from .program import SolveError, Solver

if TYPE_CHECKING:
    from numpy import ndarray
    from numpy.typing import ArrayLike


class Machine:
    """A machine: "l2", "f1" (built in), or the path of a robot file.

    Every method takes one pose or many: leading dimensions of its arguments are broadcast, and are those of its
    results. Units are SI; `q` counts in the robot file's units of the drives (`metres_per_q`). Frames and equations: docs/kinematics.md.

    | argument | shape | meaning |
    |---|---|---|
    | `T` | (..., 3) | tool centre point, world axes, m |
    | `R` | (..., 3, 3) | world axes from platform axes, rows; the identity if absent |
    | `q` | (..., axes) | drive coordinates |
    | `w` | (..., 6) | force (N) and moment about the tool centre point (N m), world axes, of the environment on the platform |

    Numbers are those of `gantry-tau solve`, to the bit. A pose without an answer raises `SolveError`; its `index` counts the poses in order of
    rows. A robot file that cannot be used raises it at once.
    """

    def __init__(self, robot: str | os.PathLike[str] = "l2"):
        self._solver = Solver(robot)
        try:
            self._solver.ask("ik", T=[0.0, 0.0, 0.0])
        except SolveError as failure:
            # Whether that place is within reach does not matter.
            if failure.kind == "bad_robot":
                self._solver.close()
                raise

    def fk(self, q: ArrayLike) -> tuple[ndarray, ndarray]:
        """Returns `T` and `R` of the drive coordinates."""
        answers = self._ask("fk", q=(q, 1))
        return answers("T"), answers("R")

    def ik(self, T: ArrayLike, R: ArrayLike | None = None) -> ndarray:
        """Returns the drive coordinates of a pose."""
        return self._ask("ik", T=(T, 1), R=(R, 2))("q")

    def jacobian(self, T: ArrayLike, R: ArrayLike | None = None) -> ndarray:
        """Returns dx/dq, one column per axis: 3x3 of an L2, the velocity of the tool centre point (world axes, m per q-unit); 6x6 of an F1, with
        the angular velocity (rad per q-unit) below it."""
        return self._ask("jacobian", T=(T, 1), R=(R, 2))("J")

    def compliance(self, T: ArrayLike, R: ArrayLike | None = None) -> ndarray:
        """Returns the compliance of the tool, 6x6: displacement (m, rad) per force (N) and moment (N m)."""
        return self._ask("compliance", T=(T, 1), R=(R, 2))("C")

    def deflection(self, T: ArrayLike, w: ArrayLike, R: ArrayLike | None = None) -> ndarray:
        """Returns the displacement of the tool under a load, (..., 6): m, and a rotation vector in rad. With the drives held."""
        return self._ask("deflection", T=(T, 1), w=(w, 1), R=(R, 2))("dx_total")

    def compensate(self, T: ArrayLike, w: ArrayLike, R: ArrayLike | None = None) -> ndarray:
        """Returns the drive coordinates that hold the tool at `T`, `R` under the load."""
        return self._ask("compensate", T=(T, 1), w=(w, 1), R=(R, 2))("q")

    def close(self) -> None:
        """Ends the program behind it."""
        self._solver.close()

    def __enter__(self) -> Machine:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, op: str, **arguments: tuple[ArrayLike | None, int]) -> Callable[[str], ndarray]:
        """Asks for every pose. Arguments come with the number of dimensions of one."""
        import numpy

        given = {name: (numpy.asarray(value, dtype=float), own) for name, (value, own) in arguments.items() if value is not None}
        for name, (array, own) in given.items():
            if array.ndim < own:
                raise ValueError(f"{name} has {array.ndim} dimensions, and needs {own}")
            if not numpy.isfinite(array).all():
                raise ValueError(f"{name}: not all numbers are finite")
        shape = numpy.broadcast_shapes(*(array.shape[:array.ndim - own] for array, own in given.values()))
        rows = {name: numpy.broadcast_to(array, shape + array.shape[array.ndim - own:]).reshape(-1, *array.shape[array.ndim - own:]).tolist()
                for name, (array, own) in given.items()}
        count = int(numpy.prod(shape))
        answers = self._solver.ask_all({"op": op, **{name: values[index] for name, values in rows.items()}} for index in range(count))

        def result(name: str) -> ndarray:
            array = numpy.array([answer[name] for answer in answers], dtype=float)
            return array.reshape(shape + array.shape[1:])

        return result
