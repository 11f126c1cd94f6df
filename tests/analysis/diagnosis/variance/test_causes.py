"""What is seen only in the spread of the residual joins the verdict of the search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.fitting.discrepancy import Discrepancy
from analysis.diagnosis.noise.whitener import Bands
from analysis.diagnosis.variance.causes import VarianceEffects, variance_effects
from analysis.diagnosis.variance.chance import Chance
from analysis.diagnosis.verdict.judging import Judgement
from sim_backend.effects import EFFECTS
from sim_backend.effects.apex_noise import ApexNoise
from sim_backend.effects.dropped_samples import DroppedSamples
from tests.analysis.diagnosis.residuals import MODEL, moved, setting_of

_NONE = Discrepancy(("x",), (0.0,))
APEX = Chance(ApexNoise("x", linear=0.1), {"linear": 0.01}, 50.0, 1e-20, 0.2, 20.0, (("noise by rate", 30.0),))
TIED = Chance(ApexNoise("x", linear=0.1), {"linear": 0.01}, 50.0, 1e-20, 0.2, 20.0, (("noise by rate", 1.0),))
LOST = Chance(DroppedSamples("x", fraction=0.01), {"fraction": 1e-3}, 90.0, 1e-30, 0.1, 9.0)


def _verdict(verdict, tied=()) -> Judgement:
    return Judgement(verdict, (), tied, 1.0, 1.0, ())


def test_a_sure_cause_names_itself_and_joins_others() -> None:
    """Consistent becomes named, named stays so, with all of them as causes in the units of their place."""
    spread = VarianceEffects((APEX, LOST), 4)
    for before in ("consistent", "named"):
        assert spread.joined(_verdict(before)).verdict == "named"
    apex, lost = spread.named(spread.joined(_verdict("consistent")), MODEL)
    assert (apex.effect, apex.where, apex.parameters["linear"].unit) == ("apex-noise", "x", "1")
    assert lost.parameters["fraction"].std == 1e-3
    assert [type(e) for e in spread.effects] == [ApexNoise, DroppedSamples]
    assert spread.allowed == pytest.approx(0.3)
    # of 1000 rows they add 200 and 100 in all; their evidence alone would allow 100 and 180
    assert spread.share(1000) == pytest.approx(100.0 + 100.0)


def test_steady_noise_belongs_to_the_noise_and_gathers_nowhere() -> None:
    """A hump between a tenth and a fifth of the rate is in the whitener beside it, and in nothing else."""
    rng = np.random.default_rng(3)
    force, noise = rng.standard_normal(4000), 0.01 * rng.standard_normal(4000)
    setting, fit = setting_of(force, moved(force) + noise, noise, 0.01)
    hump = replace(APEX, louder=Bands(np.array([0.1, 0.2]), np.array([[9.0]])))
    spread = VarianceEffects((hump, LOST), 4)
    assert spread.share(1000) == pytest.approx(100.0)  # of the lost samples alone
    wave = 0.01 * np.sqrt(2.0) * np.cos(2.0 * np.pi * np.outer([0.05, 0.15, 0.3], np.arange(4000)))
    everywhere = np.ones(4000, dtype=bool)
    before, after = (
        np.mean(s.whitener.rows(wave.T, everywhere, 0) ** 2, axis=0) for s in (setting, spread.beside(setting, fit))
    )
    # what leaks over a band's edges is less than a tenth
    assert after / before == pytest.approx([1.0, 1.0 / 9.0, 1.0], rel=0.1)
    assert VarianceEffects((LOST,), 4).beside(setting, fit) is setting


def test_a_close_rival_makes_it_ambiguous() -> None:
    """The posterior is 1 / (1 + e^-1) then, far below what a name needs; nothing is added to the model."""
    spread = VarianceEffects((TIED,), 4)
    assert spread.probability(TIED) == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))
    joined = spread.joined(_verdict("consistent"))
    assert (joined.verdict, joined.tied) == ("ambiguous", (("apex-noise", "noise by rate"),))
    assert spread.named(joined, MODEL) == ()
    assert spread.effects == ()


def test_unknown_stays_unknown_and_ambiguous_keeps_its_ties() -> None:
    """What made them so is not explained by a sure cause of another kind."""
    spread = VarianceEffects((LOST,), 4)
    assert spread.joined(_verdict("unknown")).verdict == "unknown"
    assert spread.named(_verdict("unknown"), MODEL) == ()
    kept = spread.joined(_verdict("ambiguous", (("a", "b"),)))
    assert (kept.verdict, kept.tied) == ("ambiguous", (("a", "b"),))


def test_one_rate_for_all_kinds_holds_on_noise_alone() -> None:
    """Of fifty records of noise none has a cause: at one in five hundred that happens nine times in ten.

    White noise comes as continuous readings, single precision and steps of a hundredth of the noise, in turn.
    """
    for seed in range(50):
        rng = np.random.default_rng(seed)
        force = np.repeat(rng.uniform(-1.0, 1.0, 20), 400)
        x = moved(force)
        noise = 0.01 * rng.standard_normal(x.size)
        reading = x + noise
        if seed % 3 == 1:
            reading = reading.astype(np.float32).astype(float)
        elif seed % 3 == 2:
            reading = np.round(reading, 4)
        setting, fit = setting_of(force, reading, reading - x, 0.01)
        assert variance_effects(setting, fit, EFFECTS, _NONE).causes == (), f"seed {seed}"


def test_what_is_left_out_or_immaterial_is_not_among_them() -> None:
    """Rounding to half the noise is found, unless its cause is left out or dwarfed by what was explained."""
    rng = np.random.default_rng(1)
    force = np.repeat(rng.uniform(-1.0, 1.0, 20), 400)
    x = moved(force)
    reading = 0.005 * np.rint((x + 0.01 * rng.standard_normal(x.size)) / 0.005)
    setting, fit = setting_of(force, reading, reading - x, 0.01)
    assert [c.effect.name for c in variance_effects(setting, fit, EFFECTS, _NONE).causes] == ["sensor-quantisation"]
    others = tuple(e for e in EFFECTS if e.name != "sensor-quantisation")
    assert variance_effects(setting, fit, others, _NONE).causes == ()
    # its energy is 8000 · 0.25 / 12 = 167, which is less than 3 parts in a thousand of a million
    assert variance_effects(setting, fit, EFFECTS, Discrepancy(("x",), (1e6,))).causes == ()
