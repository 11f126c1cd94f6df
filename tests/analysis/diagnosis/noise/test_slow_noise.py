"""What is slow beside noise that is known at higher frequencies only: a drift is found, and not invented."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from analysis.diagnosis.evidence.domains import evidence
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.pipeline import Options, diagnose, search_causes
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.verdict.judging import judge
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import EFFECTS, make_effect
from sim_backend.replay import replay
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, Array, flicker, moved

_SLOW = {"sensor-drift", "constant-torque", "fringe-jump", "viscoelastic-creep"}
_OPTIONS = Options(without=tuple(sorted({e.reported() for e in EFFECTS} - _SLOW)), workers=1)
_NOISE = 1e-3


def _data(seed: int, drift: float, plant: Callable[[Array], Array] = moved, offset: float = 0.0) -> Dataset:
    """A force that repeats every second, and two records of steps."""
    rng = np.random.default_rng(seed)
    forces = [np.tile(rng.standard_normal(1000), 6), *(np.repeat(rng.uniform(-1.0, 1.0, 24), 500) for _ in range(2))]
    records = []
    for i, force in enumerate(forces):
        reading = plant(force) + _NOISE * flicker(rng, force.size) + drift * np.arange(force.size) / RATE_HZ + offset
        window = Window("periods" if i == 0 else "steps", 0, force.size, period=0 if i else 1000)
        records.append(Record(f"run {i}", force[:, None], reading[:, None], (window,)))
    return Dataset(RATE_HZ, tuple(records))


def _creeping(force: Array) -> Array:
    """The displacement (n,) under a `force` (n,) of a plant that creeps by 3 % within a second or two."""
    creep = make_effect("viscoelastic-creep", "x", {"stiffness": 0.03, "time_constant_s": 1.0})
    played = replay(MODEL.linear(), [creep], places_of(MODEL), transducers_of(MODEL), force[:, None], RATE_HZ)
    return played.reading[:, 0]


@pytest.mark.parametrize("drift", [5e-3, -5e-2])
def test_a_drift_is_found_however_large(drift: float) -> None:
    """The larger it is, the higher the noise seems at the frequencies that it fills."""
    found = search_causes(_data(1, drift), MODEL, _OPTIONS)
    judgement = judge(found)
    assert judgement.verdict == "named"
    assert [e.name for e in found.best.effects] == ["sensor-drift"]
    # within four of its standard deviations, of which the noise's colour down there is the larger part
    assert found.best.values[0] == pytest.approx(drift, abs=4.0 * found.best.std[0])


def test_what_slow_noise_hides_in_part_is_found() -> None:
    """A constant torque, most of which passes for slow noise: what is left of it stands out, and by too little."""
    found = search_causes(_data(4, 0.0, offset=1.1e-3), MODEL, _OPTIONS)
    judgement = judge(found)
    assert (judgement.verdict, [e.name for e in found.best.effects]) == ("named", ["constant-torque"])
    assert found.best.values[0] == pytest.approx(1.1e-3, abs=4.0 * found.best.std[0])


def test_slow_noise_is_no_drift() -> None:
    """Of four records none is one: at one in five hundred that would happen once in a hundred times."""
    verdicts = [judge(search_causes(_data(seed, 0.0), MODEL, _OPTIONS)).verdict for seed in range(100, 104)]
    assert verdicts == ["consistent"] * 4


def test_slow_noise_is_no_evidence_by_time() -> None:
    found = diagnose(_data(1, 0.0), MODEL, _OPTIONS)
    assert found.verdict == "consistent"
    # three runs are looked at
    assert min(curve.p_value for curve in found.evidence["time"]) > 1e-3 / 3


def test_what_is_slow_and_explained_is_no_noise_of_the_evidence() -> None:
    """It stands out as it does above the noise itself: of the logarithm of that chance half is there at least."""
    data = _data(1, 0.0, _creeping)
    found = diagnose(data, MODEL, _OPTIONS)
    assert [c.effect for c in found.causes] == ["viscoelastic-creep"]
    noise = whitener_from(data, [r.y - _creeping(r.u[:, 0])[:, None] for r in data.records])
    seen, true = found.evidence["time"], evidence(data, found.before, noise, MODEL)["time"]
    # of the two runs of steps; where all repeats, little creeps
    for own, other in zip(seen[1:], true[1:], strict=True):
        assert own.p_value <= np.sqrt(other.p_value) < 1e-20
