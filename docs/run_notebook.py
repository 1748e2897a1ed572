"""Run the notebook of examples/ and keep what it shows, so that a page without Jupyter has it too.

    python3 docs/run_notebook.py

Figures and tables are kept; the skin that turns is not, since pages do not run scripts.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).resolve().parent.parent / "examples" / "first_design.ipynb"
# The entry of the notebook's metadata that tells of which source its outputs are.
SOURCE = "outputs_of"
# A skin that turns is a page in a frame.
TURNING = "<iframe"


def digest(cells: Sequence[Any]) -> str:
    """Return a digest of the sources of cells of code."""
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    return hashlib.sha256("\0".join(sources).encode()).hexdigest()[:16]


def kept(outputs: Sequence[Any]) -> list[Any]:
    """Return what pages without scripts can show of the outputs of a cell."""
    return [
        output
        for output in outputs
        if output["output_type"] != "stream"
        and TURNING not in output.get("data", {}).get("text/html", "")
    ]


def main() -> None:
    """Run the notebook in an empty folder, and write it back with its outputs."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=1800, resources=resources).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = kept(cell.outputs)
            cell.metadata = {}
    notebook.metadata[SOURCE] = digest(notebook.cells)
    nbformat.write(notebook, NOTEBOOK)


if __name__ == "__main__":
    main()
