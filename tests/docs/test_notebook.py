"""The notebook, run by the kernel that a reader has."""

from __future__ import annotations

import os
import re
from pathlib import Path

import nbclient
import nbformat

from tests.reading import DOCS


def test_the_notebook_runs_and_names_the_effect(tmp_path: Path) -> None:
    notebook = nbformat.read(DOCS / "examples" / "diagnose.ipynb", as_version=4)
    environment = os.environ | {
        "PYTHONPATH": str(DOCS.parent),
        "JUPYTER_PLATFORM_DIRS": "1",
        "IPYTHONDIR": str(tmp_path),
    }
    client = nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}})
    client.execute(env=environment)
    printed = "".join(output["text"] for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs)
    assert printed.startswith("named\n") and "cubic-stiffness at theta" in printed
    value, std = map(float, re.search(r"stiffness = (\S+) ± (\S+)", printed).groups())  # type: ignore[union-attr]
    # the fitted model holds the spring's torque over a sample, the notebook's mirror does not: at 30 Hz and 2 kHz that
    # is (2 pi 30 / 2000)^2 / 12, less than 1e-3 of it
    assert abs(value - 2e4) < 4.0 * std + 1e-3 * 2e4
