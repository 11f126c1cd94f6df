"""What a diagnosis writes is used: by the simulation, by every strategy, and by another diagnosis."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from campaigns.plans import make_plan
from campaigns.strategies import STRATEGIES
from sim_backend.model import EffectEntry, Quantity, dump_model, load_model, number
from sim_backend.simbench import SimBench
from tests import running
from tests.small_bench import NOISE, bench_model

ROOT = Path(__file__).parents[2]
SHIFT = 0.04
QUICK = (
    "--set",
    'axes=["theta_x", "theta_y"]',
    "--set",
    "period_s=1.0",
    "--set",
    "start_hz=2.0",
    "--set",
    "stop_hz=500.0",
)


def mccd(*arguments: str) -> subprocess.CompletedProcess[str]:
    return running.mccd(*arguments, cwd=ROOT, timeout=300)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a bench whose springs are 4 % stiffer than the nominal model, a record of it and its diagnosis."""
    folder = tmp_path_factory.mktemp("extended")
    shift = EffectEntry(effect="stiffness-shift", where="theta_y", parameters={"relative": SHIFT})
    (folder / "bench.toml").write_text(dump_model(bench_model((shift, *NOISE))), encoding="utf-8")
    (folder / "nominal.toml").write_text(dump_model(bench_model()), encoding="utf-8")
    run = str(folder / "run.h5")
    played = ("simulate", "--model", str(folder / "bench.toml"), "--plan", "multisine", *QUICK, "--out", run)
    assert mccd(*played).returncode == 0
    diagnosed = ("diagnose", run, "--model", str(folder / "nominal.toml"), "--nominal-tolerance", "0.1%")
    done = mccd(*diagnosed, "--bench", f"sim:{folder / 'bench.toml'}", "-o", str(folder / "out"))
    assert done.returncode == 1, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def found(home: Path) -> dict[str, Any]:
    return json.loads((home / "out" / "diagnosis.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_spring_is_named_and_its_chop_settles_sooner_and_stays_as_still(home: Path, found: dict[str, Any]) -> None:
    (cause,) = found["causes"]
    assert (cause["effect"], cause["where"]) == ("stiffness-shift", "theta_y")
    relative = cause["parameters"]["relative"]
    assert abs(relative["value"] - SHIFT) < 4.0 * relative["std"]
    chops = {chop["axis"]: chop for chop in found["chops"]}
    # 4 % of 8.5 mrad is 340 µrad of error on arrival, 200 times the band: the loop at 110 Hz needs five of its time
    # constants of 1.4 ms for that, none where the feed-forward is right
    assert chops["theta_y"]["settling_after_s"] < chops["theta_y"]["settling_before_s"] - 5e-3
    # what the loop does to noise is the same, but for the error that was left on arrival
    assert chops["theta_y"]["stability_after_rad"] <= chops["theta_y"]["stability_before_rad"]


@pytest.mark.slow
def test_every_re_tuned_number_carries_its_run_and_its_deviation(home: Path) -> None:
    nominal, extended = load_model(home / "nominal.toml"), load_model(home / "out" / "extended.toml")
    turned = [
        value
        for before, after in zip(nominal.modes, extended.modes, strict=True)
        for old, value in ((before.frequency_hz, after.frequency_hz), (before.decay_rate_1_s, after.decay_rate_1_s))
        if number(old) != number(value)
    ]
    (entry,) = extended.effects
    relative = entry.parameters["relative"]
    assert turned and isinstance(relative, Quantity) and relative.std is not None and relative.std > 0.0
    for value in turned:
        assert isinstance(value, Quantity) and value.std is not None and value.std > 0.0 and "sha256" in value.source


@pytest.mark.slow
def test_the_extended_model_is_simulated_and_judged_again(home: Path, tmp_path: Path) -> None:
    extended, run = str(home / "out" / "extended.toml"), str(tmp_path / "again.h5")
    assert (
        mccd("simulate", "--model", extended, "--plan", "rest", "--set", "duration_s=0.2", "--out", run).returncode == 0
    )
    again = ("diagnose", str(home / "run.h5"), "--model", extended, "--nominal-tolerance", "0.1%")
    done = mccd(*again, "-o", str(tmp_path / "out"))
    assert done.returncode == 0, done.stdout  # consistent: nothing is left to find


@pytest.mark.slow
def test_the_true_model_of_a_nonlinear_bench_is_consistent_and_one_without_its_friction_is_not(
    tmp_path: Path,
) -> None:
    """The simulated bench takes steps of a sample; in finer ones its own stiffness is 15 standard deviations off."""
    mystery = ROOT / "docs" / "examples" / "mystery.toml"
    true = load_model(mystery)
    friction = EffectEntry(
        effect="coulomb-friction", where="theta_x", parameters={"torque": 1e-4, "breakaway_rate": 1e-2}
    )
    rubbing = tmp_path / "rubbing.toml"
    rubbing.write_text(dump_model(msgspec.structs.replace(true, effects=[*true.effects, friction])), encoding="utf-8")
    for bench, verdict in ((mystery, "consistent"), (rubbing, "named")):
        run = str(tmp_path / f"{verdict}.h5")
        played = ("simulate", "--model", str(bench), "--plan", "freerun", "--set", "axes=['theta_x']")
        shorter = ("--set", "steps_s=1", "--set", "noise_s=1", "--set", "held_out_s=0.5")
        assert mccd(*played, *shorter, "-o", run).returncode == 0
        judged = ("diagnose", run, "--model", str(mystery), "--expect", verdict, "--no-page")
        done = mccd(*judged, "-o", str(tmp_path / verdict))
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("strategy", [name for name in STRATEGIES if not name.startswith("designed")])
def test_every_strategy_of_the_paper_plays_on_the_extended_model(home: Path, strategy: str) -> None:
    """Those of a controller file are designed on such a model in `tests/analysis/design`."""
    settings = {"strategy": strategy, "alpha_deg": 90.0, "to_rad": 4e-3, "cycles": 2, "tuning": {"learning_s": 0.4}}
    bench = SimBench(bench_model(NOISE), 1)
    nominal, extended = (
        list(make_plan("settling", {**settings, "model": str(home / name)}).segments(bench))
        for name in ("nominal.toml", "out/extended.toml")
    )
    assert [s.n_samples for s in extended] == [s.n_samples for s in nominal]
    # the stiffer spring is met by what is fed forward, or by what learning inverts
    differs = [
        not np.array_equal(a.feedforward, b.feedforward) or repr(a.learning) != repr(b.learning)
        for a, b in zip(nominal, extended, strict=True)
    ]
    assert any(differs)


@pytest.mark.slow
def test_a_chop_that_the_bench_cannot_play_leaves_the_diagnosis_whole(home: Path, tmp_path: Path) -> None:
    small = tmp_path / "small.toml"  # its end stops stand nearer than the chop reaches
    small.write_text(dump_model(bench_model(NOISE, end_stop_rad=4e-3)), encoding="utf-8")
    run, nominal = str(home / "run.h5"), str(home / "nominal.toml")
    judged = ("diagnose", run, "--model", nominal, "--nominal-tolerance", "0.1%", "--bench", f"sim:{small}")
    done = mccd(*judged, "-o", str(tmp_path / "out"))
    assert done.returncode == 1 and "could not be played" in done.stdout
    kept = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert kept["verdict"] == "named" and kept["chops"] == [] and (tmp_path / "out" / "index.html").is_file()
