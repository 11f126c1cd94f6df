"""Where the paper contradicts itself: computed numbers for either reading. EVIDENCE is the only list."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.measurements.loop_fit import magnetisation
from analysis.paper.chop_drive import power_w
from analysis.paper.high_mode import high_mode
from analysis.paper.lead_and_delay import lead_and_delay
from analysis.paper.measured import RATE_HZ
from analysis.paper.move_length import FEEDFORWARD, move_length
from analysis.paper.numbers import paper_tables
from analysis.paper.open_loop_motion import open_loop_motion
from analysis.paper.pieces import Evidence, shown
from analysis.paper.run_levels import run_levels
from analysis.recorded.loop_fit import HELD
from campaigns.calibration import MOVE_SAMPLES
from campaigns.strategies.design import Design
from sim_backend.control.blocks import DiscreteFilter, filter_from_tf
from sim_backend.control.feedback import closed_loop_poles, theta_controller
from sim_backend.control.repetitive import learning_filter
from sim_backend.linear import discretise
from sim_backend.model import load_model, number

Array = NDArray[np.float64]


PRINTED_L = (0.048, 6.253e-5, -0.096, -2.939e-5, 0.048)
"""Numerator of L in section 6.3.2 with the signs that its zeros require, N m per mrad."""


SOLVED_MODE = (np.array([2.0 * np.pi * 29.579]), np.array([4.7902]), 97.6228e-3)
"""Frequency (rad/s), decay (s⁻¹) and gain (rad/N m) at which one mode's inverse gives every printed digit."""


def learning_filter_order() -> Evidence:
    """A 4th-order inverse in the text, the inverse of one mode in the printed coefficients."""
    model = Design.load("design", RATE_HZ).axis("theta_y")
    order = np.argsort(model.omega_rad_s)
    static = float(model.frequency_response(np.array([0.0]))[0, 0, 0].real)
    first, both = (model.omega_rad_s[order[:1]], model.sigma_1_s[order[:1]]), (model.omega_rad_s, model.sigma_1_s)
    rows = []
    for name, (omega, sigma), gain in (
        ("both modes, as the text says", both, static),
        ("the 29 Hz mode of Table 6.2", first, static),
        ("one mode, solved from the digits", SOLVED_MODE[:2], SOLVED_MODE[2]),
    ):
        made = learning_filter(omega, sigma, gain, 500.0, RATE_HZ)
        rows.append((name, *(f"{c:.4g}" for c in _numerator(made))))
    rows.insert(0, ("printed", *(f"{c:.4g}" for c in PRINTED_L)))
    return Evidence(
        "What the L-filter inverts",
        "The text inverts the 4th-order θy dynamics. Numerators over the same 4th-order Butterworth filter at 500 Hz:",
        ("L", "z⁴", "z³", "z²", "z", "1"),
        tuple(rows),
        "The printed coefficients are the inverse of one mode, at 29.58 Hz with a damping ratio ζ of 0.0258 and a gain "
        "of 97.6 mrad/N m, which is neither axis's. The learning here inverts one mode, that of the axis.",
    )


def _numerator(made: DiscreteFilter) -> Array:
    """Numerator (5,) in falling powers of z over all four poles, from the response at five points; N m per mrad."""
    z = np.exp(2j * np.pi * np.arange(5) / 5 + 0.3j)
    values = made.frequency_response(np.angle(z) / (2.0 * np.pi) * RATE_HZ) * np.polyval(np.poly(made.poles()), z)
    return np.asarray(np.linalg.solve(np.vander(z, 5), values).real * 1e-3)


PRINTED_C = ((0.1722, -0.3337, -0.01048, 0.3337, -0.1617), (1.0, -3.311, 4.085, -2.228, 0.4531))
"""Controller of section 6.3.1 with its signs, N m per mrad."""


def rounded_controller() -> Evidence:
    """The digits of the controller, run as they stand, against the controller rebuilt from its description."""
    plant = discretise(Design.load("design", RATE_HZ).axis("theta_x"), RATE_HZ)
    printed = filter_from_tf(np.array(PRINTED_C[0]) * 1e3, PRINTED_C[1], RATE_HZ)
    rows = []
    for name, controller in (("printed digits", printed), ("rebuilt", theta_controller())):
        own = controller.poles()
        closed = float(np.max(np.abs(closed_loop_poles(plant, controller))))
        rows.append((name, f"{np.max(own.real):.6f}", f"{closed:.6f}", "yes" if closed < 1.0 else "no"))
    return Evidence(
        "The controller's printed digits",
        "Four digits of a polynomial with roots near z = 1 do not hold its integrator.",
        ("controller", "largest own pole (z)", "largest closed-loop pole |z|", "loop stable"),
        tuple(rows),
        "The loop with the printed digits diverges. The controller rebuilt from its description gives the same digits.",
    )


