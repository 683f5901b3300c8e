"""The commands of docs/fmi.md do what the page says.

    of_page.py PROGRAM

Not those that build the library and install FMPy: here the library lies beside the program.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import units

ROOT = Path(__file__).resolve().parents[4]


def blocks(page):
    """Blocks of a page: words behind its fence, and text."""
    return re.findall(r"^```(\S.*?)\n(.*?)^```$", page, re.M | re.S)


def shows(output, expected):
    """True if the output has the lines, in their order; `...` stands for anything.

    The numbers are those of a seeded simulation, and the same on every x86-64.
    """
    rest = output
    for piece in filter(None, map(str.strip, re.split(r"\n|\.\.\.", expected))):
        _, found, rest = rest.partition(piece)
        if not found:
            print(f"missing: {piece}\n{output}")
            return False
    return True


def main(program):
    page = (ROOT / "docs/fmi.md").read_text()
    found = blocks(page)
    commands = [text for words, text in found if words == "sh elsewhere"]
    expected = next(text for words, text in found if words == "text")
    with units.folder() as folder:
        (Path(folder) / "host").symlink_to(ROOT / "host")
        environment = dict(os.environ, PATH=f"{Path(program).parent}:{Path(sys.executable).parent}:{os.environ['PATH']}")
        said = ""
        for text in commands:
            for command in text.splitlines():
                if command.startswith(("cargo ", "pip ")):
                    continue
                command = re.sub(r" --library \S+", "", command)
                ended = subprocess.run(command, shell=True, cwd=folder, env=environment, text=True, capture_output=True)
                assert ended.returncode == 0, ended
                said += ended.stdout
        assert shows(said, expected), "not what the page shows"
        rows = re.findall(r"^(\S+) s: phase (\d), offsets \[(.*?)\] um, tool moved by \[(.*?)\] um$", said, re.M)
        moved = {float(time): [float(um) for um in tool.split(",")] for time, _, _, tool in rows}
        offsets = {float(time): [float(um) for um in of.split(",")] for time, _, of, _ in rows}
        # Held under 300 N within 3 % of some 200 um; 500 ms of the ramp are 50 um, less its first 2 ms.
        assert max(map(abs, moved[4.0])) < 6.0, moved
        for before, after in zip(offsets[4.0], offsets[4.5]):
            assert 49.5 < abs(before) - abs(after) < 50.1, (before, after)
        listed = subprocess.run(["fmpy", "info", "server.fmu"], cwd=folder, env=environment, text=True, capture_output=True)
        assert listed.returncode == 0 and "force[1]" in listed.stdout, listed
        print(said)


main(*sys.argv[1:])
