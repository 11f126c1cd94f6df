"""Learning: L against scipy, the condition to converge against learning itself, period by period."""

import numpy as np
import pytest
from scipy import signal

from sim_backend.control.feedback import theta_controller
from sim_backend.control.repetitive import (
    TABLE_6_5,
    convergence,
    learning_filter,
    process_sensitivity,
    q_response,
    q_taps,
)
from sim_backend.errors import ConfigError
from sim_backend.linear import discretise
from tests.sim_backend.paper_plants import RATE_HZ, STATIC_GAIN, theta_y

F = np.geomspace(1.0, 4990.0, 200)
GAIN_Y = 2.53e14 / 2.76e12 * 1e-3


def test_learning_filter_is_the_inverse_times_a_butterworth_mapped_by_tustin():
    plant = theta_y()
    ours = learning_filter(plant.omega_rad_s, plant.sigma_1_s, GAIN_Y, 500.0, RATE_HZ).frequency_response(F)
    # Tustin maps a frequency f of the filter in z to this one of the filter in s
    warped = RATE_HZ / np.pi * np.tan(np.pi * F / RATE_HZ)
    b, a = signal.butter(4, 2 * np.pi * 500.0, analog=True)
    low_pass = signal.freqs(b, a, 2 * np.pi * warped)[1]
    # theta_y as printed is constant over its modes, so its inverse needs no zero
    reference = low_pass / plant.frequency_response(warped)[:, 0, 0]
    # partial fractions of four poles at one tenth of the Nyquist rate cancel to about 1e-10
    assert np.max(np.abs(ours / reference - 1)) < 1e-7


@pytest.mark.parametrize("closed", [False, True], ids=["open loop", "feedback closed"])
def test_learning_shrinks_each_harmonic_as_predicted(closed):
    """Learn a periodic reference in the time domain and compare the ratio of errors, harmonic by harmonic."""
    period, tuning = 200, TABLE_6_5["theta_y"]
    plant, controller = theta_y(), theta_controller(1.5)
    learning = learning_filter(plant.omega_rad_s[:1], plant.sigma_1_s[:1], GAIN_Y, tuning.cutoff_hz, RATE_HZ)
    # 50 Hz and all its harmonics; the loop from learned input to output as one impulse response, long enough to die out
    frequency_hz = np.fft.rfftfreq(period, 1 / RATE_HZ)[1:-1].astype(float)
    n = 40_000
    drive = np.zeros(n)
    drive[0] = 1.0
    impulse = _loop_response(plant, controller if closed else None, drive)
    l_impulse = _filter_response(learning, drive)
    rng = np.random.default_rng(4)
    reference = np.tile(rng.normal(size=period), n // period)
    u = np.zeros(n)
    errors = []
    for _ in range(3):
        e = _periodic(reference - signal.fftconvolve(u, impulse)[:n], period)
        errors.append(np.fft.rfft(e)[1:-1])
        filtered = _periodic(signal.fftconvolve(np.tile(e, n // period), l_impulse)[:n], period)
        u = np.tile(u[:period] + tuning.gain * np.roll(filtered, -tuning.lead_samples), n // period)
    p = discretise(plant, RATE_HZ).frequency_response(frequency_hz)[:, 0, 0]
    c = controller.frequency_response(frequency_hz) if closed else np.zeros(p.size)
    predicted = convergence(frequency_hz, process_sensitivity(p, c), learning, tuning.gain, tuning.lead_samples)
    if closed:
        # the reference reaches the error through S as well: the law holds for the ratio all the same
        assert not np.allclose(predicted, 1.0)
    # the slowest mode has decayed to exp(-4.7 x 4) ~ 1e-8 of its start at the last period
    assert np.allclose(np.abs(errors[2] / errors[1]), predicted, atol=1e-5)


def _loop_response(plant, controller, drive):
    a, b, c, _ = plant.state_space()
    system = signal.cont2discrete((a, b, c, np.zeros((1, 1))), 1 / RATE_HZ)
    if controller is None:
        return signal.dlsim(system, drive)[1][:, 0]
    ad, bd, cd = system[:3]
    ac, bc, cc, dc = controller.state_space()
    closed = np.block([[ad - bd @ dc @ cd, bd @ cc], [-bc @ cd, ac]])
    entry = np.vstack([bd, np.zeros_like(bc)])
    out = np.hstack([cd, np.zeros_like(cc)])
    return signal.dlsim((closed, entry, out, np.zeros((1, 1)), 1 / RATE_HZ), drive)[1][:, 0]


def _filter_response(f, drive):
    return signal.dlsim((*f.state_space(), 1 / RATE_HZ), drive)[1][:, 0]


def _periodic(values, period):
    return values[-period:]


def test_process_sensitivity_is_plant_over_one_plus_loop():
    assert np.isclose(process_sensitivity(2.0 + 1j, 3.0), (2.0 + 1j) / (7.0 + 3j), rtol=1e-15)


def test_q_filter_is_zero_phase_and_passes_the_mean():
    taps = q_taps(300.0, 100, RATE_HZ)
    w, reference = signal.freqz(taps, worN=2 * np.pi * F / RATE_HZ)
    assert taps == taps[::-1]
    assert np.isclose(sum(taps), 1.0)
    assert np.allclose(q_response(taps, F, RATE_HZ), (reference * np.exp(1j * w * 100)).real, atol=1e-12)
    # a Hann window of 2 x 100 samples blurs the edge over 2 x rate / 200 = 100 Hz
    assert np.all(np.abs(q_response(taps, F[F < 200.0], RATE_HZ) - 1) < 0.01)
    assert np.all(np.abs(q_response(taps, F[F > 400.0], RATE_HZ)) < 0.01)


def test_a_q_filter_can_hold_where_learning_alone_diverges():
    plant = theta_y()
    learning = learning_filter(plant.omega_rad_s[:1], plant.sigma_1_s[:1], GAIN_Y, 500.0, RATE_HZ)
    p = plant.frequency_response(F, RATE_HZ)[:, 0, 0]
    assert convergence(F, p, learning, 0.5, 9).max() > 1.0
    assert convergence(F, p, learning, 0.5, 9, q_taps(800.0, 60, RATE_HZ)).max() < 1.0


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: learning_filter([185.0], [5.0], STATIC_GAIN, 6000.0, RATE_HZ), "cut-off"),
        (lambda: learning_filter([185.0, 9000.0, 9500.0], [5.0] * 3, STATIC_GAIN, 500.0, RATE_HZ), "order 6"),
        (lambda: learning_filter([185.0], [5.0], 0.0, 500.0, RATE_HZ), "static gain"),
        (lambda: q_taps(0.0, 10, RATE_HZ), "Q filter"),
    ],
)
def test_what_cannot_be_is_refused(call, word):
    with pytest.raises(ConfigError, match=word):
        call()
