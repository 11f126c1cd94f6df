"""Table 6.7: percentage of chopped angles within 1.7 µrad of their mean."""

from __future__ import annotations

from analysis.paper.measured import Measured
from analysis.paper.rows import Ours

FORMS: dict[str, tuple[float, float]] = {
    "0:+8.5": (0.0, 8.5e-3),
    "0:-8.5": (0.0, -8.5e-3),
    "-8.5:+8.5": (-8.5e-3, 8.5e-3),
}
ALPHAS_DEG = (0, 120, 240)


def table_6_7(measured: Measured, strategy: str = "hybrid") -> dict[str, Ours]:
    """Return the percentage at both positions of every α and pair of end points, with its scatter between windows."""
    ours: dict[str, Ours] = {}
    for alpha in ALPHAS_DEG:
        for form, (start, stop) in FORMS.items():
            chop = measured.chop(float(alpha), start, stop, strategy)
            if chop is None:
                continue
            result = chop.stability()
            for i in range(2):
                share, std = result.inside_percent[i] / 100.0, result.inside_std[i] / 100.0
                ours[f"{alpha} {form} {i + 1}"] = Ours(float(share), float(std))
    return ours
