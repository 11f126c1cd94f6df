"""Coherence is low where something else than the inputs moves an output, and not where it only rings."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.facts import Fact, found_in
from campaigns.facts.bands import bands_text
from tests.campaigns.facts import drawn

KINDS = ("white", "coloured", "steps", "multisine", "repeated noise")


def told(u: np.ndarray, y: np.ndarray, period: int = 0) -> list[Fact]:
    return [f for f in found_in(drawn.seen(u, y, period), ["coherence"]) if f.name == "coherence"]


@pytest.mark.parametrize("part", range(4))
def test_a_quiet_linear_bench_is_hardly_ever_remarked(part):
    """Noise of up to a tenth of the rms is a hundredth of the power. Of two in a hundred records a mode rings for
    longer than all blocks, as the remark says; a tenth is what is promised."""
    wrong = []
    for case in range(part, 200, 4):
        rng = np.random.default_rng([101, case])
        u, period = drawn.excitation(rng, KINDS[case // 4 % 5], int(10 ** rng.uniform(3.3, 4.0)))
        bench = drawn.drawn_bench(rng, linear=True)
        wrong += [(case, f.finding) for f in told(u, drawn.played(bench, u, rng)[1], period) if f.remark]
    assert len(wrong) <= 5, wrong


@pytest.mark.parametrize("kind", KINDS)
def test_a_disturbance_is_remarked_with_its_size(kind):
    """As much power from a disturbance within the band as from the input leaves a half explained."""
    import scipy

    for case in range(4):
        rng = np.random.default_rng([102, case])
        bench = drawn.Bench(np.array([0.3]), np.array([0.3]), np.ones(1), 0, 0.001, 0.0, 0.0, 0.0)
        u, period = drawn.excitation(rng, kind, 10_000)
        y = drawn.played(bench, u, rng)[1]
        other = drawn.played(bench, rng.permutation(u), rng)[1]
        other = scipy.signal.sosfilt(scipy.signal.butter(2, 0.1, output="sos"), other)
        (fact,) = told(u, y + other * y.std() / other.std(), period)
        assert fact.remark and 0.25 < fact.numbers["explained"] < 0.75


def test_an_input_that_is_not_played_is_low_at_its_frequencies_only():
    rng = np.random.default_rng(103)
    u = np.tile(rng.standard_normal(1000), 8)
    line = np.sin(2.0 * np.pi * 0.1002 * np.arange(u.size))
    (fact,) = told(u, u + 0.001 * rng.standard_normal(u.size) + 0.3 * line, 1000)
    assert 90.0 < fact.numbers["lowest_hz"] < 110.0
    assert fact.numbers["low"] < 0.05 and not fact.remark


def test_of_two_inputs_both_explain():
    rng = np.random.default_rng(104)
    u = rng.standard_normal((8000, 2))
    y = u @ np.array([1.0, 0.7])
    (both,), (alone,) = told(u, y), told(u[:, 1], y)
    assert both.numbers["explained"] > 0.99 and not both.remark
    assert alone.remark and alone.numbers["explained"] == pytest.approx(0.49 / 1.49, abs=0.1)


def test_inputs_that_change_from_period_to_period_explain_what_does_not_repeat():
    """A loop that learns plays the reference again, and other inputs: what repeats is then no measure of noise."""
    rng = np.random.default_rng(105)
    u = np.tile(rng.standard_normal(1000), 8) + rng.standard_normal(8000)
    (fact,) = told(u, u + 0.01 * rng.standard_normal(u.size), 1000)
    assert fact.numbers["explained"] > 0.99 and not fact.remark


def coloured(rng: np.random.Generator, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return an input with noise that grows with frequency, and a frequency response of that noise for white noise."""
    taps = 0.6 * np.array([1.0, -0.95])
    return u + np.convolve(rng.standard_normal(u.size + 1), taps)[1:-1], taps


def known_share(frequency_hz: np.ndarray, power: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Return the coherence of an input of `power` per line with itself and white noise through `taps`."""
    noise = np.abs(np.exp(-2j * np.pi * np.outer(frequency_hz, np.arange(taps.size)) / drawn.RATE_HZ) @ taps) ** 2
    return power / (power + noise)


@pytest.mark.parametrize("periods", [0, 4, 16])
def test_coherence_by_thirds_of_an_octave_is_the_known_one(periods):
    """Four standard deviations are allowed: sqrt(2) |γ| (1 - γ²) / sqrt(n) of γ², n averages times lines of a band
    (Bendat & Piersol, 4th edition, table 9.6), and as much as 1 / n, which is the one of no coherence."""
    rng = np.random.default_rng(106)
    if periods:
        length, averages = 2048, periods - 1
        spectrum = np.zeros(length // 2 + 1, dtype=complex)
        spectrum[10:820] = np.exp(2j * np.pi * rng.uniform(size=810)) * length / 2.0 / np.sqrt(810.0 / 2.0)
        u = np.tile(np.fft.irfft(spectrum, length), periods)
        power, lines = length / 2.0 / 810.0, np.arange(10, 820)  # of white noise of size one: an equal part per line
    else:
        u, length, power = rng.standard_normal(60_000), 8192, 1.0
        lines, averages = np.arange(1, length // 2), 60_000 / length
    y, taps = coloured(rng, u)
    (fact,) = told(u, y, length if periods else 0)
    frequency_hz = lines * drawn.RATE_HZ / length
    share = known_share(frequency_hz, np.full(lines.size, power), taps)
    number = np.rint(10.0 * np.log10(frequency_hz)).astype(int)
    assert [round(10.0 * np.log10(band.frequency_hz)) for band in fact.bands] == np.unique(number).tolist()
    for band, k in zip(fact.bands, np.unique(number), strict=True):
        right = float(1.0 / np.mean(1.0 / share[number == k]))  # equal signal per line: powers are summed
        n = averages * int((number == k).sum())
        allowed = 4.0 * (np.sqrt(2.0 * right) * (1.0 - right) / np.sqrt(n) + 1.0 / n)
        assert band.share == pytest.approx(right, abs=allowed), band
    shares = [band.share for band in fact.bands]
    assert max(shares) > 0.95 and shares[-1] < 0.6


def test_the_line_of_a_curve_has_a_dash_where_nothing_was_played():
    rng = np.random.default_rng(107)
    t = np.arange(8000)
    u = np.sin(2 * np.pi * 0.01 * t) + np.sin(2 * np.pi * 0.02 * t + 1.0)
    (fact,) = told(u, u + 1e-4 * rng.standard_normal(t.size), 1000)
    assert [round(band.frequency_hz, 3) for band in fact.bands] == [10.0, 19.953]
    assert bands_text(fact.bands) == "in thirds of an octave, 10 to 20 Hz: 100 – – 100 %"


@pytest.mark.parametrize("inputs", [1, 2, 3])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_what_chance_adds_is_taken_off_once(inputs, share):
    """Of white noise the mean over records is right to four of its standard deviations, whatever the inputs."""
    found = []
    for case in range(20):
        rng = np.random.default_rng([108, inputs, case])
        u = rng.standard_normal((8000, inputs))
        moved = u.sum(axis=1) / np.sqrt(inputs)
        (fact,) = told(u, np.sqrt(share) * moved + np.sqrt(1.0 - share) * rng.standard_normal(8000))
        found.append(fact.numbers["explained"])
    # a share below zero is told as none: the mean of a normal number cut off there is 0.683 of its deviation
    cut_off = 0.683 if share == 0.0 else 0.0
    assert np.mean(found) == pytest.approx(share, abs=(4.0 / np.sqrt(len(found)) + cut_off) * np.std(found))
