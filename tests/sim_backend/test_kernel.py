"""The compiled loop against independent integrations: scipy's solve_ivp at tight tolerance, and closed forms."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.blocks import filter_from_zpk
from sim_backend.model import EffectEntry, Mode, Model, Port
from sim_backend.simbench import SimBench

RATE_HZ = 10_000.0
STIFFNESS_NM_RAD, INERTIA_KGM2 = 11.16, 3.23e-4
OMEGA = np.sqrt(STIFFNESS_NM_RAD / INERTIA_KGM2)
SIGMA = 5.0


def one_axis(effects=(), *, frequency_hz=OMEGA / (2 * np.pi), sigma=SIGMA, delay_s=0.0):
    return Model(
        name="one axis",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="torque", unit="N m", dof="theta_x")],
        outputs=[Port(name="theta_x", unit="rad", dof="theta_x")],
        modes=[
            Mode(
                label="suspension",
                frequency_hz=frequency_hz,
                decay_rate_1_s=sigma,
                input={"torque": 1 / INERTIA_KGM2},
                output={"theta_x": 1.0},
            )
        ],
        delay_s={"torque": delay_s} if delay_s else {},
        effects=[EffectEntry(effect=name, where="theta_x", parameters=p) for name, p in effects],
    )


def play(model, torque, *, substeps=1, truth=False, **segment):
    bench = SimBench(model, 0, substeps=substeps, truth=truth)
    column = np.asarray(torque, dtype=float)[:, None]
    segment.setdefault("reference", np.zeros_like(column))
    segment.setdefault("n_samples", len(column))
    return bench.play(Segment(label="test", feedforward=column, **segment)).channels


def held_torque(n, seed=1):
    return 0.05 * np.repeat(np.random.default_rng(seed).uniform(-1, 1, n // 100), 100)


def integrate(torque, acceleration, y0=(0.0, 0.0)):
    """Reference solution at the samples: one solve per held sample, relative tolerance 1e-11."""
    states = np.empty((len(torque), 2))
    y = np.array(y0)
    for k, u in enumerate(torque):
        states[k] = y
        y = solve_ivp(
            lambda _, s, u=u: [s[1], acceleration(s[0], s[1], u)],
            (0.0, 1 / RATE_HZ),
            y,
            method="DOP853",
            rtol=1e-11,
            atol=1e-14,
        ).y[:, -1]
    return states[:, 0]


def test_linear_plant_is_exact_against_solve_ivp():
    torque = held_torque(1000)
    theta = play(one_axis(), torque)["theta_x"]
    expected = integrate(torque, lambda q, v, u: u / INERTIA_KGM2 - OMEGA**2 * q - 2 * SIGMA * v)
    # ten samples of rounding at rtol 1e-11 per step over 1000 steps: 1e-8 of the largest angle
    np.testing.assert_allclose(theta, expected, atol=1e-8 * np.max(np.abs(expected)))


def test_step_response_is_the_closed_form():
    n, torque_nm = 3000, 0.05
    theta = play(one_axis(), np.full(n, torque_nm))["theta_x"]
    t = np.arange(n) / RATE_HZ
    damped = np.sqrt(OMEGA**2 - SIGMA**2)
    expected = (
        torque_nm
        / STIFFNESS_NM_RAD
        * (1 - np.exp(-SIGMA * t) * (np.cos(damped * t) + SIGMA / damped * np.sin(damped * t)))
    )
    np.testing.assert_allclose(theta, expected, atol=1e-12)


def test_rigid_body_is_the_closed_form():
    n, torque_nm = 2000, 0.01
    theta = play(one_axis(frequency_hz=0.0, sigma=0.0), np.full(n, torque_nm))["theta_x"]
    t = np.arange(n) / RATE_HZ
    np.testing.assert_allclose(theta, 0.5 * torque_nm / INERTIA_KGM2 * t**2, rtol=1e-10, atol=1e-18)


def test_nonlinear_loop_converges_with_the_square_of_the_step():
    cubic = 2e4  # N m/rad³: at 5 mrad a fifth of the linear torque, far beyond a perturbation
    torque = held_torque(600, seed=2)
    expected = integrate(torque, lambda q, v, u: (u - cubic * q**3) / INERTIA_KGM2 - OMEGA**2 * q - 2 * SIGMA * v)
    model = one_axis([("cubic-stiffness", {"stiffness": cubic})])
    errors = [np.max(np.abs(play(model, torque, substeps=n)["theta_x"] - expected)) for n in (1, 2, 4, 8)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # the claim of the kernel is second order; 1.9 leaves room for the first (unextrapolated) step
    assert np.all(orders > 1.9), (errors, orders)
    assert errors[-1] < 1e-5 * np.max(np.abs(expected))


def test_friction_takes_the_energy_that_the_closed_form_says():
    # free swing under Coulomb friction alone: the amplitude falls by 4 T / k per period, exactly
    torque_nm, n = 2e-3, 4000
    model = one_axis([("coulomb-friction", {"torque": torque_nm, "breakaway_rate": 1e-6})], sigma=0.0)
    hold = 20_000
    push = np.concatenate([np.full(hold, 0.08), np.zeros(n)])
    # started by a release: friction acts also during the push, so only differences of peaks count
    theta = play(model, push, substeps=4)["theta_x"][hold:]
    peaks = theta[1:-1][(theta[1:-1] > theta[:-2]) & (theta[1:-1] >= theta[2:]) & (theta[1:-1] > 1e-3)]
    drops = -np.diff(peaks)
    # a sampled peak misses the true one by at most a (omega dt)²/8 = 4e-5 of it
    np.testing.assert_allclose(drops, 4 * torque_nm / STIFFNESS_NM_RAD, atol=2 * 4.4e-5 * peaks[0])


@pytest.mark.parametrize("samples", [0.25, 0.5, 2.25])
def test_fractional_delay_acts_as_a_command_that_comes_between_two_samples(samples):
    # independent: the plant held on a grid of a quarter sample by scipy, the command whole steps of it later
    omega, torque, fine = 2.0 * np.pi * 500.0, held_torque(600), 4
    a, b = np.array([[0.0, 1.0], [-(omega**2), -2.0 * SIGMA]]), np.array([[0.0], [1.0 / INERTIA_KGM2]])
    plant = signal.cont2discrete((a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))), 1.0 / (fine * RATE_HZ))
    command = np.concatenate([np.zeros(round(fine * samples)), np.repeat(torque, fine)])[: fine * torque.size]
    exact = signal.dlsim((*plant[:4], 1.0 / (fine * RATE_HZ)), command[:, None])[1][::fine, 0]
    late = play(one_axis(frequency_hz=500.0, sigma=SIGMA, delay_s=samples / RATE_HZ), torque)["theta_x"]
    # in the mean of third order in the mode's angle of 0.31 per sample; a straight line between two samples is off by
    # half a per cent at a quarter of a sample, and by more at a half
    assert np.std(late - exact) < 0.04 * (omega / RATE_HZ) ** 3 * np.std(exact)


def test_whole_delay_is_exact():
    torque = held_torque(400)
    late = play(one_axis(delay_s=2.0 / RATE_HZ), torque)["theta_x"]
    np.testing.assert_array_equal(late[2:], play(one_axis(), torque)["theta_x"][:-2])


def test_amplifier_cuts_off_exactly_at_its_limit():
    torque = 0.05 * np.sin(2 * np.pi * 5 * np.arange(2000) / RATE_HZ)
    cut = play(one_axis([("amplifier-saturation", {"limit": 0.03})]), torque)["theta_x"]
    np.testing.assert_allclose(cut, play(one_axis(), np.clip(torque, -0.03, 0.03))["theta_x"], atol=1e-16)


def test_feedback_loop_equals_the_state_space_of_the_closed_loop():
    # independent reference: the loop written as one matrix recursion with python-control's zero-order hold
    import control

    loop = filter_from_zpk([0.99, 0.98], [1.0, 0.7], 3.0, RATE_HZ)
    n = 500
    step = np.full((n, 1), 1e-3)
    theta = play(one_axis(), np.zeros(n), reference=step, feedback=(loop,), gates=(Gate(0, 0, True),), n_samples=n)[
        "theta_x"
    ]
    plant = control.ss([[0, 1], [-(OMEGA**2), -2 * SIGMA]], [[0], [1 / INERTIA_KGM2]], [[1, 0]], [[0]])
    ad = control.c2d(plant, 1 / RATE_HZ)
    c = control.tf(3.0 * np.poly([0.99, 0.98]), np.poly([1.0, 0.7]), 1 / RATE_HZ)
    closed = control.feedback(control.series(control.ss(c), ad))
    _, expected = control.forced_response(closed, np.arange(n) / RATE_HZ, step[:, 0])
    np.testing.assert_allclose(theta, expected, atol=1e-12)


def test_integrator_starts_from_the_gate_value():
    loop = filter_from_zpk([0.99], [1.0], 1.0, RATE_HZ)
    channels = play(
        one_axis(), np.zeros(10), feedback=(loop,), gates=(Gate(4, 0, True, integrator=0.0123),), n_samples=10
    )
    np.testing.assert_array_equal(channels["command_theta_x"][:4], 0.0)
    # at rest the error is zero, so the command is the integrator's start value
    assert channels["command_theta_x"][4] == pytest.approx(0.0123, rel=1e-12)


def test_learning_is_the_textbook_recursion():
    period, n = 40, 200
    taps = (0.25, 0.5, 0.25)
    lead, gain = 3, 0.4
    filt = filter_from_zpk([0.2], [0.5], 2.0, RATE_HZ)
    reference = 1e-3 * np.random.default_rng(5).standard_normal((period, 1))
    learning = Learning(filt, gain, lead, period, taps)
    channels = play(one_axis(), np.zeros(period), reference=reference, n_samples=n, learning=(learning,))
    error = np.tile(reference[:, 0], n // period) - channels["theta_x"]
    filtered = np.array([2.0 * (error[k] - 0.2 * (error[k - 1] if k else 0.0)) for k in range(n)])
    for k in range(1, n):
        filtered[k] += 0.5 * filtered[k - 1]
    u = np.zeros(n)

    def past(series, k):
        return series[k] if k >= 0 else 0.0

    for k in range(n):
        u[k] = sum(
            tap * (past(u, k - period + t) + gain * past(filtered, k - period + t + lead))
            for tap, t in zip(taps, (-1, 0, 1), strict=True)
        )
    np.testing.assert_allclose(channels["command_theta_x"], u, atol=1e-15)


def test_blocks_of_a_long_run_join_without_a_seam(monkeypatch):
    import sim_backend.simbench as simbench

    torque = held_torque(2000)
    whole = play(one_axis(), torque, n_samples=6000)["theta_x"]
    monkeypatch.setattr(simbench, "_BLOCK", 2000)
    np.testing.assert_array_equal(play(one_axis(), torque, n_samples=6000)["theta_x"], whole)


@pytest.mark.parametrize("n", [3, 7, 14, 20, 64])
def test_the_reference_is_recorded_again_and_again(n):
    wave = np.random.default_rng(0).uniform(-1e-6, 1e-6, (7, 1))
    record = SimBench(one_axis(), 0).play(Segment("steps", n, wave, np.zeros_like(wave)))
    np.testing.assert_array_equal(record.channels["reference_theta_x"], np.resize(wave[:, 0], n))
