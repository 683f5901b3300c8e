"""A restored unit does the same again, to the bit; two instances in one process do not know each other.

    of_states.py PROGRAM
"""

import ctypes
import sys

import units

INPUT = {"server": "force[1]", "machine": "load_force[1]", "compensator": "force[1]"}


def run(unit, kind, first, last):
    """Outputs of each tenth cycle, with an input that changes in every one."""
    seen = []
    for tick in range(first, last):
        unit.set(INPUT[kind], float(tick % 97 - 40))
        unit.step()
        if tick % 10 == 0:
            seen.append(unit.outputs())
    return seen


def restored(path, kind):
    unit = units.Unit(path).begin()
    run(unit, kind, 0, 1_400)
    state, time = unit.slave.getFMUState(), unit.time
    first = run(unit, kind, 1_400, 2_000)
    for _ in range(2):
        unit.slave.setFMUState(state)
        unit.time = time
        assert run(unit, kind, 1_400, 2_000) == first
    # The same place again, as the standard permits.
    unit.slave.fmi2GetFMUstate(unit.slave.component, ctypes.byref(state))
    unit.slave.freeFMUState(state)
    assert not state.value
    unit.slave.reset()
    unit.begin()
    fresh = units.Unit(path).begin()
    assert run(unit, kind, 0, 50) == run(fresh, kind, 0, 50)
    for each in (unit, fresh):
        each.slave.terminate()
        each.slave.freeInstance()


def apart(paths):
    kinds = ("server", "machine", "compensator")
    alone = {}
    for kind, path in zip(kinds, paths):
        unit = units.Unit(path).begin()
        alone[kind] = run(unit, kind, 0, 1_200)
        unit.slave.freeInstance()
    folders = {kind: units.extract(str(path)) for kind, path in zip(kinds, paths)}
    both = {kind: [units.Unit(path, name, extracted=folders[kind]).begin() for name in "ab"]
            for kind, path in zip(kinds, paths)}
    seen = {kind: ([], []) for kind in kinds}
    for tick in range(1_200):
        for kind in kinds:
            first, second = both[kind]
            seen[kind][0].extend(run(first, kind, tick, tick + 1))
            # Its own inputs, and steps of two cycles.
            second.set(INPUT[kind], float(tick % 13) * 3.0)
            second.step(2)
    for kind in kinds:
        assert seen[kind][0] == alone[kind], kind
        a, b = both[kind]
        assert a.outputs() != b.outputs()
        # A state of one is not one of the other.
        state = a.slave.getFMUState()
        units.refused(b.slave.setFMUState, state)
        assert "state is unknown" in b.said[-1][1], b.said
        a.slave.freeInstance()
        b.step()
        b.slave.freeInstance()


def main(program):
    with units.folder() as folder:
        paths = [units.write(program, folder, kind) for kind in ("server", "machine", "compensator")]
        for path, kind in zip(paths, ("server", "machine", "compensator")):
            restored(path, kind)
        apart(paths)
        print("restored to the bit, and apart")


main(*sys.argv[1:])
