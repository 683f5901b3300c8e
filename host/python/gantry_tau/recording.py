"""Recordings (`--record` of serve, client, demo and monitor) as numpy arrays."""

from __future__ import annotations

import csv
import json
import os
import subprocess

from typing import TYPE_CHECKING

from .program import ProgramFailed, path as program_path

if TYPE_CHECKING:
    from pandas import DataFrame

# Ends of names, the longest first, and what they stand for.
UNITS = {"_um_s": "um/s", "_permille": "permille", "_n_m": "N m", "_nm": "nm", "_um": "um", "_mm": "mm", "_rad": "rad", "_ms": "ms",
         "_s": "s", "_n": "N", "_m": "m", "tick": "ticks", "ticks_left": "ticks"}
# Texts of numbers that JSON has none for.
NOT_FINITE = {"nan": float("nan"), "inf": float("inf"), "-inf": float("-inf"), None: float("nan")}


class Recording(dict):
    """Columns by their names, numpy arrays with one entry per row in the first dimension.

    Of a CSV file names are those of its header; of LabComm and MCAP they are sample and field, "axes.axis.nominal_nm", with the axes in the second
    dimension. Rows of one sample belong together.
    """

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns whose name has one."""
        found = {name: next((unit for end, unit in UNITS.items() if name.endswith(end)), None) for name in self}
        return {name: unit for name, unit in found.items() if unit}

    def frame(self, sample: str | None = None) -> DataFrame:
        """Returns a table of pandas, of one sample where there are several. Its index is the tick."""
        import pandas

        columns = {}
        for name, array in self.items():
            if sample is None or name.startswith(sample + "."):
                short = name if sample is None else name[len(sample) + 1:]
                flat = array.reshape(len(array), -1)
                columns.update({short: flat[:, 0]} if array.ndim == 1 else {f"{short}_{i + 1}": flat[:, i] for i in range(flat.shape[1])})
        lengths = {len(column) for column in columns.values()}
        if len(lengths) > 1:
            names = sorted({name.split(".")[0] for name in self})
            raise ValueError(f"samples have different numbers of rows; name one of {', '.join(names)}")
        return pandas.DataFrame(columns).set_index("tick")


def read(path: str | os.PathLike[str]) -> Recording:
    """Reads a recording, its format by its extension: .csv, .labcomm (which `gantry-tau` decodes), or .mcap (with PyPI's `mcap`).

    An incomplete last row, of a program that was killed, is left out.
    """
    path = os.fspath(path)
    readers = {".csv": _csv, ".labcomm": _labcomm, ".mcap": _mcap}
    extension = os.path.splitext(path)[1]
    if extension not in readers:
        raise ValueError(f"{path}: a recording is a file of {', '.join(readers)}")
    return Recording(readers[extension](path))


def _csv(path: str) -> dict:
    import numpy

    with open(path, newline="") as file:
        rows = csv.reader(file)
        header = next(rows, None)
        if header is None:
            raise ValueError(f"{path}: the file is empty")
        whole = [row for row in rows if len(row) == len(header)]
    columns = zip(*whole) if whole else [()] * len(header)
    return {name: _array(numpy, column) for name, column in zip(header, columns)}


def _array(numpy, column):
    """Whole numbers if all are, numbers if all are or are missing, texts otherwise."""
    try:
        return numpy.array([int(text) for text in column], dtype=numpy.int64)
    except (ValueError, OverflowError):
        pass
    try:
        return numpy.array([float(text) if text else float("nan") for text in column])
    except ValueError:
        return numpy.array(column)


def _labcomm(path: str) -> dict:
    decoder = subprocess.Popen([program_path(), "labcomm", "decode", path], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    samples: dict[str, list[dict]] = {}
    error = None
    assert decoder.stdout
    with decoder:
        for line in decoder.stdout:
            event = json.loads(line)
            if "sample" in event:
                samples.setdefault(event["sample"], []).append(event["value"])
            error = event.get("error", error)
    if error and error["kind"] != "incomplete":
        raise ValueError(f"{path}: {error['message']}")
    if decoder.returncode and not error:
        raise ProgramFailed(f"{path}: gantry-tau labcomm decode: exit code {decoder.returncode}")
    return _columns(samples)


def _mcap(path: str) -> dict:
    try:
        from mcap.reader import make_reader
    except ImportError as missing:
        raise ImportError("recordings as MCAP need the package mcap: pip install mcap") from missing
    samples: dict[str, list[dict]] = {}
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic != "/scene":
                samples.setdefault(channel.topic.strip("/"), []).append(json.loads(message.data))
    return _columns(samples)


def _columns(samples: dict[str, list[dict]]) -> dict:
    import numpy

    columns = {}

    def take(name, values):
        first = values[0]
        if isinstance(first, dict):
            for field in first:
                take(f"{name}.{field}", [value[field] for value in values])
        elif isinstance(first, list) and first and isinstance(first[0], dict):
            for field in first[0]:
                take(f"{name}.{field}", [[part[field] for part in value] for value in values])
        else:
            columns[name] = numpy.array(_numbers(values))

    for name, values in samples.items():
        take(name, values)
    return columns


def _numbers(values):
    """Values with numbers for the texts of those that are not finite; other texts as they are."""
    if isinstance(values, list):
        return [_numbers(value) for value in values]
    return NOT_FINITE.get(values, values) if isinstance(values, str) or values is None else values
