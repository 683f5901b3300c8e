"""The notebook of the springs, as it is: of_notebook.py PROGRAM FOLDER, that of host/python. Needs nbclient."""

import os
import sys
import tempfile

import nbformat
from nbclient import NotebookClient

PROGRAM, PACKAGE = map(os.path.abspath, sys.argv[1:])
os.environ["GANTRY_TAU"] = PROGRAM
os.environ["PYTHONPATH"] = PACKAGE
os.environ["MPLBACKEND"] = "agg"

notebook = nbformat.read(os.path.join(PACKAGE, "examples/springs.ipynb"), as_version=4)
cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
assert len(cells) == 10 and not any(cell.outputs for cell in cells), "ten cells, without what a run has left in them"
with tempfile.TemporaryDirectory() as folder:
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": folder}}).execute()
said = "".join(output.get("text", "") for cell in cells for output in cell.outputs)
print(said)
assert "9 of 9 parameters seen" in said, said
assert "compensated" in said, said
