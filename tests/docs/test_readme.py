"""The README's commands, typed by a reader who has a table of measured data and a model."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

from tests.reading import DOCS

COMMANDS = [
    block
    for block in re.findall(r"```sh\n(.*?)```", (DOCS.parent / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    if block.startswith("mccd ")
]


def typed(text: str, folder: Path, ends: int = 0) -> None:
    done = subprocess.run(["bash", "-euc", text], cwd=folder, capture_output=True, text=True, timeout=180)
    assert done.returncode == ends, f"{text}\n{done.stdout}\n{done.stderr}"


def test_the_first_commands_import_a_table_and_diagnose_it_and_the_nightly_one_fails(reader: Path) -> None:
    """The bench of the tutorial hides an effect: the model lacks it, and the nightly run has to fail."""
    first, nightly, report = COMMANDS
    axes = "--set \"axes=['theta_x']\" --set steps_s=0.3 --set noise_s=0.3 --set held_out_s=0.3"
    typed(f"mccd simulate --model docs/examples/mystery.toml --plan freerun {axes} -o bench.h5", reader)
    typed("mccd log export bench.h5 -o data.csv", reader)
    typed("mccd import --guess data.csv -o map.toml", reader)
    shutil.copy(reader / "docs" / "examples" / "nominal.toml", reader / "nominal.toml")
    typed(first, reader, ends=1)
    assert (reader / "diagnosis" / "index.html").exists() and (reader / "diagnosis" / "extended.toml").exists()
    shutil.copy(reader / "run.h5", reader / "night.h5")
    shutil.copy(reader / "run.h5.sha256", reader / "night.h5.sha256")
    shutil.copy(reader / "nominal.toml", reader / "bench.toml")
    shutil.rmtree(reader / "diagnosis")
    typed(nightly, reader, ends=1)
    assert ElementTree.parse(reader / "diagnosis.xml").getroot().find(".//failure") is not None
    # whole reports are checked with known misses in contract/test_tables.py
    assert report.startswith("mccd report --check --known-misses")
