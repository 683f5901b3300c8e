"""LinuxCNC in a copy of a configuration, with another screen: for `demo.py` and `eoffset.py`."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def prepare(folder, name, screen, hal, changes=()):
    """Copies all configurations; `screen` becomes the screen of one of them, and `hal` is carried out after its HAL files.

    `changes` are pairs of texts of its INI file, old and new. Returns the path of the INI file.
    """
    config = folder / "config"
    shutil.copytree(HERE / "config", config)
    ini = config / name / f"{name}.ini"
    text = ini.read_text()
    last = "HALFILE = ../drives.tcl\n"
    for old, new in [("DISPLAY = ../run.py", f"DISPLAY = {screen}"), (last, last + "HALFILE = trial.tcl\n"), *changes]:
        if old not in text:
            sys.exit(f"{ini}: {old.strip()} is expected there")
        text = text.replace(old, new, 1)
    ini.write_text(text)
    (ini.parent / "trial.tcl").write_text(hal)
    (ini.parent / "sim.var").touch()
    return ini


def linuxcnc(ini):
    """Runs LinuxCNC until its screen ends; returns all output. Ends this program if the screen did not say `gantry-tau ended done`."""
    if os.geteuid() == 0:
        sys.exit("LinuxCNC loads no module as root: run this as an ordinary user")
    done = subprocess.run(
        ["linuxcnc", str(ini)],
        cwd=ini.parent,
        env={**os.environ, "RUNTESTS": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if "gantry-tau ended done" not in done.stdout:
        sys.exit(f"LinuxCNC did not run to the end:\n{done.stdout[-4000:]}")
    return done.stdout
