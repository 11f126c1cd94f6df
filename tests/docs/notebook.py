"""Run the example notebook and keep in it what it prints and draws; `make notebook` calls this."""

from __future__ import annotations

import os
from pathlib import Path

import nbclient
import nbformat

from tests.reading import DOCS

NOTEBOOK = DOCS / "examples" / "diagnose.ipynb"


def executed(folder: Path) -> nbformat.NotebookNode:
    """Return the notebook with its results, run in a folder by a kernel that finds these sources."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    environment = os.environ | {
        "PYTHONPATH": str(DOCS.parent),
        "JUPYTER_PLATFORM_DIRS": "1",
        "IPYTHONDIR": str(folder),
    }
    # without the times of the run, which would differ each time
    client = nbclient.NotebookClient(
        notebook, timeout=120, record_timing=False, resources={"metadata": {"path": str(folder)}}
    )
    client.execute(env=environment)
    del notebook.metadata["language_info"]  # that of the Python at hand
    return notebook


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as scratch:
        nbformat.write(executed(Path(scratch)), NOTEBOOK)
