"""The static gain of a model with its standard deviation, by the covariance of all numbers that it is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.identification.response_fit import RationalFit
from analysis.identification.timefit import TimeFit
from sim_backend.linear import Array, ModalModel


@dataclass(frozen=True)
class StaticGain:
    """The response of `output` to a constant `input`, in `unit`; `std` is None where it is not known."""

    input: str
    output: str
    unit: str
    value: float
    std: float | None


def static_gain(model: ModalModel) -> Array | None:
    """Return the response at rest (n_y, n_u); None of a model with a rigid body, which has none."""
    if np.any(model.omega_rad_s == 0.0):
        return None
    return np.asarray(model.with_(delay_s=0.0 * model.delay_s).frequency_response(np.zeros(1))[0].real)


def static_gain_std(fit: TimeFit | RationalFit) -> Array | None:
    """Return the standard deviation of the static gain (n_y, n_u) of a fit; None where there is no gain.

    Frequency and participation of a mode are correlated: their deviations alone would give another one. By blocks the
    gain is c (2 sigma b_direct + b)' / omega² - c_rate b_direct', beside D.
    """
    model, layout = fit.model, fit.layout
    if np.any(model.omega_rad_s == 0.0):
        return None
    omega2, sigma = model.omega_rad_s**2, model.sigma_1_s
    force = 2.0 * sigma[:, None] * model.b_direct + model.b
    at = {name: layout.index(name) for name in ("log_omega", "log_sigma", "b", "b_direct", "c", "c_rate", "d")}
    std = np.zeros((model.n_outputs, model.n_inputs))
    for y, u in np.ndindex(std.shape):
        slope = np.zeros(layout.size)
        c = model.c[y]
        slope[at["log_omega"]] = -2.0 * c * force[:, u] / omega2
        slope[at["log_sigma"]] = 2.0 * sigma * c * model.b_direct[:, u] / omega2
        slope[at["b"][:, u]] = c / omega2
        slope[at["b_direct"][:, u]] = 2.0 * sigma * c / omega2 - model.c_rate[y]
        slope[at["c"][y]] = force[:, u] / omega2
        slope[at["c_rate"][y]] = -model.b_direct[:, u]
        slope[at["d"][y, u]] = 1.0
        std[y, u] = np.sqrt(max(float(slope @ fit.covariance @ slope), 0.0))
    return std
