"""Table 6.2: transfer functions from the fits to the sweeps, as poles and zeros and as coefficients."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from analysis.linear.transfer import polynomials
from analysis.paper.measured import MODES, Measured
from analysis.paper.numbers import paper_tables
from analysis.paper.rows import Ours
from sim_backend.linear import ModalModel
from sim_backend.polynomial import scaled_roots

PER_MILLI = 1e3
"""The paper's numerators are in mrad and mm."""


def table_6_2(measured: Measured) -> dict[str, Ours]:
    """Return frequency and damping ratio of every pair of poles and zeros, and the gains at rest."""
    ours: dict[str, Ours] = {}
    for axis, model in _fits(measured):
        numerator, denominator = polynomials(model)
        ours[f"{axis} gain"] = Ours(float(numerator[0] / denominator[0]))
        for kind, found in (("pole", _upper(denominator)), ("zero", _upper(numerator))):
            for i, root in _matched(axis, kind, found):
                ours[f"{axis} {kind} {i} hz"] = Ours(float(np.abs(root)) / (2.0 * np.pi))
                ours[f"{axis} {kind} {i} zeta"] = Ours(float(-root.real / np.abs(root)))
    return ours


def table_6_2_coefficients(measured: Measured) -> dict[str, Ours]:
    """Return every printed coefficient of the identified models, numerators in mrad or mm."""
    wanted = {n.key for n in paper_tables()["6.2-coefficients"].rows}
    ours: dict[str, Ours] = {}
    for axis, model in _fits(measured):
        numerator, denominator = polynomials(model)
        for letter, coefficients in (("a", numerator * PER_MILLI), ("b", denominator)):
            for power, value in enumerate(coefficients):
                key = f"{axis} {letter}{power}"
                if key in wanted:
                    ours[key] = Ours(float(value))
    return ours


def _fits(measured: Measured) -> Iterator[tuple[str, ModalModel]]:
    for axis in MODES:
        model = measured.paper_model(axis)
        if model is not None:
            yield axis, model


def _upper(rising: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Roots with a positive imaginary part of a polynomial (n,) in rising powers."""
    trimmed = np.trim_zeros(rising[::-1], "f")
    roots = scaled_roots(trimmed) if trimmed.size > 1 else np.empty(0, dtype=complex)
    return np.asarray(roots[roots.imag > 0.0])


def _matched(axis: str, kind: str, found: NDArray[np.complex128]) -> Iterator[tuple[int, complex]]:
    """Pair printed roots with found ones: poles by their order, zeros, of which a fit has more, by the nearest."""
    printed = {n.key: n.value for n in paper_tables()["6.2"].rows if n.key.startswith(f"{axis} {kind}")}
    ordered = found[np.argsort(np.abs(found))]
    for i in range(1, len(printed) // 2 + 1):
        if kind == "pole" and i <= ordered.size:
            yield i, complex(ordered[i - 1])
        elif kind == "zero" and ordered.size:
            omega = 2.0 * np.pi * float(printed[f"{axis} zero {i} hz"] or 0.0)
            yield i, complex(ordered[np.argmin(np.abs(np.abs(ordered) - omega))])
