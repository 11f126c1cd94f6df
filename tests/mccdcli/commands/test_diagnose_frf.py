"""`mccd diagnose --frf`: files and exit codes as for logs, and one line for a table that cannot be judged."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest

from mccdcli.schema import schema_of
from sim_backend.model import dump_model
from tests.analysis.diagnosis.response.tables import F, noisy, nominal, response, written
from tests.running import mccd


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "nominal.toml").write_text(dump_model(nominal()))
    return tmp_path


def test_files_and_exit_codes_are_those_of_logs(folder):
    h = noisy(response(), 1)
    written(folder / "h.csv", F, h, std=2e-3 * np.abs(h))
    done = mccd("diagnose", "--frf", "h.csv", "--model", "nominal.toml", "-o", "out", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    jsonschema.validate(content, schema_of("diagnose"))
    assert content == json.loads((folder / "out" / "diagnosis.json").read_text())
    assert content["verdict"] == "consistent" and content["next_experiment"] is None
    page = (folder / "out" / "index.html").read_text()
    assert "The measured response x → x" in page
    assert (folder / "out" / "figures" / "response-x-x.csv").exists()
    again = mccd("simulate", "--model", "out/extended.toml", "--plan", "chop", "--dry-run", cwd=folder)
    assert "Traceback" not in again.stderr
    # without its page the answer is the same, and it names no file that is not there
    given = ("diagnose", "--frf", "h.csv", "--model", "nominal.toml", "--no-page")
    done = mccd(*given, "-o", "bare", "--json", cwd=folder)
    assert done.returncode == 0 and json.loads(done.stdout) == content
    assert {path.name for path in (folder / "bare").iterdir()} == {"diagnosis.json", "extended.toml"}


def table(f=F, h=None, head="phase (deg)", phase=None):
    h = response(f) if h is None else h
    phase = np.degrees(np.angle(h)) if phase is None else phase
    rows = [f"frequency (Hz),magnitude,{head}", *(f"{a},{b},{c}" for a, b, c in zip(f, np.abs(h), phase, strict=True))]
    return "\n".join(rows) + "\n"


def beside(name, wrong):
    """A table with a column of ones, whose second row is wrong."""
    head, first, second, *others = table().splitlines()
    lines = [f"{head},{name}", f"{first},1.0", f"{second},{wrong}", *(f"{line},1.0" for line in others)]
    return "\n".join(lines) + "\n"


SECOND = f"row 2, at the frequency {F[1]:g}, has a"
BAD = {
    "a negative frequency": (table(f=np.where(F < 3.0, -F, F), h=response()), "a frequency is -"),
    "one row": (table(f=F[:1]), "has 1 points of a response above 0 Hz"),
    "degrees called rad": (table(head="phase (rad)"), "name the column 'phase (deg)'"),
    "rad called degrees": (table(phase=np.angle(response())), "name the column 'phase (rad)'"),
    "no number": (table(h=np.full(F.size, np.nan)), "which is not a finite number"),
    "a coherence above one": (beside("coherence", 1.5), f"{SECOND} coherence of 1.5; it lies between 0 and 1"),
    "no deviation": (beside("std", 0.0), f"{SECOND} standard deviation of 0; it must be above zero"),
    "no phase": ("frequency (Hz),magnitude\n1,2\n2,3\n", "needs columns of magnitude and phase"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_table_that_cannot_be_judged_is_refused_on_one_line(folder, case):
    text, said = BAD[case]
    (folder / "h.csv").write_text(text)
    done = mccd("diagnose", "--frf", "h.csv", "--model", "nominal.toml", cwd=folder)
    assert done.returncode == 4, done.stderr
    assert said in done.stderr and len(done.stderr.strip().splitlines()) == 1


USAGE = {
    "both": (["h.csv", "--frf", "h.csv"], "give logs or a frequency-response table, not both"),
    "neither": ([], "with --frf"),
    "level": (["h.csv", "--level", "1"], "--level goes with --frf"),
    "rows": (["--frf", "h.csv", "--rows", "5000"], "--rows goes with logs"),
    "bench": (["--frf", "h.csv", "--bench", "sim"], "--bench goes with logs"),
    "no such level": (["--frf", "h.csv", "--level", "1"], "has no level 1"),
    "another model": (["--frf", "h.csv", "--model", "as-built"], "give a model of one of each"),
}


@pytest.mark.parametrize("case", USAGE)
def test_options_that_do_not_go_together_end_with_2(folder, case):
    arguments, said = USAGE[case]
    written(folder / "h.csv", F, response())
    model = [] if "--model" in arguments else ["--model", "nominal.toml"]
    done = mccd("diagnose", *arguments, *model, cwd=folder)
    assert done.returncode == 2 and said in " ".join(done.stderr.split()), done.stderr
