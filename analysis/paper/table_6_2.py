"""Table 6.2: transfer-function coefficients of the three axes, from the fits to the sweeps."""

from __future__ import annotations

from analysis.linear.transfer import polynomials
from analysis.paper.measured import MODES, Measured
from analysis.paper.numbers import paper_tables
from analysis.paper.rows import Ours

PER_MILLI = 1e3
"""The paper's numerators are in mrad and mm."""


def table_6_2(measured: Measured) -> dict[str, Ours]:
    """Return every printed coefficient of the identified models, numerators in mrad or mm."""
    wanted = {n.key for n in paper_tables()["6.2"].rows}
    ours: dict[str, Ours] = {}
    for axis in MODES:
        fit = measured.fit(axis)
        if fit is None:
            continue
        numerator, denominator = polynomials(fit.model)
        for letter, coefficients in (("a", numerator * PER_MILLI), ("b", denominator)):
            for power, value in enumerate(coefficients):
                key = f"{axis} {letter}{power}"
                if key in wanted:
                    ours[key] = Ours(float(value))
    return ours
