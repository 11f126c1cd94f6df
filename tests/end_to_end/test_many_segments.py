"""A log of forty realisations: more segments than a dozen, and more rows than a diagnosis takes."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from analysis.diagnosis.experiment.reference_sensor import load_logs
from analysis.diagnosis.pipeline import diagnose
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.model import EffectEntry, load_model
from sim_backend.simbench import SimBench

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
AXIS = {
    "axes": ("theta_x",),
    "torque_rms_nm": 0.01,
    "stop_hz": 200.0,
    "period_s": 0.5,
    "realisations": 40,
    "periods": 3,
}


@pytest.mark.parametrize(
    ("stiffness", "verdict", "causes"),
    [(0.0, "consistent", []), (1e4, "named", [("cubic-stiffness", "theta_x")])],
)
def test_what_is_hidden_in_many_realisations_is_named(
    stiffness: float, verdict: str, causes: list[tuple[str, str]], tmp_path: Path
) -> None:
    model = load_model(EXAMPLES / "quiet.toml")
    spring = EffectEntry(effect="cubic-stiffness", where="theta_x", parameters={"stiffness": stiffness})
    bench = SimBench(msgspec.structs.replace(model, effects=[*model.effects, spring]), 0)
    log = tmp_path / "realisations.h5"
    run_plan(make_plan("multisine", AXIS), bench, log, seed=0)
    nominal = load_model(EXAMPLES / "nominal.toml")
    loaded, _ = load_logs([log], nominal, max_rows=200_000)
    assert len(loaded.data.records) > 12
    assert sum(record.n for record in loaded.data.records) <= 220_000
    found = diagnose(loaded.data, nominal)
    assert found.verdict == verdict, found.sentence
    assert [(c.effect, c.where) for c in found.causes] == causes
    # the held-out segment begins in the swing of one that was left out: that is no error of a model
    assert found.gain is not None
    assert found.gain.rms_after < 1.1 * found.gain.noise_floor
    if not causes:
        # nor is it evidence
        assert min(c.p_value for curves in found.evidence.values() for c in curves) > 1e-4
