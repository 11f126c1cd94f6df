import numpy as np
import pytest
from scipy import signal

from analysis.frequency.frf import frequency_response_periodic, period_drift, smoothed
from analysis.frequency.frf_records import frequency_response_local, frequency_response_welch
from sim_backend.errors import ConfigError, DataError

RATE = 1000.0


def _states(model):
    a, b, c, d = model.state_space()
    return signal.cont2discrete((a, b, c, d), 1.0 / RATE)[:4]


def _simulate(model, u, feedback=None, output_noise=None):
    """Plain state-space loop over the samples, u = r - K y: the independent reference of these tests."""
    a, b, c, d = _states(model)
    x, y, drive = np.zeros(a.shape[0]), np.zeros((u.shape[0], c.shape[0])), u.copy()
    for k in range(u.shape[0]):
        y[k] = c @ x + (0.0 if output_noise is None else output_noise[k])
        if feedback is not None:
            drive[k] = u[k] - feedback @ y[k]
        x = a @ x + b @ drive[k]
    return y, drive


def _multisines(rng, n, n_u, realisations):
    """Random-phase multisines, orthogonal between the inputs of each block of n_u realisations."""
    dft = np.exp(2j * np.pi * np.outer(np.arange(n_u), np.arange(n_u)) / n_u)
    blocks = []
    for _ in range(realisations // n_u):
        phase = np.exp(2j * np.pi * rng.uniform(size=(n // 2 + 1, n_u)))
        phase[0] = phase[-1] = 0.0
        blocks.append(np.fft.irfft(phase[:, :, None] * dft, n, axis=0) * np.sqrt(n))
    return np.concatenate(blocks, axis=2)


def _stable(plant, rng, n_y=2, n_u=2):
    model = plant(rng, 2, n_y, n_u, True, band_hz=(30.0, 150.0))
    return model.with_(sigma_1_s=np.array([15.0, 40.0]))


def test_periodic_response_noise_and_distortion(rng, plant):
    model, n, realisations, periods = _stable(plant, rng), 500, 8, 3
    u = _multisines(rng, n, 2, realisations)
    exact = model.frequency_response(np.arange(n // 2 + 1) * RATE / n, RATE)
    y = np.fft.irfft(np.einsum("fyu,fur->fyr", exact, np.fft.rfft(u, axis=0)), n, axis=0)
    size = y.std()
    # a static cube of another input-like signal stands for distortion: periodic, but different in each realisation
    cube = 0.05 * size * (u[:, ::-1] ** 3 - 3.0 * u[:, ::-1])
    repeated = np.repeat((y + cube)[..., None], periods, axis=3)
    noisy = repeated + 0.02 * size * rng.normal(size=repeated.shape)
    got = frequency_response_periodic(np.repeat(u[..., None], periods, axis=3), noisy, RATE)
    lines = np.arange(1, n // 2)
    assert np.allclose(got.frequency_hz, lines * RATE / n)
    # noise power over all lines is the noise's mean square but for 0 Hz and half the rate, 2 of n; a variance from
    # 249 lines of 16 complex degrees of freedom is known to 1 / sqrt(3984) = 1.6 %: four of them
    assert np.allclose(got.output_noise.sum(axis=0), (0.02 * size) ** 2 * (1.0 - 2.0 / n), rtol=0.065)
    # 6 complex degrees of freedom per line, 249 lines: 2.6 % for independent lines; the cube's neighbours depend on one
    # another, so six of them. Of the cube, the part along u stays with the response (it is small: E u^3 - 3u = 0).
    assert np.allclose(got.output_distortion.sum(axis=0), np.mean(cube**2), rtol=0.2)
    error = np.abs(got.response - exact[lines]) ** 2
    # four blocks: three complex degrees of freedom and 249 * 2 * 2 entries, 1.8 % if all were independent
    assert np.mean(error) / np.mean(got.total_variance) == pytest.approx(1.0, rel=0.15)


def test_noise_variance_is_calibrated_without_distortion(rng, plant):
    model, n, periods = _stable(plant, rng), 400, 4
    u = np.repeat(_multisines(rng, n, 2, 4)[..., None], periods, axis=3)
    exact = model.frequency_response(np.arange(n // 2 + 1) * RATE / n, RATE)
    y = np.fft.irfft(np.einsum("fyu,furp->fyrp", exact, np.fft.rfft(u, axis=0)), n, axis=0)
    got = frequency_response_periodic(u, y + 0.1 * y.std() * rng.normal(size=y.shape), RATE)
    ratio = np.abs(got.response - exact[1:-1]) ** 2 / got.noise_variance
    # F(2, 24) has mean 12 / 11 and standard deviation 1.2; entries of a row share it: 199 * 2 independent ones
    assert np.mean(ratio) == pytest.approx(12.0 / 11.0, abs=5.0 * 1.2 / np.sqrt(398.0))
    assert got.noise_dof == 12 and got.total_dof == 1


def test_input_noise_that_the_plant_sees_is_no_output_noise(rng, plant):
    model, n = _stable(plant, rng), 256
    u = np.repeat(_multisines(rng, n, 2, 2)[..., None], 3, axis=3)
    u = u + 0.05 * rng.normal(size=u.shape)  # periods differ, and the plant answers (periodically, for an exact test)
    exact = model.frequency_response(np.arange(n // 2 + 1) * RATE / n, RATE)
    y = np.fft.irfft(np.einsum("fyu,furp->fyrp", exact, np.fft.rfft(u, axis=0)), n, axis=0)
    got = frequency_response_periodic(u, y, RATE)
    # the response divides out the input's noise; rounding is all that is left
    assert np.allclose(got.response, exact[1:-1], rtol=1e-9, atol=1e-12 * np.abs(exact).max())
    assert np.max(got.output_noise) < 1e-20 * np.mean(y**2)


def test_transient_periods_are_seen_and_dropped(rng, plant):
    model = _stable(plant, rng, 1, 1)
    u = np.tile(_multisines(rng, 300, 1, 1)[:, :, 0], (4, 1))
    y, _ = _simulate(model, u)
    shape = (4, 300, 1, 1)
    uu, yy = (np.moveaxis(x.reshape(shape), 0, -1) for x in (u, y))
    drift = period_drift(yy)[0, 0]
    # the slowest mode decays with 15 1/s: e^-4.5 = 0.011 per period of 0.3 s
    assert drift[0] > 10.0 * drift[1] > 0.0
    exact = model.frequency_response(np.arange(1, 150) * RATE / 300, RATE)
    with_it, without = (frequency_response_periodic(uu, yy, RATE, drop_periods=k) for k in (0, 2))
    error = [np.max(np.abs(g.response - exact)) for g in (with_it, without)]
    assert error[1] < 0.01 * error[0]


def test_local_polynomials_are_calibrated_in_coloured_noise(rng, plant):
    model, n = _stable(plant, rng), 12000
    u = rng.normal(size=(n, 2))
    y, _ = _simulate(model, u)
    noise = signal.lfilter([1.0], [1.0, -0.7], rng.normal(size=y.shape), axis=0) * 0.02 * y.std()
    got = frequency_response_local(u, y + noise, RATE)
    exact = model.frequency_response(got.frequency_hz, RATE)
    ratio = np.abs(got.response - exact) ** 2 / got.variance
    dof = got.total_dof
    # F(2, 2 dof) has mean dof / (dof - 1); its standard deviation for dof 6 is 1.7, outputs independent
    assert np.mean(ratio) == pytest.approx(dof / (dof - 1.0), abs=5.0 * 1.7 / np.sqrt(2.0 * exact.shape[0]))


def test_reference_removes_the_bias_of_a_closed_loop(rng, plant):
    model, n = _stable(plant, rng, 1, 1), 40000
    a, b, c, _ = _states(model)
    gain = np.array([[0.5 / np.max(np.abs(model.frequency_response(np.linspace(1, 400, 400), RATE)))]])
    assert np.max(np.abs(np.linalg.eigvals(a - b @ gain @ c))) < 1.0
    reference = rng.normal(size=(n, 1))
    size = _simulate(model, reference)[0].std()
    y, u = _simulate(model, reference, gain, 1.0 * size * rng.normal(size=(n, 1)))
    through = frequency_response_local(u, y, RATE, reference=reference)
    direct = frequency_response_local(u, y, RATE)
    exact = model.frequency_response(through.frequency_hz, RATE)
    weight = 1.0 / np.sqrt(through.variance)
    bias = [np.abs(np.mean((g.response - exact) * weight)) for g in (through, direct)]
    # the mean of n_f unit errors is within five of its standard deviations; the direct estimate is not
    limit = 5.0 * np.sqrt(6.0 / 5.0 / exact.size)
    assert bias[0] < limit < bias[1]


def test_welch_agrees_with_scipy_and_is_calibrated(rng, plant):
    model, n, segment = _stable(plant, rng, 1, 1), 40000, 1000
    u = rng.normal(size=(n, 1))
    y, _ = _simulate(model, u)
    noisy = y + 0.2 * y.std() * rng.normal(size=y.shape)
    got = frequency_response_welch(u, noisy, RATE, segment)
    kw = {"fs": RATE, "nperseg": segment, "detrend": False}
    centred = [x[:, 0] - x[:, 0].mean() for x in (u, noisy)]
    f, cross = signal.csd(centred[0], centred[1], **kw)
    want = cross / signal.welch(centred[0], **kw)[1]
    assert np.allclose(got.response[:, 0, 0], want[2:-1], rtol=1e-9)
    far = got.frequency_hz > 250.0  # away from the resonances' leakage
    ratio = np.abs(got.response - model.frequency_response(got.frequency_hz, RATE))[far] ** 2 / got.variance[far]
    # neighbours within two lines are correlated, so a third of the lines count
    assert np.mean(ratio) == pytest.approx(1.0, abs=5.0 / np.sqrt(np.sum(far) / 3.0))


def test_smoothing_keeps_the_mean_and_counts_neighbours():
    variance = np.arange(7.0)[:, None]
    assert np.allclose(smoothed(variance, 1)[:, 0], [0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 5.5])


def test_bad_records_are_refused(rng):
    u = rng.normal(size=(100, 2, 1, 2))
    with pytest.raises(DataError, match="1 realisations cannot separate 2 inputs"):
        frequency_response_periodic(u, u, RATE)
    same = np.repeat(rng.normal(size=(100, 1, 2, 1)), 2, axis=1)
    with pytest.raises(DataError, match="do not separate"):
        frequency_response_periodic(same, same, RATE)
    with pytest.raises(DataError, match="input is constant"):
        frequency_response_periodic(np.ones((100, 1, 1, 1)), np.ones((100, 1, 1, 1)), RATE)
    with pytest.raises(ConfigError, match="leave at least one"):
        frequency_response_periodic(u[:, :1], u[:, :1], RATE, drop_periods=2)
    with pytest.raises(DataError, match="channel 0 is constant"):
        frequency_response_local(np.ones((500, 1)), rng.normal(size=(500, 1)), RATE)
    with pytest.raises(DataError, match="fewer than the"):
        frequency_response_local(rng.normal(size=(20, 1)), rng.normal(size=(20, 1)), RATE)
