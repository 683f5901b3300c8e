"""The wheel in a fresh environment, without Rust and without the repository: of_wheel.py ROOT WHEELS.

ROOT is the repository, WHEELS a folder with the wheel of numpy. Builds the wheel with maturin, installs it, and holds 300 N within 10 um with
a controller that pauses.
"""

import glob
import os
import re
import subprocess
import sys
import tempfile
import venv

ROOT, WHEELS = map(os.path.abspath, sys.argv[1:])
SETTLED_S = 0.7             # From a step of the force to the offsets that answer it: filter, latency and pauses.
HELD_UM = 10.0

JUDGE = f"""
import sys
import numpy
from gantry_tau import recording
run = recording.read(sys.argv[1])
time = run["time_s"]
force = numpy.linalg.norm([run[f"force_{{axis}}_n"] for axis in "xyz"], axis=0)
moved_um = numpy.linalg.norm([run[f"displacement_{{axis}}_um"] for axis in "xyz"], axis=0)
obtains = run["state"] == "Obtain"
steps = time[1:][abs(numpy.diff(force)) > 10.0]
since = time - numpy.array([max(steps[steps <= t], default=0.0) for t in time])
settled = obtains & (since > {SETTLED_S})
for level in numpy.unique(force[settled].round()):
    print(level, "N:", moved_um[settled & (force.round() == level)].max().round(2), "um")
loaded = settled & (force > 290.0)
assert loaded.sum() > 500, "300 N were not reached"
assert moved_um[loaded].max() < {HELD_UM}, moved_um[loaded].max()
"""


def main():
    with tempfile.TemporaryDirectory() as folder:
        wheel = build(folder)
        programs = install(folder, wheel)
        hold(folder, programs)


def build(folder):
    maturin = os.path.join(os.path.dirname(sys.executable), "maturin")
    subprocess.run([maturin, "build", "--profile", "dev", "--out", folder], cwd=os.path.join(ROOT, "host/python"), check=True)
    [wheel] = glob.glob(os.path.join(folder, "*.whl"))
    assert re.fullmatch(r"gantry_tau-[0-9.]+-py3-none-\w+\.whl", os.path.basename(wheel)), wheel
    return wheel


def install(folder, wheel):
    """Returns the folder of the programs of a new environment with the wheel."""
    venv.create(os.path.join(folder, "fresh"), with_pip=True)
    programs = os.path.join(folder, "fresh/bin")
    subprocess.run([os.path.join(programs, "pip"), "install", "-q", "--disable-pip-version-check", "--no-index", "--find-links", WHEELS, wheel],
                   check=True)
    return programs


def hold(folder, programs_folder):
    """Runs a server and the controller, and judges the recording."""
    work = os.path.join(folder, "work")
    os.mkdir(work)
    environment = {"PATH": f"{programs_folder}:/usr/bin:/bin", "STATE_DIRECTORY": work, "HOME": work}
    for name in ("slow_compensation.py", "load.py"):
        with open(os.path.join(ROOT, "host/python/examples", name)) as example, open(os.path.join(work, name), "w") as copy:
            copy.write(example.read())
    where = {"cwd": work, "env": environment, "text": True}
    server, address = serve(programs_folder, where, "--record", "run.csv")
    python = os.path.join(programs_folder, "python3")
    held = subprocess.run([python, "slow_compensation.py", address, "--seconds", "14"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, **where)
    server.terminate()
    server.wait()
    assert held.returncode == 0, held.stderr
    subprocess.run([python, "-c", JUDGE, "run.csv"], check=True, **where)
    run_page(python, programs_folder, where)


def run_page(python, programs_folder, where):
    """Runs the programs of docs/python.md in the folder with the recording, and compares what they print."""
    with open(os.path.join(ROOT, "docs/python.md")) as page:
        programs = re.findall(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```$", page.read(), re.DOTALL | re.MULTILINE)
    assert len(programs) == 3, "the programs of docs/python.md, with what they print"
    server, address = serve(programs_folder, where)
    for program, shown in programs:
        program = program.replace("127.0.0.1:7000", address)
        said = subprocess.run([python, "-c", program], stdout=subprocess.PIPE, check=True, **where).stdout
        rest = said
        for piece in re.split(r"\.\.\.|\n", shown):
            assert piece.strip() in rest, f"{said}does not show\n{shown}"
            rest = rest.split(piece.strip(), 1)[1] if piece.strip() else rest
    server.terminate()
    server.wait()


def serve(programs_folder, where, *options):
    """Starts a server of the wheel; returns it and its address."""
    command = [os.path.join(programs_folder, "gantry-tau"), "serve", "--pace", "lockstep", "--quasi-static", "--listen", "127.0.0.1:0"]
    server = subprocess.Popen([*command, *options], stdout=subprocess.PIPE, **where)
    return server, server.stdout.readline().split()[2].rstrip(",;")


main()
