"""Every unit is valid, has units, ranges, starts and descriptions, and runs in FMPy's master.

    of_validity.py PROGRAM
"""

import sys
import zipfile

import numpy as np
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu

import units

KINDS = ("server", "machine", "compensator")


def judge(path):
    found = validate_fmu(str(path))
    assert not found, found
    description = read_model_description(str(path), validate=True)
    cs = description.coSimulation
    assert cs.canGetAndSetFMUstate and cs.canHandleVariableCommunicationStepSize and not cs.canSerializeFMUstate
    for variable in description.modelVariables:
        assert variable.description, variable.name
        if variable.causality != "output":
            assert variable.start is not None, variable.name
        if variable.type == "Real" and not variable.name.startswith(("torque", "turn")):
            assert variable.unit, variable.name
            assert float(variable.min) < float(variable.max), variable.name
    names = zipfile.ZipFile(path).namelist()
    assert names[0] == "modelDescription.xml" and "resources/robot.toml" in names, names


def simulate(path, kind):
    inputs = {"server": "force[1]", "machine": "load_force[1]", "compensator": "force[1]"}
    signal = np.array([(0.0, 0.0), (1.1, 0.0), (1.1, 30.0), (2.0, 30.0)], dtype=[("time", float), (inputs[kind], float)])
    result = simulate_fmu(str(path), stop_time=2.0, output_interval=0.004, input=signal)
    assert len(result) == 501, len(result)
    moved = {"server": "offset[1]", "machine": "displacement[1]", "compensator": "target[1]"}[kind]
    before, after = result[moved][result["time"] < 1.0], result[moved][-1]
    print(f"{kind}: {moved} {after * 1e6:.3f} um under 30 N")
    if kind != "machine":
        assert np.all(before == 0.0)
    assert abs(after) > 1e-6
    return result


def main(program):
    with units.folder() as folder:
        for robot in ("l2", "f1"):
            for kind in KINDS:
                path = units.write(program, folder, kind, robot)
                judge(path)
                # The same bytes each time.
                first = path.read_bytes()
                assert units.write(program, folder, kind, robot).read_bytes() == first
                result = simulate(path, kind)
                again = simulate(path, kind)
                assert result.tobytes() == again.tobytes()


main(*sys.argv[1:])
