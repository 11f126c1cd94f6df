"""A stepped sine behind a delay and an amplifier gives both back; what a model misses is told."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest

from analysis.identification.identified import deviations, identification
from analysis.identification.rational import fit_rational
from analysis.identification.static_gain import static_gain
from analysis.identification.sweep_fit import fit_sweep
from analysis.recorded.sweep import Sweep
from sim_backend.errors import DataError
from sim_backend.model import Port
from sim_backend.plausible import LARGEST

F = np.geomspace(5.0, 400.0, 80)
RATE = 4000.0
NOISE = 1e-4


def measured(samples: float, lag_s: float) -> np.ndarray:
    """Samples to samples of two modes behind a lag and a hold, by python-control, `samples` late."""
    modes = (control.tf([g], [1.0, 2.0 * z * w, w * w]) for w, z, g in ((195.0, 0.02, 40.0), (880.0, 0.01, 300.0)))
    plant = sum(modes, control.tf([0.0], [1.0]))
    if lag_s:
        plant = plant * control.tf([1.0], [lag_s, 1.0])
    held = control.sample_system(control.tf2ss(plant), 1.0 / RATE, "zoh")
    return held(np.exp(2j * np.pi * F / RATE)) * np.exp(-2j * np.pi * F * samples / RATE)


def sweep(response: np.ndarray, seed: int) -> Sweep:
    rng = np.random.default_rng(seed)
    std = NOISE * np.abs(response)
    noise = std / np.sqrt(2.0) * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size))
    return Sweep("x", F, response + noise, std**2, np.ones(F.size))


@pytest.mark.parametrize("seed", range(3))
def test_a_drawn_delay_is_found(seed):
    drawn = np.random.default_rng(seed + 10)
    samples = float(drawn.integers(1, 5)) if seed == 0 else float(drawn.uniform(0.3, 5.0))
    fit, told = fit_sweep(sweep(measured(samples, 0.0), seed), RATE, (1, 2, 3, 4))
    assert fit.linear.delay_s[0] * RATE == pytest.approx(samples, abs=0.01)
    assert told == ()


@pytest.mark.parametrize(("seed", "late"), [(3, 0.0), (4, 2.4)])
def test_an_amplifier_behind_a_drawn_pole_is_followed(seed, late):
    lag_s = float(np.random.default_rng(seed).uniform(3e-4, 2e-3))
    exact = measured(late, lag_s)
    fit, told = fit_sweep(sweep(exact, seed), RATE, (1, 2, 3, 4))
    found = fit.linear.frequency_response(F, RATE)[:, 0, 0]
    # what parts a lag and delay from each other is below the noise; the response is what has to be right
    np.testing.assert_allclose(found, exact, rtol=10.0 * NOISE)
    assert told == ()
    modes = fit.linear.omega_rad_s[fit.linear.sigma_1_s < 0.1 * fit.linear.omega_rad_s]
    np.testing.assert_allclose(np.sort(modes), [195.0, 880.0], rtol=1e-4)
    if late == 0.0:
        real = fit.linear.poles_1_s()[fit.linear.sigma_1_s > fit.linear.omega_rad_s]
        # the block has two; the other stands where it changes nothing
        assert np.abs(1.0 + lag_s * real).min() < 0.01


def loops(samples: float, loss: float) -> np.ndarray:
    """What two modes behind an amplifier answer where a part of it lags by the same angle at every frequency."""
    return measured(samples, 3e-5) * (1.0 - 1j * loss)


@pytest.mark.parametrize("seed", range(8))
def test_the_static_gain_is_known_where_hysteresis_lags_below_the_band(seed):
    drawn = np.random.default_rng(seed + 70)
    exact = loops(float(drawn.uniform(0.0, 1.0)), float(drawn.uniform(5e-4, 3e-3)))
    fit, _ = fit_sweep(sweep(exact, seed), RATE, (1, 2, 3, 4, 5, 6))
    gain, std = static_gain(fit.linear), fit.gain_std
    assert gain is not None and std is not None
    assert std[0, 0] < 0.1 * abs(gain[0, 0])
    assert gain[0, 0] == pytest.approx(40.0 / 195.0**2 + 300.0 / 880.0**2, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_no_mode_is_kept_whose_width_or_size_is_unknown(seed):
    """A resonance that bends, as with hysteresis, draws modes to itself that only cancel each other."""
    drawn = np.random.default_rng(seed + 900)
    hump = drawn.uniform(0.005, 0.05) * np.exp(1j * drawn.uniform(-np.pi, np.pi))
    bent = 1.0 + hump / (1.0 + ((F - drawn.uniform(29.0, 33.0)) / drawn.uniform(0.3, 3.0)) ** 2)
    loss = float(drawn.uniform(5e-4, 3e-3))
    fit, _ = fit_sweep(sweep(bent * loops(float(drawn.uniform(0.0, 1.0)), loss), seed), RATE, (1, 2, 3, 4, 5, 6))
    model, std = fit.linear, fit.std
    swings = model.sigma_1_s < model.omega_rad_s
    assert swings.sum() >= 2
    assert np.all(model.sigma_1_s[swings] >= 3.0 * std.sigma_1_s[swings])
    known = (np.abs(model.c[0]) >= 3.0 * std.c[0]) | (np.abs(model.c_rate[0]) >= 3.0 * std.c_rate[0])
    assert np.all(known[swings])


def test_deviations_of_what_is_not_determined_are_numbers_that_a_file_holds():
    fit = fit_rational(F, measured(0.0, 0.0)[:, None, None], (2,), hold_rate_hz=RATE)
    unknown = replace(
        fit,
        covariance=1e80 * np.eye(fit.layout.size),
        omega_std_rad_s=np.full(2, 1e40),
        sigma_std_1_s=np.full(2, np.inf),
    )
    std = deviations(unknown)
    each = (std.omega_rad_s, std.sigma_1_s, std.b, std.b_direct, std.c, std.c_rate, std.d, std.delay_s)
    assert max(float(np.max(one)) for one in each) == LARGEST


def test_a_model_that_no_file_may_hold_is_refused():
    fitted, _ = fit_sweep(sweep(measured(0.0, 0.0), 5), RATE, (2,))
    absurd = replace(fitted, linear=fitted.linear.with_(c=1e40 * fitted.linear.c))
    ports = [Port(name="u", unit="N m", dof="x")], [Port(name="y", unit="rad", dof="x")]
    with pytest.raises(DataError, match=r"must be finite and at most 1e\+18.*--modes"):
        identification(absurd, (), *ports, method="stepped sine", name="x", rate_hz=RATE, source="a test")


def test_what_one_mode_misses_is_told():
    fit, told = fit_sweep(sweep(measured(0.0, 0.0), 5), RATE, (1,))
    assert fit.linear.n_blocks == 1
    assert len(told) == 1 and told[0].startswith("the model of x misses") and "give --modes" in told[0]
