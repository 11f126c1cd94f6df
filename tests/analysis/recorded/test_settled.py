"""A transient at the start of a periodic record is seen, and left out of what is averaged."""

from __future__ import annotations

import numpy as np

from analysis.identification.identify import identify_runs
from analysis.recorded.settled import settling_periods

PERIOD, RATE_HZ = 400, 10_000.0  # the rate is that of the logs in these tests
CHANNELS = [("u", "N m", "input", "theta_x"), ("y", "rad", "output", "theta_x")]
DECAY_1_S, FREQUENCY_HZ = 40.0, 300.0


def record(periods: int, rng: np.random.Generator, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """A swinging mass at rest, played by a multisine: exact steps of its two states, in its own formula."""
    lines = np.arange(1, 60)
    t = np.arange(PERIOD)
    phases = rng.uniform(0.0, 2.0 * np.pi, lines.size)
    u = np.tile(np.cos(2.0 * np.pi * lines * t[:, None] / PERIOD + phases).sum(axis=1), periods)
    pole = complex(-DECAY_1_S, 2.0 * np.pi * FREQUENCY_HZ)
    step = np.exp(pole / RATE_HZ)
    z, y = 0.0j, np.empty(u.size)
    for k in range(u.size):
        y[k] = z.real
        z = step * z + (step - 1.0) / pole * u[k]
    return u, y + noise * y.std() * rng.standard_normal(y.size)


def test_periods_are_left_out_until_nothing_rings_on(write_log) -> None:
    """Each period the start has died away by exp(-1.6): of 5 % and of 0.2 % of noise, so each has its number."""
    rng = np.random.default_rng(1)
    for noise, least, most in ((0.05, 1, 3), (0.002, 3, 6)):
        u, y = record(10, rng, noise)
        run = write_log("free-run", CHANNELS, [("all", {}, {"u": u, "y": y})], name=f"{noise}.h5")
        assert least <= settling_periods([(run, run.segments[0])], PERIOD, 10) <= most


def test_settled_periods_and_two_periods_are_all_kept(write_log) -> None:
    """Noise alone must not cost a period, and two periods cannot tell."""
    rng = np.random.default_rng(2)
    for trial in range(20):
        y = np.tile(rng.standard_normal(PERIOD), 5) + 0.1 * rng.standard_normal(5 * PERIOD)
        run = write_log("free-run", CHANNELS, [("all", {}, {"u": y, "y": y})], name=f"{trial}.h5")
        assert settling_periods([(run, run.segments[0])], PERIOD, 5) == 0
    u, y = record(2, rng, 0.0)
    run = write_log("free-run", CHANNELS, [("all", {}, {"u": u, "y": y})], name="two.h5")
    assert settling_periods([(run, run.segments[0])], PERIOD, 2) == 0


def test_the_log_has_the_last_word(write_log) -> None:
    """Who states how many periods are transient knows it."""
    u, y = record(6, np.random.default_rng(3), 0.01)
    run = write_log("free-run", CHANNELS, [("all", {"transient_periods": 1}, {"u": u, "y": y})])
    assert settling_periods([(run, run.segments[0])], PERIOD, 6) == 1


def test_a_start_from_rest_is_not_taken_for_noise(write_log) -> None:
    """Its transient is a third of the output's rms in the first period; as noise it would hide all but 30 %."""
    u, y = record(6, np.random.default_rng(4), 0.01)
    run = write_log("free-run", CHANNELS, [("all", {"period_samples": PERIOD}, {"u": u, "y": y})])
    found = identify_runs([run], modes=1).model.linear()
    # the frequency of one mode from 2,000 samples at 1 % noise is known to about 1e-4, its decay rate to 1e-3
    assert abs(np.sqrt(found.omega_rad_s[0] ** 2 - found.sigma_1_s[0] ** 2) / (2.0 * np.pi * FREQUENCY_HZ) - 1.0) < 1e-3
    assert abs(found.sigma_1_s[0] / DECAY_1_S - 1.0) < 1e-2
