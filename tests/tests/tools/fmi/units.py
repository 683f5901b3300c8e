"""Units of gantry-tau as FMPy loads them."""

import subprocess
import sys
import tempfile
from pathlib import Path

from fmpy import extract, read_model_description
from fmpy.fmi2 import (FMU2Slave, fmi2CallbackAllocateMemoryTYPE, fmi2CallbackFreeMemoryTYPE, fmi2CallbackFunctions,
                       fmi2CallbackLoggerTYPE, fmi2StepFinishedTYPE)

CYCLE = 1e-3


def write(program, folder, kind, robot="l2"):
    """Writes a unit; returns its path."""
    path = Path(folder) / f"{Path(robot).stem}-{kind}.fmu"
    subprocess.run([program, "fmu", robot, "--kind", kind, "-o", path], check=True, stdout=subprocess.DEVNULL)
    return path


class Unit:
    """An instance, read and written by names. `said` has what its logger was told."""

    def __init__(self, path, name="unit", guid=None, extracted=None):
        self.description = read_model_description(str(path), validate=True)
        self.folder = extracted or extract(str(path))
        self.references = {v.name: v for v in self.description.modelVariables}
        self.said = []
        self.slave = FMU2Slave(guid=guid or self.description.guid, unzipDirectory=self.folder,
                               modelIdentifier=self.description.coSimulation.modelIdentifier, instanceName=name)
        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(self.hear)
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(lambda n, size: None)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(lambda pointer: None)
        callbacks.stepFinished = fmi2StepFinishedTYPE(lambda *_: None)
        self.callbacks = callbacks
        self.slave.instantiate(callbacks=callbacks)

    def hear(self, environment, name, status, category, message):
        self.said.append((status, message.decode()))

    def begin(self, start=0.0, stop=None, **values):
        self.slave.setupExperiment(startTime=start, stopTime=stop)
        for name, value in values.items():
            self.set(name, value)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        self.time = start
        return self

    def set(self, name, value):
        variable = self.references[name]
        setter = {"Real": self.slave.setReal, "Boolean": self.slave.setBoolean}.get(variable.type, self.slave.setInteger)
        setter([variable.valueReference], [value])

    def get(self, name):
        variable = self.references[name]
        getter = {"Real": self.slave.getReal, "Boolean": self.slave.getBoolean}.get(variable.type, self.slave.getInteger)
        return getter([variable.valueReference])[0]

    def vector(self, name, count):
        return self.slave.getReal([self.references[f"{name}[{i + 1}]"].valueReference for i in range(count)])

    def set_vector(self, name, values):
        references = [self.references[f"{name}[{i + 1}]"].valueReference for i in range(len(values))]
        self.slave.setReal(references, list(values))

    def step(self, cycles=1):
        self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=cycles * CYCLE)
        self.time += cycles * CYCLE

    def outputs(self):
        """Every output, as bits."""
        names = [v.name for v in self.description.modelVariables if v.causality == "output"]
        return [float(self.get(name)).hex() for name in names]


class Coupled:
    """Server and machine, with the machine first in each cycle."""

    def __init__(self, server, machine, axes):
        self.server, self.machine, self.axes = server, machine, axes

    def machine_step(self, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0)):
        for name in ("reference", "offset", "velocity_offset", "torque_offset"):
            self.machine.set_vector(name, self.server.vector(name, self.axes))
        self.machine.set_vector("load_force", force)
        self.machine.set_vector("load_moment", moment)
        self.machine.step()

    def server_step(self, cable=True):
        self.server.set_vector("nominal", self.machine.vector("nominal", self.axes))
        for name in ("force", "moment"):
            self.server.set_vector(name, self.machine.vector(name, 3))
        self.server.set("machine_ok", self.machine.get("ok"))
        self.server.set("cable", cable)
        self.server.step()


def refused(call, *arguments, **named):
    """Makes a call that must be an error."""
    try:
        call(*arguments, **named)
    except Exception as error:  # what FMPy raises for a status beyond a warning
        return error
    sys.exit(f"taken: {call} {arguments} {named}")


def folder():
    return tempfile.TemporaryDirectory(prefix="gantry-tau-fmi-")
