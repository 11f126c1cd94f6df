"""How late the loop can be: the leads of Table 6.5 against every lag that the chapter does not print.

Computing, the latency of the sensors and the lag of the amplifiers all delay the response to what was learned, and a
lead takes a delay back. The text says that the leads were tuned on the model and needed "no adjustments" on the
hardware (section 6.3.2). The lead that a delay requires is taken as the one whose largest factor per period,
|1 − z^γ S_p k_r L| over all frequencies with the feedback open, is the least (Fig. A2).
"""

from __future__ import annotations

import numpy as np
import scipy

from analysis.paper.figure_a2 import FREQUENCY_HZ
from analysis.paper.measured import RATE_HZ
from analysis.paper.pieces import Evidence
from campaigns.strategies.design import Design
from sim_backend.control.repetitive import TABLE_6_5, convergence
from sim_backend.linear import Array, discretise

SHOWN_SAMPLES = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0)
"""Delays of the evidence, in samples of 0.1 ms behind the converter's hold."""

_LEADS = range(4, 16)


class Leads:
    """What a delay of the loop does to the learning of one axis under Table 6.5."""

    def __init__(self, axis: str) -> None:
        design = Design.load("design", RATE_HZ)
        self.printed = TABLE_6_5[axis].lead_samples
        self._gain = TABLE_6_5[axis].gain
        self._plant = discretise(design.axis(axis), RATE_HZ).frequency_response(FREQUENCY_HZ)[:, 0, 0]
        self._filter = design.learning(axis, round(0.2 * RATE_HZ), 1).filter

    def factor(self, lead_samples: float, delay_samples: float) -> float:
        """Return the largest factor by which an error is multiplied per period."""
        late = np.exp(2j * np.pi * FREQUENCY_HZ / RATE_HZ * (lead_samples - delay_samples))
        values: Array = convergence(FREQUENCY_HZ, self._plant * late, self._filter, self._gain, 0)
        return float(np.max(values))

    def best(self, delay_samples: float) -> int:
        """Return the lead in samples that a delay requires."""
        return min(_LEADS, key=lambda lead: self.factor(lead, delay_samples))

    def delays(self) -> tuple[float, float]:
        """Return the least and the largest delay in samples for which the printed lead is the best one.

        Leads and delays act by their difference alone: where two neighbouring leads are equally good follows from one
        root.
        """
        turn = float(
            scipy.optimize.brentq(lambda lead: self.factor(lead, 0.0) - self.factor(lead + 1.0, 0.0), 6.0, 10.0)
        )
        return self.printed - 1.0 - turn, self.printed - turn


def lead_and_delay() -> Evidence:
    """The best lead of either axis at several delays, against the printed ones."""
    axes = {"theta_x": Leads("theta_x"), "theta_y": Leads("theta_y")}
    rows = [
        (
            f"{delay:g} sample{'' if delay == 1 else 's'}",
            *(str(leads.best(delay)) + ("" if leads.best(delay) == leads.printed else " ✗") for leads in axes.values()),
        )
        for delay in SHOWN_SAMPLES
    ]
    rows.insert(0, ("paper", *(str(leads.printed) for leads in axes.values())))
    (_, most_x), (least_y, most_y) = (leads.delays() for leads in axes.values())
    return Evidence(
        "How late the loop can be",
        "Computing, sensors and amplifiers add their delays, and none of them is printed. The lead (γ of Table 6.5) "
        "that a delay requires, by the least factor of Fig. A2 (✗: not the printed one):",
        ("delay behind the hold", "γ of θx", "γ of θy"),
        tuple(rows),
        f"θx's lead is the best one up to a delay of {most_x:.2f} samples, θy's from {least_y:.2f} to {most_y:.2f}: "
        "together they leave room for about a quarter of a sample, 0.03 ms, and none for a whole one. The bench has no "
        "delay; docs/bench-model.md says what each would move.",
    )
