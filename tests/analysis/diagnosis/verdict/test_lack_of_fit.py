"""The lack of fit along basis functions: sized as least squares sizes it, silent on noise, heard at the right place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import kstest

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.nominal.tuning import nuisances_of, sensitivities, turned
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.verdict.basis import READINGS, SLOWEST, TORQUES
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION, LackOfFit, lacks_of_fit
from sim_backend.assembly import places_of, transducers_of
from sim_backend.linear import ModalModel, discretise
from tests.analysis.diagnosis.two_axes import AXES, FREQUENCY_HZ, RATE_HZ, two_axes

Array = NDArray[np.float64]
ROWS = 3000
TOLERANCE = 0.02
WAYS = {False: TORQUES, True: READINGS}


def _drive(seed: int) -> Array:
    """Return forces that move the axes by some 10⁵ times the noise, whose size is one."""
    rng = np.random.default_rng(seed)
    return np.asarray(lfilter([1e4], [1.0, -0.9], rng.standard_normal((ROWS, 2)), axis=0))


def _setting(residual: Array, seed: int = 1) -> tuple[Setting, Fit]:
    """Return two records with white noise of unit size, and the nominal model's fit that leaves `residual` of them."""
    model, half = two_axes(), ROWS // 2
    linear, drive = model.linear(), _drive(seed)
    y = simulate(discretise(linear, RATE_HZ), drive)
    warm = 80.0 + 3.0 * np.arange(ROWS) / ROWS
    records = tuple(
        Record(f"run {k}", drive[s], y[s] + residual[s], (Window("all", 0, half),), warm[s])
        for k, s in enumerate((slice(0, half), slice(half, ROWS)))
    )
    data = Dataset(RATE_HZ, records)
    whitener = Whitener(np.ones((2, 1)), True)
    starts = starts_of(data, linear, whitener)
    rest = (np.zeros((2, 2)),) * 2
    nuisances = nuisances_of(linear, TOLERANCE)
    setting = Setting(data, linear, (), places_of(model), transducers_of(model), nuisances, whitener, starts, rest, 1)
    none = np.zeros(0)
    parts = (residual[:half], residual[half:])
    fit = Fit((), np.zeros(len(nuisances)), (), 0.0, 0.0, 2 * ROWS, 0.0, 0.0, (), none, none, parts, ())
    return setting, fit


