"""The notebook, run by the kernel that a reader has."""

from __future__ import annotations

import re
from pathlib import Path

import nbformat
import pytest

from tests.docs.held_spring import relative_error
from tests.docs.notebook import NOTEBOOK, executed


def _outputs(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def _printed(notebook: nbformat.NotebookNode) -> str:
    return "".join(output["text"] for output in _outputs(notebook) if output.output_type == "stream")


def test_the_notebook_runs_and_names_the_effect(tmp_path: Path) -> None:
    notebook = executed(tmp_path)
    printed = _printed(notebook)
    shown = [output["data"] for output in _outputs(notebook) if "data" in output]
    assert "stiffness" in shown[0]["text/html"]  # the table of parameters
    assert any("image/png" in data for data in shown)
    assert printed.startswith("named\n") and "cubic-stiffness at theta" in printed
    value, std = map(float, re.search(r"stiffness = (\S+) ± (\S+)", printed).groups())  # type: ignore[union-attr]
    # the notebook's mirror takes 16 steps a sample at 2 kHz, the fit four; at 9 mrad the spring of 11.2 N m/rad is
    # 3/4 · 2·10⁴ · (9 mrad)² stiffer to the fundamental. Beyond that, four times the noise and the last printed digit
    steps = relative_error(29.6, 0.25 / 2000.0, stiffening=0.75 * 2e4 * 9e-3**2 / 11.2)
    assert abs(value - 2e4) < steps * 2e4 + 4.0 * std + 0.05

    # what a reader sees who does not run it: the same words, and numbers that agree to the digits that are told
    kept = nbformat.read(NOTEBOOK, as_version=4)
    number = r"\d+(?:\.\d+)?"
    assert re.sub(number, "#", _printed(kept)) == re.sub(number, "#", printed), "run `make notebook`"
    now, then = (list(map(float, re.findall(number, text))) for text in (printed, _printed(kept)))
    assert now == pytest.approx(then, rel=0.02), "run `make notebook`"
    assert [sorted(output) for output in _outputs(kept)] == [sorted(output) for output in _outputs(notebook)]
