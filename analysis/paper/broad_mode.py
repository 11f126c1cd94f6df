"""The paper's order: one broad mode instead of two resonances that a sweep resolves; section 6.2.2.

"A broad resonance at 1440 Hz (to account for the two sharp resonances between 1.4 and 1.5 kHz)": how the authors found
its numbers is not printed. Far from both, two modes K/(s² + 2 σ s + ω²) act as one with the sum of their K and with the
means of ω² and σ, weighted by K: the first terms of the expansion in 1/s agree.
"""

from __future__ import annotations

import numpy as np

from sim_backend.linear import ModalModel


def nearest_pair(model: ModalModel) -> tuple[int, int]:
    """Return the indices, lower frequency first, of the two modes whose frequencies are nearest in ratio.

    Raises ValueError for a model of fewer than two.
    """
    if model.n_blocks < 2:
        raise ValueError(f"a pair of a model with {model.n_blocks} modes; it needs two")
    order = np.argsort(model.omega_rad_s)
    rising = model.omega_rad_s[order]
    i = int(np.argmin(rising[1:] / rising[:-1]))
    return int(order[i]), int(order[i + 1])


def broad_mode(model: ModalModel) -> ModalModel | None:
    """Return a model of one input and output, its `nearest_pair` replaced by the one mode that acts as both from afar.

    None where the two have opposite signs: no single mode stands for them.
    """
    pair = list(nearest_pair(model))
    share = model.c[0, pair] * model.b[pair, 0]
    if share[0] * share[1] <= 0.0:
        return None
    kept = [i for i in range(model.n_blocks) if i not in pair]
    part = share / share.sum()
    low = pair[0]
    return model.with_(
        omega_rad_s=np.append(model.omega_rad_s[kept], np.sqrt(part @ model.omega_rad_s[pair] ** 2)),
        sigma_1_s=np.append(model.sigma_1_s[kept], part @ model.sigma_1_s[pair]),
        b=np.append(model.b[kept], model.b[[low]], axis=0),
        b_direct=np.append(model.b_direct[kept], model.b_direct[[low]], axis=0),
        c=np.append(model.c[:, kept], [[share.sum() / model.b[low, 0]]], axis=1),
        c_rate=np.append(model.c_rate[:, kept], [[part @ model.c_rate[0, pair]]], axis=1),
    )
