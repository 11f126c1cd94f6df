"""Table 6.5: tuning of the repetitive controller, as the design uses it."""

from __future__ import annotations

from analysis.paper.measured import Measured
from analysis.paper.rows import Ours
from sim_backend.control.repetitive import TABLE_6_5


def table_6_5(measured: Measured) -> dict[str, Ours]:
    """Return gain, lead and cut-off of both axes."""
    ours: dict[str, Ours] = {}
    for axis, tuning in TABLE_6_5.items():
        ours[f"{axis} kr"] = Ours(tuning.gain)
        ours[f"{axis} gamma"] = Ours(float(tuning.lead_samples))
        ours[f"{axis} cutoff"] = Ours(tuning.cutoff_hz)
    return ours
