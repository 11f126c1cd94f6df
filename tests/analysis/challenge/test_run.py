"""Running cases: what a diagnosis process gets, what is kept of it, and what happens when it is late or done before."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from analysis.challenge.run import run_challenge
from analysis.challenge.truth import Buried, Case, Truth, seal
from mccdcli.options import Percent
from sim_backend.errors import ConfigError, DataError

WRITES = """
import json, os, sys
words = sys.argv[1:]
out = words[words.index("-o") + 1]
json.dump({"words": words, "folder": sorted(os.listdir("."))}, open(os.path.join(out, "diagnosis.json"), "w"))
print("done")
sys.exit(1)
"""


def challenge(folder: Path) -> Path:
    hidden = Buried(
        effect="delay", where="theta_x", parameters={}, size=1.0, detection_limit=1.0, naming_limit=1.0, rival="noise"
    )
    cases = {
        "0001": Case(stratum="outside", effects=[hidden], held_out_floor=1.0, shape="short", axes=1),
        "0002": Case(stratum="one", effects=[hidden], held_out_floor=1.0, shape="short", axes=1),
    }
    seal(folder, Truth(seed=0, salt="", cases=cases))
    (folder / "challenge.json").write_text(json.dumps({"cases": list(cases)}))
    for name in cases:
        (folder / "cases" / name).mkdir(parents=True)
        for file in ("nominal.toml", "run-1.h5", "run-2.h5"):
            (folder / "cases" / name / file).touch()
    return folder


def test_a_diagnosis_gets_its_case_and_what_to_leave_out(tmp_path: Path) -> None:
    outcomes = run_challenge(challenge(tmp_path), jobs=2, command=(sys.executable, "-c", WRITES))
    assert [(o.case, o.exit_code) for o in outcomes] == [("0001", 1), ("0002", 1)]
    seen = [json.loads((tmp_path / "results" / o.case / "diagnosis.json").read_text()) for o in outcomes]
    for one in seen:
        assert one["words"][:4] == ["run-1.h5", "run-2.h5", "--model", "nominal.toml"]
        share = one["words"][one["words"].index("--nominal-tolerance") + 1]
        assert Percent(0, 100).convert(share, None, None) == pytest.approx(0.03 / 3.0**0.5, abs=1e-4)
        assert one["folder"] == ["nominal.toml", "run-1.h5", "run-2.h5"]
    assert seen[0]["words"][-2:] == ["--without", "delay"]
    assert "--without" not in seen[1]["words"]
    assert (tmp_path / "results" / "0001" / "words.txt").read_text() == "done\n"


def test_what_was_run_is_not_run_again(tmp_path: Path) -> None:
    folder = challenge(tmp_path)
    run_challenge(folder, command=(sys.executable, "-c", "raise SystemExit(3)"))
    outcomes = run_challenge(folder, command=(sys.executable, "-c", "raise SystemExit(0)"))
    assert [o.exit_code for o in outcomes] == [3, 3]


def test_a_late_diagnosis_is_stopped(tmp_path: Path) -> None:
    outcomes = run_challenge(
        challenge(tmp_path), jobs=2, limit_s=0.5, command=(sys.executable, "-c", "import time; time.sleep(60)")
    )
    assert [o.exit_code for o in outcomes] == [None, None]
    assert all(0.5 <= o.wall_s < 10.0 for o in outcomes)


def test_an_interrupt_stops_what_runs_and_leaves_it_to_be_run_again(tmp_path: Path) -> None:
    folder = challenge(tmp_path)
    first = "import os, time; time.sleep(60 if os.getcwd().endswith('0001') else 0)"

    def interrupt(done: float, total: float, what: str) -> None:
        raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        run_challenge(folder, jobs=2, command=(sys.executable, "-c", first), report=interrupt)
    assert time.monotonic() - started < 20.0
    assert [p.parent.name for p in folder.glob("results/*/run.json")] == ["0002"]
    assert [o.exit_code for o in run_challenge(folder, command=(sys.executable, "-c", ""))] == [0, 0]


def test_processor_time_is_that_of_the_process(tmp_path: Path) -> None:
    busy = "import time\nwhile time.process_time() < 0.4: pass"
    outcomes = run_challenge(challenge(tmp_path), command=(sys.executable, "-c", busy))
    assert all(0.4 <= o.cpu_s < 2.0 for o in outcomes)


def test_a_changed_truth_stops_the_run(tmp_path: Path) -> None:
    folder = challenge(tmp_path)
    (folder / "truth" / "truth.bin").write_bytes(b"else")
    with pytest.raises(DataError, match="changed after it was sealed"):
        run_challenge(folder)


def test_a_folder_without_challenge_is_refused(tmp_path: Path) -> None:
    folder = challenge(tmp_path)
    (folder / "challenge.json").unlink()
    with pytest.raises(ConfigError, match=r"challenge\.json': no such file; make a challenge there first"):
        run_challenge(folder)
