"""The frequency response of every axis that was swept: points, the fit to them, the design model."""

from __future__ import annotations

import numpy as np

from analysis.pages.explorer import Array, Explorer, Facts, Panel, Series, View
from analysis.paper.measured import RATE_HZ, Measured
from sim_backend.axis_names import axis_text
from sim_backend.linear import ComplexArray, ModalModel

AXES = ("theta_x", "theta_y", "z")
UNITS = {"theta_x": "mrad/N m", "theta_y": "mrad/N m", "z": "mm/N"}
CURVE_POINTS = 700


def bode(measured: Measured) -> Explorer | None:
    """Return magnitude and phase by axis; None where the campaign holds no sweep."""
    views: dict[tuple[str, ...], View] = {
        (axis_text(axis),): view for axis in AXES if (view := _view(measured, axis)) is not None
    }
    if not views:
        return None
    return Explorer(
        "bode",
        "Frequency response",
        "Stepped sine; the modal fit to it and the design model, both behind the bench's zero-order hold.",
        {"axis": tuple(chosen[0] for chosen in views)},
        views,
    )


def _view(measured: Measured, axis: str) -> View | None:
    sweep = measured.sweep(axis)
    if sweep is None:
        return None
    f = np.geomspace(0.9 * sweep.frequency_hz[0], min(1.1 * sweep.frequency_hz[-1], 0.5 * RATE_HZ), CURVE_POINTS)
    fit, model = measured.fit(axis), measured.design_axis(axis)
    design = _response(model, f)
    # of all whole turns the one nearest to the design model, which has no gaps between its frequencies
    near = np.interp(sweep.frequency_hz, f, _degrees(design))
    turned = near + np.rad2deg(np.angle(sweep.response * np.exp(-1j * np.deg2rad(near))))
    magnitude = [Series.of("sweep", sweep.frequency_hz, _db(sweep.response), "points")]
    phase = [Series.of("sweep", sweep.frequency_hz, turned, "points")]
    for name, response in (("fit", None if fit is None else _response(fit.model, f)), ("design model", design)):
        if response is not None:
            magnitude.append(Series.of(name, f, _db(response)))
            phase.append(Series.of(name, f, _degrees(response)))
    which = "mode of the design model" if fit is None else "mode of the fit"
    return View(
        (
            Panel("frequency (Hz)", f"magnitude (dB re 1 {UNITS[axis]})", tuple(magnitude), log_x=True),
            Panel("frequency (Hz)", "phase (°)", tuple(phase), log_x=True),
        ),
        Facts((which, "frequency (Hz)", "damping ratio (%)"), _modes(model if fit is None else fit.model)),
    )


def _modes(model: ModalModel) -> tuple[tuple[str, tuple[float | None, ...]], ...]:
    """Every vibrating mode, lowest first: its natural frequency and damping ratio."""
    pairs = sorted(zip(model.omega_rad_s, model.sigma_1_s, strict=True))
    vibrating = [(omega, sigma) for omega, sigma in pairs if sigma < omega]
    return tuple(
        (str(i), (omega / (2.0 * np.pi), 100.0 * sigma / omega)) for i, (omega, sigma) in enumerate(vibrating, start=1)
    )


def _response(model: ModalModel, f: Array) -> ComplexArray:
    return model.frequency_response(f, RATE_HZ)[:, 0, 0]


def _db(response: ComplexArray) -> Array:
    return np.asarray(20.0 * np.log10(np.abs(response) * 1e3))


def _degrees(response: ComplexArray) -> Array:
    return np.asarray(np.rad2deg(np.unwrap(np.angle(response))))
