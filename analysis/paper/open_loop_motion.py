"""How far the mirror moves while the feedback is open: "∆θ < 2 µrad" of section 6.3.2 against Table 6.7."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.paper.measured import RATE_HZ
from analysis.paper.pieces import Evidence
from analysis.paper.run_levels import level_rad, printed_shares
from campaigns.strategies.design import Design
from sim_backend.control.feedback import theta_controller
from sim_backend.linear import Array, discretise

INTEGRATION_S = 0.1
"""A dwell of the 5 Hz chop."""

FREQUENCY_HZ = np.arange(0.05, 5000.0, 0.1)
"""Fine against the lowest mode's width of 1.5 Hz."""

SOURCES: dict[str, Callable[[Array], Array]] = {
    "torque noise below 50 Hz, as on the bench": lambda f: 1.0 / np.hypot(1.0, f / 50.0),
    "white torque noise": np.ones_like,
    "torque noise above 50 Hz": lambda f: (f > 50.0).astype(float),
    "torque noise above 150 Hz": lambda f: (f > 150.0).astype(float),
}
"""Amplitude spectra of the disturbances of the mirror, by name, in any unit."""


def motion(spectrum: Array, axis: str = "theta_x") -> tuple[float, float]:
    """Return motion with open feedback over that with closed feedback: of every sample, of an integration's mean.

    `spectrum` (f,) is the torque's, over FREQUENCY_HZ; both are over the motion of every sample with closed feedback.
    """
    plant = discretise(Design.load("design", RATE_HZ).axis(axis), RATE_HZ).frequency_response(FREQUENCY_HZ)[:, 0, 0]
    loop = plant * theta_controller().frequency_response(FREQUENCY_HZ)
    free = np.abs(plant) * spectrum
    closed = np.linalg.norm(free / np.abs(1.0 + loop))
    # a mean over T passes sin(π f T)/(π f T)
    mean = np.linalg.norm(free * np.sinc(FREQUENCY_HZ * INTEGRATION_S))
    return float(np.linalg.norm(free) / closed), float(mean / closed)


def open_loop_motion() -> Evidence:
    """Motion with open feedback under noise that gives Table 6.7 with closed feedback, by where its power lies."""
    level = float(np.sqrt(np.mean([level_rad(share) ** 2 for run in printed_shares().values() for share in run])))
    rows = []
    for name, spectrum in SOURCES.items():
        every, mean = (1e6 * level * part for part in motion(spectrum(FREQUENCY_HZ)))
        rows.append((name, f"{1e6 * level:.2f}", f"{every:.1f}", f"{mean:.2f}"))
    return Evidence(
        "Stability against reproducibility",
        "Section 6.3.2 learns with the feedback open and finds the chop reproducible to 2 µrad while integrating. What "
        "a disturbance that gives Table 6.7 under the feedback does without it, 3σ in µrad:",
        ("source", "closed, every sample (Table 6.7)", "open, every sample", "open, mean of an integration of 0.1 s"),
        tuple(rows),
        "Noise that the feedback attenuates moves the open mirror by ten times the printed 2 µrad, at its 29.6 Hz "
        "mode. Either all of the disturbance lies above 150 Hz, and the attenuation below 100 Hz that the text tunes "
        "the feedback for gains nothing; or the 2 µrad are of the mean of an integration period, as in Fig. 6.16. The "
        f"bench takes the second reading and exceeds it: {rows[0][3]} µrad, and more in the learned chop of the text's "
        "row, where each learned cycle repeats noise of the cycles before. Its 10 µrad during the step, too short "
        "for a mean to help, are exceeded by either reading.",
    )
