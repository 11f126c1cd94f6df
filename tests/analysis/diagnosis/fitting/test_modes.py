"""A light mode that the nominal model has many widths off its place."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.fitting.balance import tune
from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.nominal.responses import coasting, played, simulate
from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.assembly import places_of, transducers_of
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, linear_model, one_axis

N, NOISE = 6000, 2e-6


@pytest.mark.parametrize("off", [-0.04, 0.02])
@pytest.mark.parametrize("ring", [3e-6, 1e-4])
def test_a_mode_that_rings_from_before_the_record_is_found_where_it_is(off: float, ring: float) -> None:
    """Both its own ring and the drive tell where it is: a ring that is taken for what the drive does hides it."""
    nominal = linear_model().with_(sigma_1_s=np.array([5.0, 0.4]))
    model = played(nominal.with_(omega_rad_s=nominal.omega_rad_s * np.array([1.0, 1.0 + off])), RATE_HZ)
    rng = np.random.default_rng(2)
    start = np.array([[0.0, 0.0], ring * rng.standard_normal(2) * np.array([1.0, nominal.omega_rad_s[1]])])
    u = drive(N, 2)
    y = simulate(model, u) + coasting(model, start, N) + NOISE * rng.standard_normal((N, 1))
    data = Dataset(RATE_HZ, (Record("r", u, y, (Window("p", 0, N, False, 0),)),))
    whitener = whitener_from(data, [y - simulate(played(nominal, RATE_HZ), u)])
    still = (np.zeros((2, 2)),)
    setting = Setting(
        data,
        nominal,
        (),
        places_of(one_axis()),
        transducers_of(one_axis()),
        nuisances_of(nominal, 0.03),
        whitener,
        starts_of(data, nominal, whitener),
        still,
        1,
    )
    setting, fit = tune(setting)
    (place,) = (k for k, n in enumerate(setting.nuisances) if n.mode == 1 and n.field == "omega_rad_s")
    # noise leaves some 10⁻⁵; a width of the mode is 3·10⁻⁴
    assert np.expm1(fit.change[place]) == pytest.approx(off, abs=2e-4)