def _noise(seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((ROWS, 2))


def _through(force: Array, axis: int, linear: ModalModel) -> Array:
    """Return the response (ROWS, 2) to a force on one axis that acts in each half from rest."""
    out = np.zeros((ROWS, 2))
    for s in (slice(0, ROWS // 2), slice(ROWS // 2, ROWS)):
        u = np.zeros((ROWS // 2, 2))
        u[:, axis] = force[s]
        out[s] = simulate(discretise(linear, RATE_HZ), u)
    return out


def _motion(linear: ModalModel) -> tuple[Array, Array, Array]:
    """Return command, position and rate (ROWS, 2) of both records, each from rest."""
    u = _drive(1)
    x = np.concatenate([simulate(discretise(linear, RATE_HZ), u[s]) for s in (slice(0, 1500), slice(1500, None))])
    v = np.concatenate([np.gradient(x[s], 1.0 / RATE_HZ, axis=0) for s in (slice(0, 1500), slice(1500, None))])
    return u, x, v


def _at(found: tuple[LackOfFit, ...], what: str, where: str, reading: bool = False) -> LackOfFit:
    return next(one for one in found if (one.what, one.where) == (_words(what, reading), where))


def _words(what: str, reading: bool) -> str:
    return f"{'an error of the reading' if reading else 'a torque'} that follows {what}"


def test_a_part_is_as_large_as_least_squares_makes_it() -> None:
    """Columns made here, nuisances by differences of two models, starts from states of one: what `numpy.linalg`
    removes."""
    setting, fit = _setting(_noise(3))
    linear = setting.nominal
    _, x, v = _motion(linear)
    x, v = x[:, 0] / np.abs(x[:, 0]).max(), v[:, 0] / np.abs(v[:, 0]).max()
    odd = [x * abs(x), x**3, x**5, v * abs(v), v**3, np.tanh(20 * v)]
    laws = [*odd, x * x, x * v, v * v, x * x * v, x * v * v, abs(x) * v]
    columns = [_through(law, 0, linear).reshape(-1) for law in laws]
    nuisances, u = [], _drive(1)
    for k in range(len(setting.nuisances)):
        step = np.zeros(len(setting.nuisances))
        step[k] = 1e-5
        sides = [turned(linear, setting.nuisances, sign * step) for sign in (1.0, -1.0)]
        halves = [
            np.concatenate([simulate(discretise(m, RATE_HZ), u[s]) for s in (slice(0, 1500), slice(1500, None))])
            for m in sides
        ]
        nuisances.append((halves[0] - halves[1]).reshape(-1) / 2e-5)
    starts = []
    for s in (slice(0, 1500), slice(1500, None)):
        for axis, name in enumerate(AXES):
            t = np.arange(1500) / RATE_HZ
            damped = np.sqrt((2 * np.pi * FREQUENCY_HZ[name]) ** 2 - 81.0)
            for wave in (np.cos(damped * t), np.sin(damped * t)):
                column = np.zeros((ROWS, 2))
                column[s, axis] = np.exp(-9.0 * t) * wave
                starts.append(column.reshape(-1))
    prior = np.eye(len(nuisances)) / TOLERANCE
    zeros = np.zeros((len(nuisances), 1))

    def left(extra: list[Array]) -> float:
        table = np.column_stack([*nuisances, *starts, *extra])
        full = np.vstack([table, np.hstack([prior, np.tile(zeros, table.shape[1] - len(nuisances))])])
        goal = np.concatenate([_noise(3).reshape(-1), np.zeros(len(nuisances))])
        size = np.linalg.norm(full, axis=0)
        solution = np.linalg.lstsq(full / size, goal, rcond=1e-12)[0]
        return float(np.sum((goal - full / size @ solution) ** 2))

    one = _at(lacks_of_fit(setting, fit), "position and rate", "x")
    assert one.columns == len(laws)
    # the measured motion holds 10⁻⁵ of noise, and differences of models err as little
    assert one.gain == pytest.approx(left([]) - left(columns), rel=1e-3)


def test_noise_alone_makes_p_values_uniform() -> None:
    """Forty data sets of noise; each way's p-values pass Kolmogorov's test at one in ten thousand.

    The nominal numbers are wrong as they are said to be: by normal deviates of their tolerance.
    """
    seen: dict[tuple[str, str], list[float]] = {}
    setting, _ = _setting(_noise(0))
    still = np.zeros((2, 2))
    nuisances = np.concatenate(
        [sensitivities(setting.nominal, setting.nuisances, r.u, RATE_HZ, still) for r in setting.data.records]
    )
    for seed in range(40):
        wrong = TOLERANCE * np.random.default_rng(1000 + seed).standard_normal(nuisances.shape[2])
        setting, fit = _setting(_noise(100 + seed) + nuisances @ wrong)
        for one in lacks_of_fit(setting, fit):
            seen.setdefault((one.what, one.where), []).append(one.p_value())
    general = {(_words(what, reading), a) for reading in (False, True) for what in WAYS[reading] for a in AXES}
    assert general <= set(seen)
    slow = {(_words(what, reading), a) for reading in (False, True) for what in SLOWEST for a in AXES}
    for key in general - slow:
        assert kstest(seen[key], "uniform").pvalue > 1e-4, key
    # the level of the lowest rows counts as known from a dozen numbers, which is too careful where it is known
    assert np.mean(np.concatenate([seen[key] for key in slow]) < 0.1) < 0.1
    # waves are chosen by looking, and pay for all among which they are: rather too much than too little
    chosen = np.concatenate([values for key, values in seen.items() if key not in general])
    assert chosen.size > 40
    assert np.mean(chosen < 0.1) < 0.1


def test_coloured_noise_is_not_found_again_in_itself() -> None:
    """Noise of ten samples' memory and a tenth of the motion, whose colour and size nothing repeated tells.

    Of 20 data sets with 24 ways each, one in a thousand has a p-value below one in a million by chance.
    """
    for seed in range(20):
        noise = lfilter([1.0], [1.0, -0.9], _noise(400 + seed), axis=0)
        setting, fit = _setting(1e4 * noise)
        whitener = whitener_from(setting.data, list(fit.residuals))
        starts = starts_of(setting.data, setting.nominal, whitener)
        found = lacks_of_fit(replace(setting, whitener=whitener, starts=starts), fit)
        assert found[0].p_value() > ONE_IN_A_MILLION, seed


@cache
def _moved() -> tuple[Array, Array, Array, Array]:
    """Return command, position and rate (ROWS, 2), and the time as part of the whole (ROWS,)."""
    return *_motion(two_axes().linear()), (np.arange(ROWS) + 0.5) / ROWS


def _slipped(x: Array, yields: float) -> Array:
    """Return the force of a spring along `x` (n,) that slips at a deflection of `yields`."""
    force, at = np.zeros_like(x), 0.0
    for i in range(1, x.size):
        at = float(np.clip(at + x[i] - x[i - 1], -yields, yields))
        force[i] = at
    return force


Made = Callable[[Array, Array, Array, Array], Array]
"""From what `_moved` returns."""

FORCES: dict[str, Made] = {
    "position and rate": lambda u, x, v, t: abs(x[:, 0]) * np.sin(v[:, 0] / 2e7),
    "the command": lambda u, x, v, t: np.clip(u[:, 0], -2e4, 2e4),
    "large positions": lambda u, x, v, t: np.maximum(x[:, 0] - np.quantile(x[:, 0], 0.97), 0.0),
    "large commands": lambda u, x, v, t: u[:, 0] - np.clip(u[:, 0], -6e4, 6e4),
    "where the position turned": lambda u, x, v, t: _slipped(x[:, 0], 0.06 * np.ptp(x[:, 0])),
    "the command, over and over": lambda u, x, v, t: np.sin(9e3 * u[:, 0] / np.ptp(u[:, 0])),
    "past commands": lambda u, x, v, t: lfilter([0.02], [1.0, -0.98], u[:, 0]),
    "past positions": lambda u, x, v, t: lfilter([0.02], [1.0, -0.98], x[:, 0]),
    "time": lambda u, x, v, t: t,
    "command and motion with a gain that changes slowly": lambda u, x, v, t: t * x[:, 0],
    "the command with a gain that oscillates": lambda u, x, v, t: np.where((17.0 * t) % 1.0 < 0.2, u[:, 0], 0.0),
    "the position with a gain that oscillates": lambda u, x, v, t: np.sin(173.0 * t) * x[:, 0],
    "temperature": lambda u, x, v, t: (t - 0.5) * u[:, 0],
    "other degrees of freedom": lambda u, x, v, t: x[:, 1],
    "the position, over and over": lambda u, x, v, t: np.sin(150.0 * x[:, 0] / np.ptp(x[:, 0])),
}
ERRORS: dict[str, Made] = {
    "position and rate": lambda u, x, v, t: np.maximum(x[:, 0], 0.0),
    "large positions": lambda u, x, v, t: np.maximum(np.abs(x[:, 0]) - np.quantile(np.abs(x[:, 0]), 0.97), 0.0),
    "time": lambda u, x, v, t: np.where(t > 0.4, 1.0, 0.0),
    "the motion with a gain that changes slowly": lambda u, x, v, t: t * v[:, 0],
    "other readings": lambda u, x, v, t: x[:, 1],
    "the position, over and over": lambda u, x, v, t: np.sign(np.sin(150.0 * x[:, 0] / np.ptp(x[:, 0]))),
    "past commands, at one frequency": lambda u, x, v, t: lfilter(
        [1.0], [1.0, -2.0 * 0.98 * np.cos(0.7), 0.98**2], u[:, 0]
    ),
    "time, at one frequency": lambda u, x, v, t: np.sin(
        2.0 * np.pi * 123.4 * np.arange(ROWS) / RATE_HZ + np.where(t > 0.5, 2.0, 0.0)
    ),
}


@pytest.mark.parametrize(
    ("what", "reading"), [*((w, False) for w in FORCES), *((w, True) for w in ERRORS)], ids=lambda p: str(p)
)
def test_what_is_missing_is_heard_where_it_acts(what: str, reading: bool) -> None:
    """A change of 30 standard deviations, of a form that is not among the columns, stands out at x and not at y.

    What nuisances and start imitate of it leaves some tenths of its square, 900; one in a million takes about 50.
    """
    added = np.zeros((ROWS, 2))
    if reading:
        added[:, 0] = ERRORS[what](*_moved())
    else:
        added = _through(FORCES[what](*_moved()), 0, two_axes().linear())
    residual = _noise(7) + 30.0 * added / np.linalg.norm(added)
    found = lacks_of_fit(*_setting(residual))
    assert _at(found, what, "x", reading).p_value() < ONE_IN_A_MILLION
    assert found[0].where == "x"
    assert all(one.p_value() > ONE_IN_A_MILLION for one in found if one.where == "y")


def test_noise_that_is_loud_around_a_wave_is_no_wave() -> None:
    """A hump of noise at 150 Hz, forty times as strong as the whitener knows: its strongest line is one of many."""
    for seed in range(10):
        hump = lfilter([1.0], [1.0, -2.0 * 0.985 * np.cos(2.0 * np.pi * 0.15), 0.985**2], _noise(900 + seed), axis=0)
        found = lacks_of_fit(*_setting(_noise(700 + seed) + hump / np.std(hump)))
        lines = [one for one in found if "at one frequency" in one.what]
        assert lines and all(one.p_value() > ONE_IN_A_MILLION for one in lines), seed
        assert max(one.louder for one in lines) > 3.0


def test_what_random_causes_may_explain_is_not_held_against_a_model() -> None:
    """Sixty of the gain put down to them: 70 becomes 10 of 10 columns, of which there are as many in noise."""
    one = LackOfFit("a torque that follows time", "x", 70.0, 70.0, 10)
    assert one.p_value() < 1e-9
    assert one.p_value(60.0) == pytest.approx(0.44, abs=0.01)  # chi-square of 10 degrees of freedom above 10
    assert "a torque that follows time at x" in one.words()
