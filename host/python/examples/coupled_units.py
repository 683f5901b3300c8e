#!/usr/bin/env python3
"""Server and machine as functional mock-up units, coupled cycle by cycle (`pip install fmpy`).

    gantry-tau fmu l2 --kind server -o server.fmu
    gantry-tau fmu l2 --kind machine -o machine.fmu
    coupled_units.py server.fmu machine.fmu

The client tares its sensor for a second; then the tool is pulled with 300 N in x, and at the end the cable is pulled.
"""
import sys

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

CYCLE_S = 1e-3


class Unit:
    """A unit that is read and written by the names of its variables."""

    def __init__(self, path):
        description = read_model_description(path)
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.slave = FMU2Slave(guid=description.guid, unzipDirectory=extract(path), instanceName=path,
                               modelIdentifier=description.coSimulation.modelIdentifier)
        self.slave.instantiate()
        self.slave.setupExperiment()
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def all(self, name):
        """Value references of `name[1]`, `name[2]` and so on."""
        return [reference for known, reference in self.references.items() if known.startswith(f"{name}[")]

    def connect(self, name, source, output):
        """Gives an input the values of an output of another unit."""
        self.slave.setReal(self.all(name), source.slave.getReal(source.all(output)))


def main(server_path, machine_path):
    server, machine = Unit(server_path), Unit(machine_path)
    for tick in range(5_000):
        time = tick * CYCLE_S
        if tick == 1_500:
            machine.slave.setReal(machine.all("load_force"), [300.0, 0.0, 0.0])
        if tick == 4_000:
            server.slave.setBoolean([server.references["cable"]], [False])
        # The server first: its references act in the machine's cycle, as with `gantry-tau serve`.
        for name in ("nominal", "force", "moment"):
            server.connect(name, machine, name)
        server.slave.doStep(time, CYCLE_S)
        for name in ("reference", "offset"):
            machine.connect(name, server, name)
        machine.slave.doStep(time, CYCLE_S)
        if (tick + 1) % 500 == 0:
            phase = server.slave.getInteger([server.references["phase"]])[0]
            offsets = ", ".join(f"{1e6 * m:8.3f}" for m in server.slave.getReal(server.all("offset")))
            moved = ", ".join(f"{1e6 * m:6.1f}" for m in machine.slave.getReal(machine.all("displacement")))
            print(f"{time + CYCLE_S:.1f} s: phase {phase}, offsets [{offsets}] um, tool moved by [{moved}] um")
    for unit in (server, machine):
        unit.slave.terminate()
        unit.slave.freeInstance()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(f"expected two files\n{__doc__}")
    main(*sys.argv[1:])
