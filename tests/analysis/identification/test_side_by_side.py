"""Models put side by side: whose inputs and outputs are whose."""

from __future__ import annotations

import numpy as np

from analysis.identification.identified import side_by_side
from sim_backend.linear import ModalModel


def model(n_u: int, n_y: int, delay_s: list[float], seed: int) -> ModalModel:
    rng = np.random.default_rng(seed)
    return ModalModel(
        omega_rad_s=rng.uniform(10.0, 100.0, 2),
        sigma_1_s=rng.uniform(1.0, 5.0, 2),
        b=rng.standard_normal((2, n_u)),
        b_direct=1e-2 * rng.standard_normal((2, n_u)),
        c=rng.standard_normal((n_y, 2)),
        c_rate=1e-2 * rng.standard_normal((n_y, 2)),
        d=1e-3 * rng.standard_normal((n_y, n_u)),
        delay_s=np.array(delay_s),
    )


def test_the_whole_answers_as_its_parts_do() -> None:
    first, second = model(2, 1, [1e-3, 2e-3], 1), model(1, 2, [2e-3], 2)
    both = side_by_side([first, second], [[0, 2], [2]], [[1], [2, 0]])
    f_hz = np.array([0.5, 3.0, 11.0])
    whole = both.frequency_response(f_hz)
    assert whole.shape == (3, 3, 3)
    np.testing.assert_allclose(whole[:, 1, [0, 2]], first.frequency_response(f_hz)[:, 0], rtol=1e-12)
    np.testing.assert_allclose(whole[:, [2, 0], 2], second.frequency_response(f_hz)[:, :, 0], rtol=1e-12)
    assert not whole[:, :, 1].any() and not whole[:, [0, 2], 0].any()


def test_an_input_of_several_is_late_by_the_largest_of_their_delays() -> None:
    both = side_by_side([model(1, 1, [0.0], 1), model(1, 1, [3e-3], 2)], [[0], [0]], [[0], [1]])
    assert both.delay_s.tolist() == [3e-3]
