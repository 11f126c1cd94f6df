"""Where the paper contradicts itself: computed numbers for either reading. EVIDENCE is the only list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from analysis.loop_fit import magnetisation
from analysis.paper.loop_shape import loop_margins_of
from analysis.paper.measured import RATE_HZ
from analysis.paper.numbers import paper_tables
from analysis.paper.table_6_4 import MOVE_SAMPLES, step_settling
from analysis.recorded.loop_fit import HELD
from campaigns.design import Design
from sim_backend.control.blocks import DiscreteFilter, filter_from_tf
from sim_backend.control.feedback import closed_loop_poles, theta_controller
from sim_backend.control.repetitive import learning_filter
from sim_backend.kinematics import dof_from_points
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import load_model, number
from sim_backend.polynomial import modal_from_zpk

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Evidence:
    """One contradiction: what stands against what, numbers as text cells under `heads`, and what follows."""

    title: str
    question: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    conclusion: str


def high_mode() -> Evidence:
    """1440 Hz in the text and Table 6.1, 2000 Hz in the polynomial of Table 6.2."""
    move = Design.load("table-6.4-30", RATE_HZ).unit_step("theta_x", MOVE_SAMPLES)
    plants = {"1440 Hz": Design.load("design", RATE_HZ), "as printed": Design.load("printed", RATE_HZ)}
    table, text = paper_tables()["6.4"], paper_tables()["text"]
    rows = [
        (
            "highest pole (Hz)",
            "1440 (text), 1405 and 1470 (Table 6.1)",
            *(f"{_highest_hz(p):.1f}" for p in plants.values()),
        )
    ]
    settled = [step_settling(p.axis("theta_x"), move) for p in plants.values()]
    rows.append(
        ("overshoot, complete plant (µrad)", _shown(table.number("complete overshoot").value))
        + tuple(f"{1e6 * s.overshoot[0]:.1f}" for s in settled)
    )
    rows.append(
        ("settling, complete plant (ms)", _shown(table.number("complete settling").value))
        + tuple(f"{1e3 * s.time_s[0]:.1f}" for s in settled)
    )
    two = [step_settling(_with_high_mode(p), move) for p in plants.values()]
    for label, key, values in (
        ("overshoot, 30 + high mode (µrad)", "30+1500 overshoot", [1e6 * s.overshoot[0] for s in two]),
        ("settling, 30 + high mode (ms)", "30+1500 settling", [1e3 * s.time_s[0] for s in two]),
    ):
        rows.append((label, _shown(table.number(key).value), *(f"{v:.1f}" for v in values)))
    margins = [loop_margins_of(p.axis("theta_x")) for p in plants.values()]
    rows.append(
        ("gain margin (dB)", _shown(text.number("gain margin").value), *(f"{m.gain_margin_db:.2f}" for m in margins))
    )
    rows.append(
        ("peak of |S| (dB)", _shown(text.number("sensitivity peak").value))
        + tuple(f"{m.sensitivity_peak_db:.2f}" for m in margins)
    )
    return Evidence(
        "The highest mode of θx: 1440 or 2000 Hz",
        "Table 6.1 and the text put it near 1440 Hz, the denominator printed in Table 6.2 at 2000 Hz.",
        ("quantity", "paper", "mode at 1440 Hz", "polynomial as printed"),
        tuple(rows),
        "The measured resonances, the complete plant's overshoot, the gain margin and the settling of the 30+1500 row "
        "speak for 1440 Hz; that row's overshoot and the peak of |S| for 2000 Hz. The bench uses 1440 Hz.",
    )


def _highest_hz(design: Design) -> float:
    return float(design.axis("theta_x").omega_rad_s.max() / (2.0 * np.pi))


def _with_high_mode(design: Design) -> ModalModel:
    """The 29.6 Hz mode in series with the highest one, of the same gain at rest: two poles each and no zeros."""
    model = design.axis("theta_x")
    order = np.argsort(model.omega_rad_s)[[0, -1]]
    omega, sigma = model.omega_rad_s[order], model.sigma_1_s[order]
    static = float(model.frequency_response(np.array([0.0]))[0, 0, 0].real)
    roots = -sigma + 1j * np.sqrt(omega**2 - sigma**2)
    return modal_from_zpk([], np.concatenate([roots, roots.conj()]), static * float(np.prod(omega**2)))


PRINTED_L = (0.048, 6.253e-5, -0.096, -2.939e-5, 0.048)
"""Numerator of L in section 6.3.2 with the signs that its zeros require, N m per mrad."""


SOLVED_MODE = (np.array([2.0 * np.pi * 29.579]), np.array([4.7902]), 97.6228e-3)
"""Frequency (rad/s), decay (1/s) and gain (rad/N m) at which one mode's inverse gives every printed digit."""


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
        "The printed coefficients are the inverse of one mode, at 29.58 Hz with a decay of 4.79 1/s and a gain of 97.6 "
        "mrad/N m, which is neither axis's. The learning here inverts one mode, that of the axis.",
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
    for name, field in (("k/µ0, as printed", k / mu_0), ("k·µ0", k * mu_0)):
        shares = [_remanence(field, amplitude, stiffness) / amplitude for amplitude in (4.5e-3, 7.2e-3, 8.5e-3)]
        rows.append((name, f"{field:.3g}", *(f"{100 * s:.3f}" for s in shares)))
    rows.insert(0, ("paper", "", "about 0.7", "about 0.7", "about 0.7"))
    return Evidence(
        "The pinning of the hysteresis: k/µ0 or k·µ0",
        "Displacement left at zero drive, in % of the amplitude, on the spring of Table 6.2:",
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
                f"printed {_shown(paper_tables()['text'].number('peak force').value)}",
                f"5.7 N/A times 9 A: {force:.1f}",
            ),
            (
                "actuators' radius (mm)",
                f"from {_shown(table.number('peak current').value)} A: "
                f"{1e3 * number(bench.hardware.actuators.radius_m):.1f}",
                f"from {_shown(table.number('power').value)} W: {1e3 * _radius_from_power():.1f}",
            ),
        ),
        "The radius is not printed; the bench takes the one from the peak current, and its power is then a prediction.",
    )


def _radius_from_power() -> float:
    """Radius at which the ideal feed-forward of the 5 Hz chop of 8.5 mrad dissipates the printed power."""
    chop = Design.load("design-4th-order", RATE_HZ).unit_step("theta_x", MOVE_SAMPLES).scaled(8.5e-3)
    dwell = round(0.1 * RATE_HZ)
    up = np.concatenate([chop.drive[:, 0], np.full(dwell - MOVE_SAMPLES, chop.holding[0])])
    torque = np.concatenate([up, chop.holding[0] - up])
    bench = load_model("as-built")
    assert bench.hardware is not None
    force = torque[:, None] * dof_from_points(1.0)[0]
    watts = float(np.mean(np.sum((force / number(bench.hardware.actuator_steepness_n_sqrt_w)) ** 2, axis=1)))
    return float(np.sqrt(watts / paper_tables()["6.6"].value("power")))


def _shown(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


EVIDENCE: tuple[Callable[[], Evidence], ...] = (
    high_mode,
    learning_filter_order,
    rounded_controller,
    pinning,
    stability_against_percentages,
    forces_and_radii,
)
