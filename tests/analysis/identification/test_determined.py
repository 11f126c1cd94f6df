"""What a mode is worth to the data: oscillations by frequency and damping, overdamped blocks by a pole that is seen."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.identification.determined import SIGNIFICANT, determinedness, swinging, without_undetermined
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records
from benchmarks.peers_plants import KINDS, drawn
from sim_backend.linear import ModalModel
from tests.end_to_end.linear_bench import mode_and_lag, oscillator, played

Array = NDArray[np.float64]

RATE_HZ, ROWS = 100.0, 3000


def _fit(y: Array, u: Array, blocks: int, seed: int = 7) -> TimeFit:
    noise = 5e-3 * y.std() * np.random.default_rng(seed).standard_normal(y.shape)
    return fit_records([u], [y + noise], RATE_HZ, blocks)


def _drive() -> Array:
    return np.random.default_rng(2).standard_normal((ROWS, 1))


def test_a_lag_is_known_by_its_one_pole() -> None:
    """Of a first-order system in a second-order block a zero cancels one pole, wherever that is."""
    u = _drive()
    fit = _fit(played(np.array([[-4.0]]), np.array([[4.0]]), np.eye(1), u, RATE_HZ), u, 1)
    slow = -np.max(fit.model.poles_1_s().real)
    fast = -np.min(fit.model.poles_1_s().real)
    assert min(abs(slow - 4.0), abs(fast - 4.0)) < 0.2
    assert determinedness(fit)[0] > 10.0


def test_a_mode_behind_a_lag_keeps_both() -> None:
    """Three poles need two blocks, of which one is half made up; the record is that of the end-to-end test."""
    record = mode_and_lag()
    u, y = [record.drives[:375]], [record.readings[:375]]

    def again(n: int, start: object) -> TimeFit:
        return fit_records(u, y, record.rate_hz, n, start=start)  # type: ignore[arg-type]

    fit = without_undetermined(fit_records(u, y, record.rate_hz, (1, 2, 3)), (1, 2, 3), again)
    poles = np.sort_complex(fit.model.poles_1_s().ravel())
    assert np.min(np.abs(poles + 1.0 / 0.3)) < 0.1
    assert np.min(np.abs(poles - np.roots([1.0, 2.0 * 0.15 * 2.0 * np.pi * 1.4, (2.0 * np.pi * 1.4) ** 2])[0])) < 0.05


def test_a_lag_whose_two_poles_have_met_begins_anew_with_one_far_away() -> None:
    """Where both poles of a block meet neither is known: this mode had lost its amplifier's to a delay."""
    (kind,) = (one for one in KINDS if one.name == "one mode, amplifier pole")
    record = drawn(kind, 90311)
    u, y = [record.inputs[: record.fitted]], [record.outputs[: record.fitted]]

    def again(n: int, start: ModalModel | None) -> TimeFit:
        return fit_records(u, y, record.rate_hz, n, structure=Structure(feedthrough=True), start=start)

    met = again(2, None)
    double = np.array([2.0 * np.pi * 6.116, 2.0 * np.pi * 30.7])
    met = again(2, met.model.with_(omega_rad_s=double, sigma_1_s=double * np.array([0.0448, 1.004])))
    assert np.min(determinedness(met)) < SIGNIFICANT
    fit = without_undetermined(met, (1, 2), again)
    assert fit.model.n_blocks == 2 and np.min(determinedness(fit)) > SIGNIFICANT and fit.dropped == ()
    assert np.min(np.abs(fit.model.poles_1_s() + 164.7)) < 5.0


def test_a_mode_that_is_not_there_is_not_known() -> None:
    u = _drive()
    fit = _fit(played(oscillator(8.0, 0.05), np.array([[0.0], [2500.0]]), np.eye(1, 2), u, RATE_HZ), u, 2)
    known = np.sort(determinedness(fit))
    assert known[0] < SIGNIFICANT < 100.0 < known[1]


@pytest.mark.parametrize(("frequency_hz", "damping_ratio", "there"), [(9.0, 0.05, True), (1.5, 3.0, False)])
def test_beside_its_inertia_a_free_axis_has_what_swings(frequency_hz: float, damping_ratio: float, there: bool) -> None:
    u = _drive()
    axis = played(np.array([[0.0, 1.0], [0.0, -1.5]]), np.array([[0.0], [1.0]]), np.eye(1, 2), u, RATE_HZ)
    more = played(oscillator(frequency_hz, damping_ratio), np.array([[0.0], [1.0]]), np.eye(1, 2), u, RATE_HZ)
    known = swinging(_fit(axis + more, u, 2))
    assert np.sum(np.isinf(known)) == 1
    assert (np.min(known) > SIGNIFICANT) == there
