import numpy as np
import pytest
from scipy.optimize import brentq

from analysis.measurements.loop_fit import fit_loops, magnetisation
from sim_backend.errors import ConfigError, DataError

HELD = {"a": 0.44, "ms": 0.44, "alpha": 0.0, "c": 0.22}
RATE_HZ = 200.0


def remanence_far_from_saturation(amplitude, pinning, c, chi):
    """Magnetisation left at zero field in the steady loop, from the piecewise solution of (6.4) for large a.

    Behind a turning point only the reversible part moves until M meets the anhysteretic line, a distance u L with
    L = (1 + c) pinning; then the lag grows towards chi·pinning with 1 - exp(-s/L). In the steady loop the lag at the
    turning point is chi·pinning·u with u = 1 - exp(-2 A/L + u).
    """
    bend = (1.0 + c) * pinning
    u = brentq(lambda v: v - 1.0 + np.exp(-2.0 * amplitude / bend + v), 0.0, 1.0 - 1e-15)
    return chi * pinning * (1.0 - np.exp(-amplitude / bend + u))


@pytest.mark.parametrize("amplitude", [4.5e-3, 7.2e-3, 8.5e-3])
def test_the_loop_far_from_saturation_has_the_closed_form_remanence(amplitude):
    n = 4000
    path = amplitude * np.sin(2 * np.pi * np.arange(3 * n) / n)
    loop = magnetisation(path, {**HELD, "a": 44.0, "ms": 44.0, "pinning": 2.2e-3})[-n:]
    expected = remanence_far_from_saturation(amplitude, 2.2e-3, 0.22, 1.0 / 3.0)
    # Heun over a twentieth of the pinning: 4e-4; a path of 4000 samples meets zero within 1e-3 of the amplitude
    assert 0.5 * abs(loop[0] - loop[n // 2]) == pytest.approx(expected, rel=2e-3)


def slow_record(rng, noise_nm=0.0, pinning=2.2e-3, size=0.99) -> tuple[np.ndarray, np.ndarray]:
    n = 1000
    angle = np.concatenate([a * np.sin(2 * np.pi * np.arange(2 * n) / n) for a in (4.5e-3, 7.2e-3, 8.5e-3)])
    iron = size * magnetisation(angle, {**HELD, "pinning": pinning})
    polynomial = 8.19 * angle**2 - 2664.0 * angle**3 + 7.29e6 * angle**5
    torque = 11.5 * angle + 3.4e-3 * np.gradient(angle) * RATE_HZ - iron - polynomial
    return torque + noise_nm * rng.normal(size=angle.size), angle


def test_known_parameters_come_back_from_every_start():
    torque, angle = slow_record(np.random.default_rng(2))
    found = fit_loops(torque, angle, RATE_HZ, HELD, [{"pinning": p} for p in (3e-4, 3e-3, 1e-2)])
    # without noise the fit stops where a step of 2 % in a shape no longer helps
    assert found.parameters["pinning"] == pytest.approx(2.2e-3, rel=5e-3)
    assert found.parameters["size"] == pytest.approx(0.99, rel=5e-3)
    assert found.parameters["power_3"] == pytest.approx(-2664.0, rel=0.02)
    assert found.parameters["damping"] == pytest.approx(3.4e-3, rel=0.02)
    assert found.explained > 0.999
    assert max(found.starts_rms_nm) < 1.01 * min(found.starts_rms_nm) + 1e-8


def test_with_noise_the_truth_lies_within_the_stated_uncertainty():
    rng = np.random.default_rng(3)
    pulls = []
    for _ in range(12):
        found = fit_loops(*slow_record(rng, 1e-4), RATE_HZ, HELD, [{"pinning": 1e-3}])
        pulls.append([(found.parameters[k] - v) / found.std[k] for k, v in (("size", 0.99), ("power_3", -2664.0))])
    # 24 pulls of deviation one: their rms is known to 1/sqrt(48) = 0.14, taken threefold
    assert 0.55 < np.sqrt(np.mean(np.square(pulls))) < 1.45


def test_bad_input_is_refused():
    with pytest.raises(DataError, match="one start"):
        fit_loops(np.zeros(200), np.zeros(100), RATE_HZ, HELD, [{"pinning": 1e-3}])
    with pytest.raises(ConfigError, match="no parameter"):
        magnetisation(np.zeros(10), {"pining": 1.0})


def test_a_mirror_that_does_not_move_has_no_loop():
    with pytest.raises(DataError, match="the angle stays at 0.001 rad"):
        fit_loops(np.sin(np.arange(200.0)), np.full(200, 1e-3), RATE_HZ, HELD, [{"pinning": 1e-3}])
