"""The notebook, run by the kernel that a reader has."""

from __future__ import annotations

import os
import re
from pathlib import Path

import nbclient
import nbformat

from tests.docs.held_spring import relative_error
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
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    printed = "".join(output["text"] for output in outputs if output.output_type == "stream")
    shown = [output["data"] for output in outputs if "data" in output]
    assert "stiffness" in shown[0]["text/html"]  # the table of parameters
    assert any("image/png" in data for data in shown)
    assert printed.startswith("named\n") and "cubic-stiffness at theta" in printed
    value, std = map(float, re.search(r"stiffness = (\S+) ± (\S+)", printed).groups())  # type: ignore[union-attr]
    # the notebook's mirror takes 16 steps a sample at 2 kHz, the fit four; at 9 mrad the spring of 11.2 N m/rad is
    # 3/4 · 2·10⁴ · (9 mrad)² stiffer to the fundamental. Beyond that, four times the noise and the last printed digit
    steps = relative_error(29.6, 0.25 / 2000.0, stiffening=0.75 * 2e4 * 9e-3**2 / 11.2)
    assert abs(value - 2e4) < steps * 2e4 + 4.0 * std + 0.05
