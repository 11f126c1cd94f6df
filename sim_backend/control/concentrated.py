"""The move whose spectrum is most concentrated: its velocity is the first Slepian window.

Of all moves that take `n_samples`, it has the largest part of its velocity's energy below concentration · rate /
n_samples. What lies above, no learning can correct that keeps away from the uncertain end of a response, so a move
should not contain it. Source: D. Slepian, Bell System Technical Journal 57 (1978).
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.errors import ConfigError

Array = NDArray[np.float64]


def concentrated_move(n_samples: int, concentration: float) -> Array:
    """Return a move (n_samples + 1,) from 0 to 1, both included.

    `concentration` is the half bandwidth of the velocity in units of rate / n_samples. Raises ConfigError for fewer
    than four samples, or a concentration that is not between 1 and a quarter of them.
    """
    if n_samples < 4 or not 1.0 <= concentration < 0.25 * n_samples:
        raise ConfigError(
            f"move of {n_samples} samples with concentration {concentration}; it needs four samples or more, and a "
            "concentration from 1 to a quarter of them"
        )
    velocity = scipy.signal.windows.dpss(n_samples, concentration)
    return np.concatenate([[0.0], np.cumsum(velocity) / velocity.sum()])


def bandwidth_hz(n_samples: int, concentration: float, rate_hz: float) -> float:
    """Return the frequency in Hz below which the move's velocity is concentrated."""
    return concentration * rate_hz / n_samples


def arrival_sample(move: Array, distance: float, tolerance: float) -> int:
    """Return from which sample on `distance` times the `move` (n,) stays within `tolerance` of its end."""
    outside = np.flatnonzero(abs(distance) * np.abs(move - move[-1]) > tolerance)
    return int(outside[-1]) + 1 if outside.size else 0
