"""Whole samples of delay are told by a regression, modes whose colour passes for noise by what drives them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.identification.determined import determinedness
from analysis.identification.input_delay import fit_whole_delay
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records
from analysis.identification.whitening import holds_inputs
from analysis.identification.whole_delay import beginning, freed
from benchmarks.peers_plants import KINDS, Record, drawn

ORDERS = (1, 2, 3, 4, 5, 6)


def record(name: str, seed: int) -> Record:
    (kind,) = [kind for kind in KINDS if kind.name == name]
    return drawn(kind, seed)


def resonant(u: np.ndarray, late: int) -> np.ndarray:
    """One mode of a difference equation, which acts at the next sample and `late` samples after."""
    return np.asarray(lfilter(np.r_[np.zeros(late + 1), 0.5, 0.3], [1.0, -1.7, 0.95], u))


@pytest.mark.parametrize("late", [0, 1, 9])
def test_a_regression_tells_when_an_input_begins_to_act(late: int) -> None:
    rng = np.random.default_rng(late)
    u = rng.standard_normal((4000, 1))
    y = resonant(u[:, 0], late)[:, None]
    y += 0.01 * y.std() * rng.standard_normal(y.shape)
    assert beginning([u], [y]).whole.tolist() == [late]


def test_each_of_two_inputs_has_a_delay_of_its_own() -> None:
    rng = np.random.default_rng(5)
    u = rng.standard_normal((6000, 2))
    y = np.stack([resonant(u[:, 0], 2) + resonant(u[:, 1], 7), resonant(u[:, 0], 2) - resonant(u[:, 1], 7)], axis=1)
    y += 0.01 * y.std(axis=0) * rng.standard_normal(y.shape)
    assert beginning([u], [y]).whole.tolist() == [2, 7]


def test_records_too_short_to_tell_have_no_delay() -> None:
    u = np.random.default_rng(6).standard_normal((12, 1))
    assert beginning([u], [u]).whole.tolist() == [0]


def test_freed_records_put_each_input_beside_what_it_causes() -> None:
    u, y = np.arange(20.0).reshape(10, 2), np.arange(10.0)[:, None]
    (moved,), (rest,) = freed([u], [y], np.array([1, 3]), 3)
    assert moved[0].tolist() == [u[2, 0], u[0, 1]] and rest[0, 0] == 3.0
    assert moved.shape == (7, 2)


def test_modes_behind_a_delay_are_counted_without_imitations_of_it() -> None:
    plant = record("two modes, whole delay", 11)
    u, y = [plant.inputs[: plant.fitted]], [plant.outputs[: plant.fitted]]

    def search(us: Sequence[np.ndarray], ys: Sequence[np.ndarray]) -> TimeFit:
        return fit_records(us, ys, plant.rate_hz, ORDERS, rigid_bodies=None)

    fit = fit_whole_delay(search, u, y, plant.rate_hz, ORDERS, Structure())
    assert fit.model.n_blocks == plant.kind.modes
    assert plant.kind.late[0] <= fit.model.delay_s[0] * plant.rate_hz <= plant.kind.late[1]


@pytest.mark.parametrize(("name", "seed"), [("four light modes", 11), ("six modes to 2 kHz", 14)])
def test_two_modes_are_found_of_which_one_alone_is_no_better(name: str, seed: int) -> None:
    """The search for the number of modes had ended at two of the four, and at four of the six."""
    plant = record(name, seed)
    fit = fit_records(
        [plant.inputs[: plant.fitted]], [plant.outputs[: plant.fitted]], plant.rate_hz, ORDERS, rigid_bodies=None
    )
    assert fit.model.n_blocks == plant.kind.modes
    assert np.min(determinedness(fit)) > 100.0


def test_what_an_input_drives_is_told_from_noise_of_the_same_colour() -> None:
    rng = np.random.default_rng(7)
    u, other = rng.standard_normal((2, 6000, 1))
    driven, coloured = (resonant(x[:, 0], 0)[:, None] for x in (u, other))
    # a part of 0.04 of what is new; chance gives 21 lags of 6000 rows 0.011 once in a million
    assert holds_inputs([0.2 * driven + coloured], [u])
    assert not holds_inputs([coloured], [u])