def pinning() -> Evidence:
    """K divided by µ0, as (6.4) has it, against k times µ0."""
    k = paper_tables()["6.3"].value("k")
    stiffness = 1.0 / float(
        Design.load("design", RATE_HZ).axis("theta_x").frequency_response(np.array([0.0]))[0, 0, 0].real
    )
    rows = []
    for name, field in (("k/µ0, as printed", k / scipy.constants.mu_0), ("k·µ0", k * scipy.constants.mu_0)):
        shares = [_remanence(field, amplitude, stiffness) / amplitude for amplitude in (4.5e-3, 7.2e-3, 8.5e-3)]
        rows.append((name, f"{field:.3g}", *(f"{100 * s:.3f}" for s in shares)))
    rows.insert(0, ("paper", "", "about 0.7", "about 0.7", "about 0.7"))
    return Evidence(
        "The pinning of the hysteresis: k/µ0 or k·µ0",
        "Remanent displacement at zero drive, in % of the amplitude, on the spring of Table 6.2:",
        ("pinning", "value (rad)", "4.5 mrad", "7.2 mrad", "8.5 mrad"),
        tuple(rows),
        "With k/µ0 there is no hysteresis at all. The bench uses k·µ0.",
    )


def _remanence(field: float, amplitude: float, stiffness: float) -> float:
    """Half the width of the loop, over the stiffness: the torque at zero angle of a steady cycle."""
    n = 2000
    angle = amplitude * np.sin(2.0 * np.pi * np.arange(3 * n) / n)
    gain = paper_tables()["6.3"].value("kc")
    loop = gain * magnetisation(angle, {**HELD, "pinning": field})
    return float(abs(loop[2 * n] - loop[2 * n + n // 2]) / 2.0 / stiffness)


def stability_against_percentages() -> Evidence:
    """3σ of 2.09 µrad in Table 6.6 against the percentages of Table 6.7."""
    three_sigma = paper_tables()["6.6"].value("stability")
    printed = np.array([n.value for n in paper_tables()["6.7"].rows if n.value is not None])
    radius = 1.7e-6
    inside = 100.0 * (1.0 - np.exp(-0.5 * (3.0 * radius / three_sigma) ** 2))
    implied = [3e6 * radius / np.sqrt(-2.0 * np.log(1.0 - p / 100.0)) for p in (printed.min(), printed.max())]
    return Evidence(
        "Stability against the percentages inside 1.7 µrad",
        "For Gaussian noise that is equal in both angles, either follows from the other.",
        ("from", "3σ (µrad)", "inside 1.7 µrad (%)"),
        (
            ("Table 6.6, 2.09 µrad", f"{3e6 * three_sigma / 3.0:.2f}", f"{inside:.2f}"),
            ("smallest of Table 6.7", f"{implied[0]:.2f}", f"{printed.min():.2f}"),
            ("largest of Table 6.7", f"{implied[1]:.2f}", f"{printed.max():.2f}"),
        ),
        "No percentage of Table 6.7 is as small as 2.09 µrad would make it: that number is an upper bound over all "
        "tests, or of one angle. A bench whose noise is set by it must give smaller percentages than the paper's.",
    )


def forces_and_radii() -> Evidence:
    """Peak force against force constant and current; the actuators' radius from current and from power."""
    bench = load_model("as-built")
    assert bench.hardware is not None
    force = number(bench.hardware.force_constant_n_a) * number(bench.hardware.peak_current_a)
    table = paper_tables()["6.6"]
    return Evidence(
        "Forces and lever arms",
        "Section 6.2.1 and Table 6.6 leave two more pairs that do not meet.",
        ("quantity", "one way", "the other way"),
        (
            (
                "peak force at 9 A (N)",
                f"printed {shown(paper_tables()['text'].number('peak force').value)}",
                f"5.7 N/A times 9 A: {force:.1f}",
            ),
            (
                "actuators' radius (mm)",
                f"from {shown(table.number('peak current').value)} A: "
                f"{1e3 * number(bench.hardware.actuators.radius_m):.1f}",
                f"from {shown(table.number('power').value)} W: {1e3 * _radius_from_power():.1f}",
            ),
        ),
        "The radius is not printed; the bench takes the one from the peak current, and its power is then a prediction.",
    )


def _radius_from_power() -> float:
    """Radius at which the ideal feed-forward of the 5 Hz chop of 8.5 mrad dissipates the printed power."""
    watts = power_w(FEEDFORWARD, MOVE_SAMPLES, 1.0)
    return float(np.sqrt(watts / paper_tables()["6.6"].value("power")))


EVIDENCE: tuple[Callable[[], Evidence], ...] = (
    move_length,
    high_mode,
    learning_filter_order,
    lead_and_delay,
    rounded_controller,
    pinning,
    stability_against_percentages,
    run_levels,
    open_loop_motion,
    forces_and_radii,
)
