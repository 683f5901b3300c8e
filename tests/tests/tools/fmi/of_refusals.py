"""What a master must not do is an error with a text, and never a crash.

    of_refusals.py PROGRAM
"""

import ctypes
import math
import subprocess
import sys
from pathlib import Path

import units

ERROR = 3


def said(unit, *parts):
    status, text = unit.said[-1]
    assert status == ERROR and all(part in text for part in parts), unit.said[-3:]


def values(path):
    unit = units.Unit(path).begin()
    slave = unit.slave
    for name, value in (("force[2]", math.nan), ("nominal[1]", math.inf), ("moment[3]", 1e9)):
        units.refused(unit.set, name, value)
        said(unit, name, "expected from")
    # It goes on.
    unit.step()
    for reference in (10_000, 2**32 - 1):
        for call in (slave.getReal, slave.getInteger, slave.getBoolean):
            units.refused(call, [reference])
            said(unit, f"value reference {reference}: unknown")
    units.refused(slave.setReal, [unit.references["offset[1]"].valueReference], [0.0])
    said(unit, "offset[1]: is an output")
    units.refused(slave.getReal, [unit.references["phase"].valueReference])
    said(unit, "phase: is an Integer, not a Real")
    units.refused(slave.setBoolean, [unit.references["cable"].valueReference], [7])
    said(unit, "cable: is 7")
    units.refused(slave.getString, [0])
    # Pointers that lead nowhere, and lengths that no array has.
    get, component = slave.dll.fmi2GetReal, slave.component
    get.argtypes, get.restype = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p], ctypes.c_int
    number, real = (ctypes.c_uint * 1)(0), (ctypes.c_double * 1)()
    assert get(component, None, 1, real) == ERROR
    said(unit, "value references: is null")
    assert get(component, number, 1, None) == ERROR
    said(unit, "values: is null")
    assert get(component, number, 2**63, real) == ERROR
    assert get(component, None, 0, None) == 0
    slave.freeInstance()


def order(path):
    unit = units.Unit(path)
    slave = unit.slave
    for call in (slave.exitInitializationMode, slave.terminate):
        units.refused(call)
        said(unit, "before its initialization")
    units.refused(slave.doStep, 0.0, 1e-3)
    units.refused(slave.getReal, [0])
    units.refused(slave.setupExperiment, startTime=math.nan)
    said(unit, "start time NaN")
    unit.begin(stop=1.0)
    for length in (0.0, 0.0005, 0.0015, -0.001, math.nan, math.inf, 1e300):
        units.refused(slave.doStep, 0.0, length)
        said(unit, "expected a whole multiple of 0.001 s")
    units.refused(slave.doStep, 0.5, 1e-3)
    said(unit, "the unit is at 0 s")
    units.refused(slave.doStep, 0.0, 1.001)
    said(unit, "ends at 1 s")
    slave.doStep(0.0, 1.0)
    units.refused(slave.setReal, [unit.references["nominal[1]"].valueReference], [math.nan])
    slave.terminate()
    units.refused(slave.doStep, 1.0, 1e-3)
    said(unit, "terminated")
    slave.reset()
    unit.begin()
    unit.step(3)
    # Freed, and used again: FMPy unloads the library, so the calls are made by hand.
    component, dll = slave.component, slave.dll
    dll.fmi2FreeInstance.argtypes, dll.fmi2FreeInstance.restype = [ctypes.c_void_p], None
    dll.fmi2Terminate.argtypes, dll.fmi2Terminate.restype = [ctypes.c_void_p], ctypes.c_int
    dll.fmi2FreeInstance(component)
    for gone in (component, None, 12345):
        assert dll.fmi2Terminate(gone) == ERROR
        dll.fmi2FreeInstance(gone)
    # Nothing at all, and what is missing of it.
    create = dll.fmi2Instantiate
    create.argtypes = [ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p, ctypes.c_void_p, ctypes.c_int, ctypes.c_int]
    create.restype = ctypes.c_void_p
    callbacks, guid = ctypes.addressof(unit.callbacks), unit.description.guid.encode()
    where = (Path(unit.folder) / "resources").as_uri().encode()
    for arguments, part in (
        ((None, 1, None, None, None), None),
        ((b"a", 1, guid, where, None), None),
        ((None, 1, guid, where, callbacks), "instance name: is null"),
        ((b"", 1, guid, where, callbacks), "instance name: is empty"),
        ((b"a", 0, guid, where, callbacks), "type: expected co-simulation"),
        ((b"a", 1, None, where, callbacks), "GUID: is null"),
        ((b"a", 1, guid, None, callbacks), "resource location: is null"),
        ((b"a", 1, guid, b"http://example.org", callbacks), "file:"),
        ((b"\xff", 1, guid, where, callbacks), "instance name: is not UTF-8"),
    ):
        assert create(*arguments, 0, 0) is None, arguments
        if part:
            said(unit, part)
    made = create(b"a", 1, guid, where, callbacks, 0, 0)
    assert made
    dll.fmi2FreeInstance(made)


def creation(program, folder, path):
    wrong = "{8c4e810f-3df3-4a00-8276-176fa3c9f9e0}"

    def create(**arguments):
        """A unit that is refused, by the text of its logger."""
        heard = []
        original = units.Unit.hear

        def hear(self, environment, name, status, category, message):
            heard.append(message.decode())

        units.Unit.hear = hear
        try:
            units.refused(units.Unit, path, **arguments)
        finally:
            units.Unit.hear = original
        return heard[-1]

    assert "the description is of another unit" in create(guid=wrong)
    other = "{server-3-00000000}"
    assert "the description is of another unit" in create(guid=other)
    extracted = Path(units.extract(str(path)))
    robot = extracted / "resources" / "robot.toml"
    text = robot.read_text()
    robot.unlink()
    assert "robot.toml" in create(extracted=str(extracted))
    f1 = Path(__file__).resolve().parents[4] / "robots" / "f1.toml"
    robot.write_text(f1.read_text())
    assert "another number of axes" in create(extracted=str(extracted))
    robot.write_text(text.replace("cutoff_hz = 6.0", "cutoff_hz = -6.0"))
    assert "cutoff_hz" in create(extracted=str(extracted))
    robot.write_text(text[:len(text) // 2])
    assert "robot.toml" in create(extracted=str(extracted))
    robot.write_text(text)
    units.Unit(path, extracted=str(extracted)).slave.freeInstance()


def command(program, folder):
    """The command, too, refuses in one sentence."""
    for arguments, part in (
        (["fmu", "l2", "--kind", "server", "-o", "l2.svg"], "whose name does not end in .svg"),
        (["fmu", "l2", "--kind", "server", "--library", __file__, "-o", "l2.fmu"], "is not the library of gantry-tau units"),
        (["fmu", "l2", "--kind", "server", "--library", "none.so", "-o", "l2.fmu"], "none.so"),
        (["fmu", "none.toml", "--kind", "server", "-o", "l2.fmu"], "none.toml"),
    ):
        ended = subprocess.run([program, *arguments], cwd=folder, text=True, capture_output=True)
        assert ended.returncode == 1 and part in ended.stderr, ended
    assert not (Path(folder) / "l2.fmu").exists()


def main(program):
    with units.folder() as folder:
        path = units.write(program, folder, "server")
        values(path)
        order(path)
        creation(program, folder, path)
        command(program, folder)
        print("refused, each with a text")


main(*sys.argv[1:])
