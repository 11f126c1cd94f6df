"""The opening sentence says what is wrong, where it lives, how sure that is and what it costs, for every verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.answer.sentence import reservation, sentence
from analysis.diagnosis.calibration import calibrated
from analysis.diagnosis.result import Cause, Domain, Estimate, Gain, Remainder

GAIN = Gain(("run#a",), 0.25, 0.0125, 0.01, 0.95, (0.94, 0.96))


def curve(p_value: float, levels: list[float], where: str) -> Domain:
    return Domain("run", "x", np.arange(2.0), "m", np.array(levels), np.ones(2), p_value, where)


def cause(effect: str, why: str, probability: float = 0.998) -> Cause:
    return Cause(effect, "x", probability, {"torque": Estimate(1.0, 0.1, "N m")}, why)


def test_unknown_says_where_it_lives_how_sure_and_how_large_it_is() -> None:
    evidence = {
        "time": (curve(1e-4, [1.5, 9.0], "x from 0 to 1 s"),),
        "position": (
            curve(1e-9, [2.0, 7.0], "x at 3 to 4 mm: 7 times the noise"),
            curve(0.5, [1.0, 1.1], "y at 0 to 1 mm"),
        ),
    }
    text = sentence("unknown", (), (), GAIN, evidence)
    # the least chance counts, times the curves among which it was chosen
    assert "by position, x at 3 to 4 mm: 7 times the noise (p = 2·10⁻⁹)" in text
    assert "misses 25.0 % of the held-out output, of which 1.00 % is noise" in text


def test_unknown_without_evidence_points_to_the_remarks() -> None:
    text = sentence("unknown", (), (), GAIN, {"time": (curve(0.2, [1.5, 9.0], "x from 0 to 1 s"),)})
    assert "remarks" in text and "from 0 to 1 s" not in text


def test_a_consistent_verdict_tells_of_noise_that_is_not_steady() -> None:
    quiet = {"time": (curve(1e-4, [1.0, 1.2], "x from 0 to 1 s"),)}
    loud = {**quiet, "rate": (curve(1e-9, [1.0, 1.6], "x at rate 3 to 4 mm/s: 1.6 times the noise"),)}
    assert reservation("consistent", quiet) == ""
    assert "by rate, x at rate 3 to 4 mm/s: 1.6 times the noise (p = 1·10⁻⁹)" in reservation("consistent", loud)
    assert reservation("named", loud) == ""


def test_a_consistent_verdict_says_so_where_most_of_the_output_passes_for_noise() -> None:
    loud = Gain(("run#a",), 0.95, 0.95, 0.9, 0.0, (0.0, 0.0))
    assert "95.0 % of the held-out output" in sentence("consistent", (), (), loud, {})
    quiet = replace(GAIN, rms_after=GAIN.noise_floor)
    assert sentence("consistent", (), (), quiet, {}).endswith("the residual is noise.")


def test_a_consistent_verdict_tells_what_it_misses_of_held_out_rows_beside_the_usual_noise() -> None:
    said = sentence("consistent", (), (), GAIN, {})
    assert "it misses 1.25 % where 1.00 % is usual" in said and "slow noise" in said


def test_named_tells_every_cause_its_symptom_and_the_gain() -> None:
    causes = (cause("coulomb-friction", "the residual switches sign"), cause("sensor-gain", "the residual is", 0.99))
    text = sentence("named", causes, (), GAIN, {})
    assert f"Coulomb friction at x and sensor gain at x (probability {100.0 * calibrated(0.99):.0f} % each)" in text
    assert "the residual switches sign; the residual is" in text
    assert "adding them takes the held-out error from 25.0 % (the model's own numbers adjusted) to 1.25 %" in text


def test_a_kind_of_cause_at_several_places_is_told_once() -> None:
    def at(effect: str, *places: str) -> list[Cause]:
        return [Cause(effect, where, 0.999, {}, f"the residual is {effect}") for where in places]

    three = sentence("named", at("hysteresis", "piezo_1", "piezo_2", "piezo_3"), (), GAIN, {})
    assert three.startswith(
        f"The simulation lacks hysteresis at piezo_1, piezo_2 and "
        f"piezo_3 (probability {100.0 * calibrated(0.999):.0f} % each):"
    )
    two = sentence("named", [*at("hysteresis", "x", "y"), *at("sensor-gain", "x")], (), GAIN, {})
    assert two.startswith("The simulation lacks hysteresis at x and y, and sensor gain at x (probability")
    many = sentence("named", at("extra-resonance", *(f"axis_{i}" for i in range(7))), (), GAIN, {})
    assert many.startswith("The simulation lacks extra resonance at 7 locations (probability")
    inside = sentence("named", at("slow-softening", *(f"mode {i}" for i in range(1, 7))), (), GAIN, {})
    assert inside.startswith("The simulation lacks slow softening at 6 modes (probability")


def test_what_is_left_beside_a_name_is_told() -> None:
    rest = Remainder(0.06, 1e-9, "a torque that follows position at x")
    text = sentence("named", (cause("coulomb-friction", "the residual switches sign"),), (), GAIN, {}, remainder=rest)
    assert "6.00 % of the squared error above noise stays unexplained (a torque that follows position at x;" in text


def test_a_gain_that_noise_may_be_is_said_to_be_none() -> None:
    gain = Gain(("run#a",), 0.0717, 0.0719, 0.0686, -0.003, (-0.01, 0.013))
    text = sentence("named", (cause("hysteresis", "the residual is a loop"),), (), gain, {})
    assert "takes the held-out error" not in text
    assert (
        "less than its uncertainty (error 7.17 % of the output before, 7.19 % after, of which 6.86 % is noise)" in text
    )


def test_an_error_that_grows_on_held_out_rows_is_told_with_the_reason_why_the_name_stands() -> None:
    slow = Gain(("run#a",), 0.0256, 0.0278, 0.00278, -0.083, (-0.105, -0.062), times=0.91, times_std=0.22)
    text = sentence("named", (cause("delay", "the residual leads"),), (), slow, {})
    assert "with it the held-out error grows from 2.56 % to 2.78 % of the output, but slow noise is part of it" in text
    assert "these samples fit 0.91 ± 0.2 times the added effect best" in text
    assert "On held-out samples it still misses 2.78 % where 0.278 % is usual" in text
    near = replace(slow, noise_floor=0.0256)
    text = sentence("named", (cause("delay", "the residual leads"),), (), near, {})
    assert "grows from 2.56 % to 2.78 % of the output, of which 2.56 % is noise." in text
    assert "still misses" not in text


def test_what_named_causes_leave_beside_the_usual_noise_is_told_once() -> None:
    causes = (cause("delay", "the residual leads"),)
    assert "it still misses 1.25 % where 1.00 % is usual" in sentence("named", causes, (), GAIN, {})
    rest = Remainder(0.06, 1e-9, "the held-out samples")
    assert "still misses" not in sentence("named", causes, (), GAIN, {}, remainder=rest)
    assert "still misses" not in sentence("named", causes, (), replace(GAIN, rms_after=GAIN.noise_floor), {})


def test_an_error_as_large_as_its_noise_is_not_said_to_be_wrong_and_noise_at_once() -> None:
    same = replace(GAIN, rms_before=0.45, rms_after=0.45, noise_floor=0.45)
    text = sentence("unknown", (), (), same, {})
    assert "it misses 45.0 % of the held-out output, which by its size alone could all be noise." in text
    assert "of which 1.00 % is noise" in sentence("unknown", (), (), GAIN, {})


@pytest.mark.parametrize("sure", [(), (cause("delay", "the residual leads"),)])
def test_ambiguous_tells_the_tie_what_is_sure_beside_it_and_the_gain(sure: tuple[Cause, ...]) -> None:
    text = sentence("ambiguous", sure, (("cubic-stiffness", "backlash"),), GAIN, {})
    assert "which of cubic stiffness, backlash it is" in text and "from 25.0 % (the model's own" in text
    assert (f"lacks delay at x (probability {100.0 * calibrated(0.998):.0f} %)" in text) == bool(sure)
