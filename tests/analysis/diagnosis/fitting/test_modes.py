"""A light mode that the nominal model has many widths off its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

from analysis.diagnosis.fitting.balance import tune
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.fitting.modes import is_bent, moved_mode
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import coasting, simulate
from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.assembly import places_of, transducers_of
from sim_backend.linear import ModalModel, played
from tests.analysis.diagnosis.two_modes import INERTIA, RATE_HZ, drive, linear_model, one_axis

N, NOISE = 6000, 2e-6
NOMINAL = linear_model().with_(sigma_1_s=np.array([5.0, 0.4]))


def setting_of(u: np.ndarray, y: np.ndarray, nominal: ModalModel = NOMINAL) -> Setting:
    """Return a setting of one record about the nominal model."""
    data = Dataset(RATE_HZ, (Record("r", u, y, (Window("p", 0, N, False, 0),)),))
    whitener = whitener_from(data, [y - simulate(played(nominal, RATE_HZ), u)])
    return Setting(
        data,
        nominal,
        (),
        places_of(one_axis()),
        transducers_of(one_axis()),
        nuisances_of(nominal, 0.03),
        whitener,
        starts_of(data, nominal, whitener),
        (np.zeros((2, 2)),),
        1,
    )


@pytest.mark.parametrize("off", [-0.04, 0.02])
@pytest.mark.parametrize("ring", [3e-6, 1e-4])
def test_a_mode_that_rings_from_before_the_record_is_found_where_it_is(off: float, ring: float) -> None:
    """Both its own ring and the drive tell where it is: a ring that is taken for what the drive does hides it."""
    nominal = NOMINAL
    model = played(nominal.with_(omega_rad_s=nominal.omega_rad_s * np.array([1.0, 1.0 + off])), RATE_HZ)
    rng = np.random.default_rng(2)
    start = np.array([[0.0, 0.0], ring * rng.standard_normal(2) * np.array([1.0, nominal.omega_rad_s[1]])])
    u = drive(N, 2)
    y = simulate(model, u) + coasting(model, start, N) + NOISE * rng.standard_normal((N, 1))
    setting, fit = tune(setting_of(u, y))
    (place,) = (k for k, n in enumerate(setting.nuisances) if n.mode == 1 and n.field == "omega_rad_s")
    # noise leaves some 10⁻⁵; a width of the mode is 3·10⁻⁴
    assert np.expm1(fit.change[place]) == pytest.approx(off, abs=2e-4)


def test_a_mode_that_a_sweep_passes_just_before_it_ends_is_found() -> None:
    """Only the last part of the record shows it: a taper over the whole record would hide that part."""
    t = np.arange(N) / RATE_HZ
    hz, end = NOMINAL.omega_rad_s[1] * 1.04 / (2.0 * np.pi), 0.96 * t[-1]
    u = 0.05 * scipy.signal.chirp(t, 5.0, end, hz, method="logarithmic")[:, None]
    there = NOMINAL.omega_rad_s * np.array([1.0, 1.04])
    noise = 300.0 * NOISE * np.random.default_rng(5).standard_normal((N, 1))
    setting = setting_of(u, simulate(played(NOMINAL.with_(omega_rad_s=there), RATE_HZ), u) + noise)
    (place,) = (k for k, n in enumerate(setting.nuisances) if n.mode == 1 and n.field == "omega_rad_s")
    setting, fit = tune(setting)
    assert np.expm1(fit.change[place]) == pytest.approx(0.04, abs=4.0 * fit.change_std[place])
    assert fit.change_std[place] < 1e-3


def test_a_mode_that_was_bent_on_its_way_is_tried_unbent_where_it_has_come_to() -> None:
    """At its right frequency with seven times its damping: no other place is better, and a descent may stay."""
    u = drive(N, 2)
    y = simulate(played(NOMINAL, RATE_HZ), u) + NOISE * np.random.default_rng(3).standard_normal((N, 1))
    setting = setting_of(u, y)
    own = {n.field: k for k, n in enumerate(setting.nuisances) if n.mode == 1}
    _, unbent = tune(setting)
    assert moved_mode(setting, unbent, 1) == []
    change = unbent.change.copy()
    change[own["sigma_1_s"]] = 2.0
    bent = refit(replace(setting, begin=change), (), np.zeros(0), change, steps=0)
    (moved,) = moved_mode(setting, bent, 1)
    assert moved[own["sigma_1_s"]] == 0.0
    assert moved[own["omega_rad_s"]] == pytest.approx(bent.change[own["omega_rad_s"]], abs=2e-4)


def test_a_mode_is_where_a_whole_fit_has_it_although_something_louder_rings_elsewhere() -> None:
    """What rings by itself leaves least of a mode that may begin anywhere; what the drive does tells them apart."""
    u, t = drive(N, 2), np.arange(N) / RATE_HZ
    there, louder = NOMINAL.omega_rad_s * np.array([[1.0, 1.03], [1.0, 1.06]])
    ring = 2e-4 * np.exp(-NOMINAL.sigma_1_s[1] * t) * np.sin(louder[1] * t)
    noise = NOISE * np.random.default_rng(3).standard_normal((N, 1))
    setting = setting_of(u, simulate(played(NOMINAL.with_(omega_rad_s=there), RATE_HZ), u) + ring[:, None] + noise)
    (place,) = (k for k, n in enumerate(setting.nuisances) if n.mode == 1 and n.field == "omega_rad_s")
    fit = refit(setting, (), np.zeros(0), np.zeros(len(setting.nuisances)), steps=0)
    tried = [float(change[place]) for change in moved_mode(setting, fit, 1)]
    assert tried[:2] == pytest.approx(np.log([1.06, 1.03]), abs=1e-3)
    assert np.expm1(tune(setting)[1].change[place]) == pytest.approx(0.03, abs=1e-4)


def test_light_modes_that_bend_each_other_are_found_where_they_are() -> None:
    """A descent makes each up for the others in their wrong places; none is then better elsewhere by itself.

    The seed is the first of those from 0 on with which none of the other ways leads there.
    """
    nominal = ModalModel(
        omega_rad_s=2.0 * np.pi * np.array([240.0, 228.3, 276.7]),
        sigma_1_s=np.array([2.46, 12.9, 70.3]),
        b=np.array([[1.0], [2.48], [0.69]]) / INERTIA,
        b_direct=np.zeros((3, 1)),
        c=np.ones((1, 3)),
        c_rate=np.zeros((1, 3)),
        d=np.zeros((1, 1)),
        delay_s=np.zeros(1),
    )
    off, rng, period = np.array([0.96, 1.03, 1.02]), np.random.default_rng(4), N // 4
    lines = np.arange(5, 500, 7)
    spectrum = np.zeros(period // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
    wave = np.tile(np.fft.irfft(spectrum), 4)
    u = 0.05 * wave[:, None] / wave.std()
    y = simulate(played(nominal.with_(omega_rad_s=nominal.omega_rad_s * off), RATE_HZ), u)
    setting = setting_of(u, y + NOISE * rng.standard_normal((N, 1)), nominal)
    known = Whitener(np.array([[1.0 / NOISE]]), True)  # as periods that repeat show it
    starts = starts_of(setting.data, nominal, known)
    setting = replace(setting, whitener=known, starts=starts, states=(np.zeros((3, 2)),))
    descended = refit(setting, (), np.zeros(0), np.zeros(len(setting.nuisances)))
    assert is_bent(setting, descended.change)  # or this is no example
    change = tune(setting)[1].change
    assert not is_bent(setting, change)
    places = [k for k, nuisance in enumerate(setting.nuisances) if nuisance.field == "omega_rad_s"]
    assert np.exp(change[places]) == pytest.approx(off, abs=1e-3)
