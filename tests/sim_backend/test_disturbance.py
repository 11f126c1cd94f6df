"""The level of the disturbance multiplies what is random at the drive and on the structure, and no sensor's noise."""

import msgspec
import numpy as np
import pytest

from sim_backend.bench import Segment
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, load_model
from sim_backend.simbench import SimBench

BENCH, DESIGN = load_model("as-built"), load_model("design")
SENSORS = [e for e in BENCH.effects if e.effect in ("sensor-noise", "apex-noise")]
SHAKING = [
    *(e for e in BENCH.effects if e.effect == "amplifier-noise"),
    EffectEntry(effect="broadband-vibration", where="theta_y", parameters={"rms": 1e-5}),
]


def rest(effects, **level):
    """Return the readings of a linear bench with the hardware of the one as built, at rest."""
    model = msgspec.structs.replace(DESIGN, hardware=BENCH.hardware, effects=effects)
    still = np.zeros((1, 3))
    channels = SimBench(model, 5, **level).play(Segment("rest", 3000, still, still)).channels
    return np.stack([channels[dof] for dof in ("theta_x", "theta_y", "z")])


def test_what_drives_and_shakes_goes_with_the_level():
    one, half = rest(SHAKING), rest(SHAKING, disturbance=0.5)
    assert np.all(np.std(one, axis=1) > 0.0)
    # halving is exact in binary, and so is every sum of halves
    np.testing.assert_array_equal(half, 0.5 * one)


def test_sensors_keep_their_noise():
    np.testing.assert_array_equal(rest(SENSORS, disturbance=0.25), rest(SENSORS))


def test_level_one_is_the_bench_without_a_level():
    np.testing.assert_array_equal(rest([*SHAKING, *SENSORS], disturbance=1.0), rest([*SHAKING, *SENSORS]))
    assert SimBench(BENCH, 3, disturbance=1.0).identity == SimBench(BENCH, 3).identity


def test_without_a_disturbance_the_mechanism_stands_still():
    assert not np.any(rest(SHAKING, disturbance=0.0))


def test_a_bench_says_its_level():
    assert SimBench(BENCH, 3, disturbance=0.752).identity.serial == "seed-3 disturbance-0.752"


@pytest.mark.parametrize("level", [-0.1, np.inf, np.nan])
def test_a_level_that_cannot_be_is_refused(level):
    with pytest.raises(ConfigError, match="it must be zero or more"):
        SimBench(BENCH, 3, disturbance=level)
