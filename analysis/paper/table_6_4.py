"""Table 6.4: what modes that a feed-forward leaves out do to settling; computed from design models, without a bench."""

from __future__ import annotations

from analysis.paper.measured import RATE_HZ, Measured
from analysis.paper.move_length import calibrated_samples
from analysis.paper.rows import Ours
from analysis.paper.step_rows import PLANTS, rows_at, step_settling
from campaigns.strategies.design import Design


def table_6_4(measured: Measured) -> dict[str, Ours]:
    """Return overshoot and settling of every plant under the feed-forward for the 2nd-order one; section 6.3.1."""
    samples, ours = calibrated_samples(), dict[str, Ours]()
    for key, (overshoot, time_s) in rows_at(samples).items():
        ours[f"{key} overshoot"] = Ours(overshoot)
        ours[f"{key} settling"] = Ours(time_s)
    complete = Design.load(PLANTS["complete"], RATE_HZ)
    own = step_settling(complete.axis("theta_x"), complete.unit_step("theta_x", samples))
    ours["own settling"] = Ours(float(own.time_s[0]))
    return ours
