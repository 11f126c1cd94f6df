"""What the rounding of Table 6.2 leaves open of Table 6.4 and of the margins: the tolerances of one rule.

The printed coefficients of θx are drawn within half a unit of their last digits, all alike, and every number that
follows from them is computed for each draw. The draws take most of a minute, so `numbers.toml` stores the result.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.paper.high_mode import COEFFICIENTS, PARTS, Roots
from analysis.paper.loop_shape import loop_margins_of
from analysis.paper.measured import RATE_HZ
from analysis.paper.move_length import calibrated_samples
from analysis.paper.numbers import UNIT_SI, paper_tables
from analysis.paper.step_rows import step_settling
from analysis.paper.tolerances import half_unit_of
from sim_backend.control.feedforward import least_norm

Array = NDArray[np.float64]
Key = tuple[str, str]

RULE = "rounding of Table 6.2"

DRAWS, SEED = 1000, 0
"""A thousand draws know a standard deviation to 2 %: to the two digits that are stored. The seed was not chosen."""


def rounding_tolerances(draws: int = DRAWS, seed: int = SEED) -> dict[Key, float]:
    """Return the tolerance of every row of the rule, by table and key, in the row's unit, to two digits.

    It is half a printed unit and twice the standard deviation over the draws.
    """
    rng = np.random.default_rng(seed)
    found = [_numbers(Roots.of(*drawn(rng))) for _ in range(draws)]
    tables = paper_tables()
    made = {}
    for table, key in found[0]:
        number = tables[table].number(key)
        spread = float(np.std([one[table, key] for one in found])) / UNIT_SI[number.unit]
        made[table, key] = float(f"{half_unit_of(number.digits) + 2.0 * spread:.2g}")
    return made


def drawn(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return numerator (5,) and denominator (9,) drawn, every coefficient a number that rounds to the printed one."""
    table = paper_tables()["6.2-coefficients"]
    polynomials = []
    for keys in COEFFICIENTS:
        numbers = [table.number(key) for key in keys]
        # the leading 1 is the polynomial's normalisation, not a rounded number
        half = [0.0 if n.rule == "one" else half_unit_of(n.digits) for n in numbers]
        values = [table.value(key) for key in keys]
        polynomials.append(np.array(values) + np.array(half) * rng.uniform(-1.0, 1.0, len(keys)))
    return polynomials[0], polynomials[1]


def _numbers(roots: Roots) -> dict[Key, float]:
    """Return the numbers of the rule in SI: of the printed polynomial, so with its highest mode at 2000 Hz."""
    samples = calibrated_samples()
    move = least_norm(roots.part(PARTS["2"]).plant(), [1.0], samples, RATE_HZ)
    found: dict[Key, float] = {}
    for key, modes in PARTS.items():
        step = step_settling(roots.part(modes).plant(), move)
        found["6.4", f"{key} overshoot"] = float(step.overshoot[0])
        found["6.4", f"{key} settling"] = float(step.time_s[0])
    complete = roots.plant()
    own = step_settling(complete, least_norm(complete, [1.0], samples, RATE_HZ))
    margins = loop_margins_of(complete)
    return {
        **found,
        ("6.4", "own settling"): float(own.time_s[0]),
        ("text", "gain margin"): margins.gain_margin_db,
        ("text", "phase margin"): float(np.deg2rad(margins.phase_margin_deg)),
        ("text", "sensitivity peak"): margins.sensitivity_peak_db,
        ("text", "sensitivity frequency"): margins.sensitivity_peak_hz,
    }
