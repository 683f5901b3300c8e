"""Server and machine as units, coupled, equal `serve --pace lockstep` with `client`, tick by tick, to the bit.

    of_lockstep.py PROGRAM

Inputs of the units are what no tick decides: when the client's first word came, the load that pulled, and when the
client fell silent. All of it is in the recording of the server.
"""

import csv
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import units

PATIENCE = 300
# Ticks of the session.
TICKS = 12_000
MOTION_MM = 15
AXES = 3
PHASES = ["Listening", "Handshake", "Submit", "Obtain", "SafeDisconnect", "Fault"]
CAUSES = ["None", "ClientLate", "NetworkLate"]
LOAD = (("force_x_n", "force_y_n", "force_z_n"), ("moment_x_n_m", "moment_y_n_m", "moment_z_n_m"))


def rows(path):
    """Rows of a recording as far as they are written."""
    text = path.read_text() if path.exists() else ""
    return list(csv.DictReader(text[:text.rfind("\n") + 1].splitlines()))


def await_rows(path, found, *processes):
    until = time.monotonic() + PATIENCE
    while not found(now := rows(path)):
        assert all(process.poll() is None for process in processes), "server or client has ended"
        assert time.monotonic() < until, f"{len(now)} rows, the last: {now[-1] if now else None}"
        time.sleep(0.2)


def recorded(program, folder):
    """A session of force steps, of a client that falls silent."""
    path = Path(folder) / "run.csv"
    path.unlink(missing_ok=True)
    serve = subprocess.Popen(
        [program, "serve", "--pace", "lockstep", "--listen", "127.0.0.1:0", "--epoch-file", "epochs", "--first-run",
         "--motion", str(MOTION_MM), "--step-seconds", "1", "--record", path],
        cwd=folder, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
    client = None
    try:
        address = next(found.group(1) for line in serve.stdout if (found := re.search(r"listening on (\S+?)[;,]", line)))
        client = subprocess.Popen([program, "client", address], cwd=folder, stdin=subprocess.DEVNULL,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        await_rows(path, lambda now: sum(row["state"] == "Obtain" for row in now) > TICKS - 1_000, serve, client)
        client.send_signal(signal.SIGSTOP)
        await_rows(path, lambda now: now[-1]["state"] == "Listening", serve)
        serve.send_signal(signal.SIGINT)
        assert serve.wait(PATIENCE) == 0
    finally:
        for process in (client, serve):
            if process is not None:
                process.kill()
                process.wait()
    all_rows = rows(path)
    # A quit is a phase of its own, which no unit has.
    end = max(index for index, row in enumerate(all_rows) if row["state"] == "SafeDisconnect") + 50
    return all_rows[:end]


def nanometres(metres):
    return [round(m * 1e9) for m in metres]


def compare(coupled, row, tick):
    server, machine = coupled.server, coupled.machine
    found = {"state": PHASES[server.get("phase")], "cause": CAUSES[server.get("cause")],
             "missed": str(server.get("missed"))}
    for name, column in (("nominal", "nominal"), ("reference", "reference"), ("offset", "offset"), ("computed", "shadow")):
        of = machine if name == "nominal" else server
        for axis, nm in enumerate(nanometres(of.vector(name, AXES))):
            found[f"{column}_{axis + 1}_nm"] = str(nm)
    expected = {name: row[name] for name in found}
    assert found == expected, f"tick {tick}:\n{found}\n{expected}"
    displaced = [value * 1e6 for value in machine.vector("displacement", 3)]
    assert displaced == [float(row[f"displacement_{axis}_um"]) for axis in "xyz"], f"tick {tick}"


def solved(program, requests):
    lines = "".join(json.dumps(request) + "\n" for request in requests)
    answers = subprocess.run([program, "solve"], input=lines, text=True, check=True, capture_output=True).stdout
    return [json.loads(line)["ok"] for line in answers.splitlines()]


def compensated(program, samples):
    """Offsets of `solve compensate` for nominal positions and loads, nm."""
    places = solved(program, [{"id": 0, "robot": "l2", "op": "fk", "q": nominal} for nominal, *_ in samples])
    held = solved(program, [{"id": 0, "robot": "l2", "op": "compensate", "T": place["T"], "w": load}
                            for place, (_, load, _) in zip(places, samples)])
    for answer, (nominal, load, offsets) in zip(held, samples):
        expected = nanometres(corrected - q for corrected, q in zip(answer["q"], nominal))
        assert offsets == expected, f"{load}: {offsets} {expected}"


def main(program):
    with units.folder() as folder:
        # A client whose first answer takes 10 ms has a handshake of more than one tick, which the units do not have.
        for _ in range(5):
            session = recorded(program, folder)
            if sum(row["state"] == "Handshake" for row in session) == 1:
                break
        else:
            sys.exit("no client has answered within 10 ms")
        welcomed = next(index for index, row in enumerate(session) if row["state"] == "Handshake")
        silent = next(index for index, row in enumerate(session) if int(row["missed"]) > 0)
        paths = [units.write(program, folder, kind) for kind in ("server", "machine")]
        server = units.Unit(paths[0]).begin()
        machine = units.Unit(paths[1]).begin(motion=MOTION_MM * 1e-3)
        coupled = units.Coupled(server, machine, AXES)
        samples, ramp, before = [], [], None
        since = time.monotonic()
        for tick, row in enumerate(session):
            nominal = server.vector("nominal", AXES) if tick else None
            if tick:
                coupled.machine_step(*([float(row[name]) for name in names] for names in LOAD))
            coupled.server_step(welcomed <= tick < silent)
            compare(coupled, row, tick)
            offsets = nanometres(server.vector("offset", AXES))
            limited = any(server.get(f"limited[{axis + 1}]") for axis in range(AXES))
            if row["state"] == "Obtain" and tick % 100 == 50 and tick < silent and not limited:
                load = server.vector("load_force", 3) + server.vector("load_moment", 3)
                samples.append((nominal, load, offsets))
            if tick > silent:
                ramp.append((before, offsets))
            before = offsets
        took = time.monotonic() - since
        compensated(program, samples)
        for before, after in ramp:
            assert after == [nm - max(-100, min(100, nm)) for nm in before], (before, after)
        largest = max(abs(int(row[f"offset_{axis + 1}_nm"])) for row in session for axis in range(AXES))
        assert largest > 50_000 and len(samples) > 20 and len(session) - welcomed > 10_000
        print(f"{len(session)} ticks equal, offsets of up to {largest * 1e-3:.1f} um, {len(samples)} of them also those of "
              f"`solve compensate`, a ramp of 0.1 um/ms; {took / len(session) * 1e6:.0f} us per tick of both in Python")


main(*sys.argv[1:])
