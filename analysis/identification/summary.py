"""An identification in the field's words: axis, frequency, damping and gain of every mode, each with its deviation."""

from __future__ import annotations

import math

from analysis.identification.identified import Identification
from analysis.identification.response_curves import ResponseCurve

HEADS = ("axis", "frequency, Hz", "decay rate, s⁻¹", "damping ratio ζ")


def modes_table(found: Identification) -> list[tuple[str, ...]]:
    """Return a row of text per mode under `HEADS`, by rising frequency."""
    return [
        (
            axis,
            f"{mode['frequency_hz']:.4f} ± {mode['frequency_std_hz']:.2g}",
            f"{mode['decay_rate_1_s']:.4g} ± {mode['decay_rate_std_1_s']:.2g}",
            _damping(mode),
        )
        for axis, mode in zip(found.axes, found.modes, strict=True)
    ]


def facts(found: Identification) -> list[tuple[str, str]]:
    """Return name and text of everything else that was found: method, gains, delays, quality of the fit."""
    told = [("method", found.method), *_gains(found), *_delays(found)]
    if found.chi2_per_dof is not None:
        told.append(("misfit over noise", f"{found.chi2_per_dof:.3g} (χ² per degree of freedom)"))
    levels = (("noise", found.noise, found.noise_is_bound), ("nonlinear distortion", found.distortion, False))
    told += [
        (name, f"{'at most ' if bound else ''}{100.0 * value:.3f} % of the output")
        for name, value, bound in levels
        if value is not None
    ]
    told += [(f"{one.input} → {one.output}", _uncertainty(one)) for one in found.response]
    told += [(f"error on {one.segment}", f"{100.0 * one.total:.2f} %") for one in found.held_out]
    return told


def _uncertainty(curve: ResponseCurve) -> str:
    """State the range over which a response was measured, and its uncertainty at the median line."""
    relative = sorted(
        std / size
        for std, size in zip(curve.std.tolist(), curve.magnitude.tolist(), strict=True)
        if size and math.isfinite(std)
    )
    f = curve.frequency_hz
    middle = f"{100.0 * relative[len(relative) // 2]:.2f} %" if relative else "unknown"
    return f"response at {f.size} lines, {f[0]:.4g}–{f[-1]:.4g} Hz, standard deviation {middle} (median)"


def _damping(mode: dict[str, float]) -> str:
    """Return ζ = σ / ω of a mode with its standard deviation; a rigid body has none."""
    omega = 2.0 * math.pi * mode["frequency_hz"]
    if omega == 0.0:
        return ""
    zeta = mode["decay_rate_1_s"] / omega
    relative = math.hypot(
        mode["decay_rate_std_1_s"] / max(mode["decay_rate_1_s"], 1e-300),
        mode["frequency_std_hz"] / mode["frequency_hz"],
    )
    return f"{zeta:.4g} ± {zeta * relative:.2g}"


def _gains(found: Identification) -> list[tuple[str, str]]:
    """Return the static gain of every entry with its deviation and unit."""
    return [
        (
            f"static gain {one.input} → {one.output}",
            f"{one.value:.4g}{'' if one.std is None else f' ± {one.std:.2g}'} {one.unit}",
        )
        for one in found.gains
    ]


def _delays(found: Identification) -> list[tuple[str, str]]:
    told = []
    for port in found.model.inputs:
        delay = found.model.delay_s.get(port.name, 0.0)
        value, std = (delay, 0.0) if isinstance(delay, float | int) else (delay.value, delay.std or 0.0)
        if value:
            told.append((f"delay of {port.name}", f"{1e3 * value:.4g} ms" + (f" ± {1e3 * std:.2g} ms" if std else "")))
    return told
