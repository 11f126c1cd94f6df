"""A vibration is in whatever phase an unseen record finds it; its size and frequency are those of the fit."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.fitting.phases import in_phase
from sim_backend.effects.constant_torque import ConstantTorque
from sim_backend.effects.vibration_line import VibrationLine

RATE_HZ, ROWS = 1000.0, 4000
LINE = VibrationLine("x", cosine=0.3, sine=-0.4, frequency_hz=21.3)
TORQUE = ConstantTorque("x", torque=0.2)


def answer(effect):
    """A bench that answers at once, in two outputs of different size, and with a swing at its start."""
    t = np.arange(ROWS) / RATE_HZ
    if isinstance(effect, ConstantTorque):
        force = np.full(ROWS, effect.torque)
    else:
        angle = 2.0 * np.pi * (effect.frequency_hz * t + effect.ahead)
        force = effect.cosine * np.cos(angle) + effect.sine * np.sin(angle)
    swing = np.exp(-t / 0.1) * np.cos(40.0 * t)
    return np.stack([force + swing, -0.1 * force], axis=1)


def found(effects, there, weight=None):
    rng = np.random.default_rng(1)
    slow = np.cumsum(0.02 * rng.standard_normal((ROWS, 2)), axis=0)
    reading = sum(answer(e) for e in there) + slow + 0.2 * rng.standard_normal((ROWS, 2))
    weight = np.ones((ROWS, 2)) if weight is None else weight
    return in_phase(
        effects, lambda some: reading - sum((answer(e) for e in some), np.zeros((ROWS, 2))), answer, weight, RATE_HZ
    )


@pytest.mark.parametrize("periods", [0.0, 0.1, 0.37, 0.5, 0.93])
def test_the_phase_of_the_record_is_found(periods):
    (torque, line) = found([TORQUE, LINE], [TORQUE, LINE.turned(periods)])
    assert torque is TORQUE
    off = (line.ahead - periods + 0.5) % 1.0 - 0.5
    assert abs(off) < 0.01
    assert (line.cosine, line.sine, line.frequency_hz) == (LINE.cosine, LINE.sine, LINE.frequency_hz)


def test_rows_without_weight_take_no_part():
    """The first half of the record has the line in another phase."""
    weight = np.ones((ROWS, 2))
    weight[: ROWS // 2] = 0.0
    late = LINE.turned(0.25)
    first, second = answer(LINE), answer(late)
    reading = np.where(np.arange(ROWS)[:, None] < ROWS // 2, first, second)
    (line,) = in_phase([LINE], lambda some: reading, answer, weight, RATE_HZ)
    assert isinstance(line, VibrationLine)
    assert line.ahead == pytest.approx(0.25, abs=0.01)


def test_slow_noise_does_not_leak_through_the_edge_of_rows_without_weight():
    weight = np.ones((ROWS, 2))
    weight[: ROWS // 3] = 0.0
    slow = 5.0 * np.cos(2.0 * np.pi * 0.2 * np.arange(ROWS) / RATE_HZ)[:, None]
    reading = answer(LINE.turned(0.3)) + slow
    (line,) = in_phase([LINE], lambda some: reading, answer, weight, RATE_HZ)
    assert isinstance(line, VibrationLine)
    assert line.ahead == pytest.approx(0.3, abs=0.02)


def test_two_lines_are_each_in_a_phase_of_their_own():
    other = VibrationLine("x", cosine=0.5, frequency_hz=90.0)
    one, two = found([LINE, other], [LINE.turned(0.2), other.turned(0.7)])
    assert one.ahead == pytest.approx(0.2, abs=0.01) and two.ahead == pytest.approx(0.7, abs=0.01)


def test_where_nothing_goes_on_by_itself_nothing_is_simulated():
    def never(effects):
        raise AssertionError("simulated for nothing")

    assert in_phase([TORQUE], never, never, np.ones((ROWS, 2)), RATE_HZ) == [TORQUE]
