"""The basis functions: what they claim to resemble they resemble, at one scale over all records."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.diagnosis.candidates.signature import Motion
from analysis.diagnosis.verdict.basis import READINGS, TORQUES, Scene, scenes_of
from sim_backend.assembly import places_of
from tests.analysis.diagnosis.residuals import MODEL


def _scenes(sizes: tuple[float, ...] = (1.0, 0.25), rows: int = 4000, warm: bool = True) -> list[Scene]:
    rng = np.random.default_rng(0)
    motions = []
    for size in sizes:
        u = size * lfilter([1.0], [1.0, -0.7], rng.standard_normal((rows, 1)), axis=0)
        x = np.cumsum(u, axis=0)
        kelvin = 80.0 + np.linspace(0.0, 1.0, rows) if warm else None
        motions.append(Motion(u, x, x, np.gradient(x, axis=0), np.zeros_like(x), kelvin))
    return scenes_of(motions, places_of(MODEL))


@pytest.mark.parametrize("memory", [5.3, 17.0, 53.0, 170.0])
def test_any_first_order_lag_is_a_sum_of_its_neighbours_on_the_ladder(memory: float) -> None:
    """To a tenth, as the module says: what least squares leaves of a lag midway between two steps of the ladder."""
    scene = _scenes((1.0,))[0]
    columns = np.stack(TORQUES["past commands"](scene, 0), axis=1)
    a = np.exp(-1.0 / memory)
    lagged = lfilter([1.0 - a], [1.0, -a], scene.u[:, 0])
    left = lagged - columns @ np.linalg.lstsq(columns, lagged, rcond=None)[0]
    assert np.linalg.norm(left) < 0.1 * np.linalg.norm(lagged)


def test_one_law_is_one_column_in_loud_and_quiet_records() -> None:
    """The swing is that of all records: a cube in a record a quarter as loud is 64 times smaller, not as large."""
    loud, quiet = _scenes()
    assert np.max(np.abs(loud.x)) == pytest.approx(1.0)
    assert np.max(np.abs(quiet.u)) < 0.5
    cubes = [TORQUES["the command"](scene, 0)[2] for scene in (loud, quiet)]
    for cube, scene in zip(cubes, (loud, quiet), strict=True):
        np.testing.assert_allclose(cube, scene.u[:, 0] ** 3)


def test_time_runs_on_through_all_records() -> None:
    """Cosines over the joined rows are orthogonal (those of the discrete transform), the first is constant."""
    joined = np.concatenate([np.stack(READINGS["time"](scene, 0), axis=1) for scene in _scenes()])
    products = joined.T @ joined / joined.shape[0]
    np.testing.assert_allclose(products, np.diag([1.0] + [0.5] * (joined.shape[1] - 1)), atol=1e-12)


def test_without_a_temperature_or_another_axis_there_is_nothing_to_follow() -> None:
    scene = _scenes(warm=False)[0]
    assert TORQUES["temperature"](scene, 0) == []
    assert TORQUES["other degrees of freedom"](scene, 0) == []
    assert READINGS["other readings"](scene, 0) == []
    assert len(TORQUES["temperature"](_scenes()[0], 0)) == 4
