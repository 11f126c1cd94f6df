"""What one effect adds along given signals, through the very loop that the simulation and the screening use."""

import numpy as np

from sim_backend import kernel
from sim_backend.assembly import Places
from sim_backend.wiring import effects_of

PLACES = Places(("theta_x", "theta_y"), ("theta_x", "theta_y"), (), (), np.zeros((0, 2)), np.eye(2), np.eye(2))


def along(effect, *, signal=None, position=None, rate=None, aux=None, dt_s=1e-4):
    """Return the contribution (n,) of a fresh `effect`; signals that are not given are zero."""
    given = {"signal": signal, "position": position, "rate": rate, "aux": aux}
    n = next(len(v) for v in given.values() if v is not None)
    signal, position, rate, aux = (
        np.zeros(n) if v is None else np.ascontiguousarray(v, dtype=float) for v in given.values()
    )
    fx, _ = effects_of([effect], PLACES)
    out = np.empty(n)
    kernel.contribution_along(fx, 0, signal, position, rate, aux, dt_s, out)
    assert np.all(fx.states[effect.n_state :] == 0.0), "the step wrote beyond its own state"
    return out
