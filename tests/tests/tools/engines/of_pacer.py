"""The pacer's latency, by SciPy's interpolation of the same targets: of_pacer.py PROGRAM ROBOT.toml. Needs scipy and numpy."""

import os
import subprocess
import sys
import tempfile

PROGRAM, ROBOT = sys.argv[1:]
os.environ["GANTRY_TAU"] = PROGRAM
sys.path.insert(0, os.path.join(os.path.dirname(__file__), "../../../../host/python"))
import numpy
from scipy.interpolate import interp1d

from gantry_tau import Session, recording

LATENCY_S = 0.066
TICK_S = 1e-3
MAX_SLOPE_UM_S = 20.0   # A corner of two such slopes is within the limit of the change of change.
TARGETS = 30
ROUNDING_NM = 1.0       # Of a target, and of an offset.


def main():
    random = numpy.random.default_rng(33)
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/run.csv"
        serve = [PROGRAM, "serve", "--pace", "lockstep", "--listen", "127.0.0.1:0", "--robot", ROBOT, "--force-max", "0", "--record", path]
        environment = {**os.environ, "STATE_DIRECTORY": folder}
        server = subprocess.Popen(serve, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment)
        address = server.stdout.readline().split()[2].rstrip(",;")
        with Session(address, robot=ROBOT, latency_s=LATENCY_S, hold_s=60.0, give_up_s=100.0) as session:
            times, offsets_um = play(session, random)
            while session.wait().t < times[-1] + 2 * LATENCY_S:
                pass
            assert not session.refused and session.state.limited == 0, (session.refused, session.state)
        server.terminate()
        server.wait()
        judge(recording.read(path), times, offsets_um)


def play(session, random):
    """Sends targets at uneven times, in no order, and returns them in order."""
    axes = len(session.state.offset_um)
    times, offsets_um = [1.0], [numpy.zeros(axes)]
    for _ in range(TARGETS - 1):
        step_s = random.uniform(0.02, 0.25)
        times.append(times[-1] + step_s)
        offsets_um.append(offsets_um[-1] + random.uniform(-1.0, 1.0, axes) * MAX_SLOPE_UM_S * step_s)
    # Zero, for the offsets begin there when the first target comes.
    session.target(offsets_um[0], t=session.state.t + 1.0)
    begin = session.state.t + 1.0
    times = numpy.round((numpy.array(times) + begin) / TICK_S) * TICK_S
    for index in random.permutation(TARGETS):
        session.target(offsets_um[index], t=times[index])
    return times, numpy.array(offsets_um)


def judge(run, times, offsets_um):
    at = (run["state"] == "Obtain") & (run["time_s"] > times[0] + LATENCY_S) & (run["time_s"] < times[-1] + LATENCY_S)
    assert at.sum() > 1000, "the targets were not played"
    expected = interp1d(times + LATENCY_S, offsets_um, axis=0)
    worst_nm = 0.0
    for axis in range(offsets_um.shape[1]):
        played_nm = run[f"offset_{axis + 1}_nm"][at]
        wanted_nm = 1e3 * expected(run["time_s"][at])[:, axis]
        worst_nm = max(worst_nm, abs(played_nm - wanted_nm).max())
    print(f"{at.sum()} ticks, at most {worst_nm:.1f} nm from the line, of {MAX_SLOPE_UM_S:.0f} nm per tick")
    assert worst_nm <= MAX_SLOPE_UM_S * TICK_S * 1e3 + 2 * ROUNDING_NM, worst_nm


main()
