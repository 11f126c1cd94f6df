"""A mode is a place: what acts in it is what a change of that mode alone would be, in every loop and on every bench."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backend import kernel
from sim_backend.assembly import places_of, transducers_of
from sim_backend.bench import Segment
from sim_backend.effects import Effect, make_effect
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from sim_backend.model import EffectEntry, Mode, Model, Port
from sim_backend.replay import replay
from sim_backend.simbench import SimBench

Array = NDArray[np.float64]

RATE_HZ, N = 1000.0, 3000
STIFFER = 0.03


def _model(*effects: EffectEntry) -> Model:
    """Return two axes of three modes that both inputs drive and both outputs see, one through its rate as well."""
    shapes = ((31.0, 1.0, 0.4, 2e-6, -1e-6), (74.0, -0.3, 1.0, 1e-6, 3e-6), (119.0, 0.6, 0.7, -2e-6, 1e-6))
    return Model(
        name="two axes",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name=f"drive_{i}", unit="V", dof=f"piezo_{i}") for i in (1, 2)],
        outputs=[Port(name=f"gap_{i}", unit="m", dof=f"point_{i}") for i in (1, 2)],
        modes=[
            Mode(
                label=f"mode {k + 1}",
                frequency_hz=f_hz,
                decay_rate_1_s=0.2 * f_hz,
                input={"drive_1": b1, "drive_2": b2},
                output={"gap_1": c1, "gap_2": c2},
                output_rate={"gap_1": 1e-9 * k, "gap_2": 0.0},
            )
            for k, (f_hz, b1, b2, c1, c2) in enumerate(shapes)
        ],
        effects=list(effects),
    )


def _spring(where: str) -> Effect:
    """Return a hysteresis whose springs never slip: a part of the mode's own stiffness."""
    return make_effect("hysteresis", where, {"stiffness_1": STIFFER, "reach": 1e9})


def _stiffened(m: int) -> ModalModel:
    linear = _model().linear()
    omega = linear.omega_rad_s.copy()
    omega[m] *= np.sqrt(1.0 + STIFFER)
    return linear.with_(omega_rad_s=omega)


def _played(linear: ModalModel, effects: list[Effect], substeps: int) -> Array:
    u = np.random.default_rng(1).standard_normal((N, 2))
    model = _model()
    return replay(linear, effects, places_of(model), transducers_of(model), u, RATE_HZ, substeps=substeps).reading


@pytest.mark.parametrize("m", range(3))
def test_a_spring_in_a_mode_makes_that_mode_stiffer(m: int) -> None:
    """The force is extrapolated to the middle of a step, so what is left falls with the square of the step."""
    linear = _model().linear()
    plain, other = _played(linear, [], 1), _played(_stiffened(m), [], 1)
    left = [np.std(_played(linear, [_spring(f"mode {m + 1}")], steps) - other) for steps in (8, 16)]
    assert left[0] < 0.02 * np.std(other - plain)
    assert 3.5 < left[0] / left[1] < 4.5


def test_it_acts_beside_what_acts_on_an_axis() -> None:
    """Rows of both kinds have one length: neither changes what the other does."""
    linear = _model().linear()
    torque = make_effect("constant-torque", "piezo_2", {"torque": 3.0})
    both, one = (_played(linear, effects, 4) for effects in ([torque, _spring("mode 1")], [_spring("mode 1")]))
    held = linear.frequency_response(np.zeros(1))[0].real[:, 1] * 3.0
    softer = _stiffened(0).frequency_response(np.zeros(1))[0].real[:, 1] * 3.0
    last = (both - one)[-1]
    np.testing.assert_allclose(last, softer, rtol=1e-3)
    assert np.max(np.abs(last / held - 1.0)) > 5e-3


def test_inlined_it_gives_the_same_bits_as_called(monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [
        EffectEntry(effect="slow-softening", where="mode 2", parameters={"softening": 0.05, "level": 1e-6}),
        EffectEntry(effect="coulomb-friction", where="piezo_1", parameters={"torque": 0.05}),
    ]
    drive = np.random.default_rng(3).standard_normal((N, 2))
    segment = Segment("drive", N, np.zeros((N, 2)), drive)
    readings = []
    for long in (np.inf, -1):
        monkeypatch.setattr(kernel, "LONG", long)
        readings.append(SimBench(_model(*entries), 0, substeps=3).play(segment).channels["point_1"])
    assert np.std(readings[0]) > 0.0
    np.testing.assert_array_equal(readings[0], readings[1])


@pytest.mark.parametrize("where", ["mode 0", "mode 4"])
def test_a_mode_that_is_not_there_is_refused(where: str) -> None:
    with pytest.raises(ConfigError, match=r"modes go from 'mode 1' to 'mode 3'"):
        _played(_model().linear(), [_spring(where)], 1)


def test_a_rigid_body_has_no_stiffness_to_act_on() -> None:
    linear = _model().linear()
    rigid = linear.with_(omega_rad_s=linear.omega_rad_s * np.array([0.0, 1.0, 1.0]))
    with pytest.raises(ConfigError, match="without rigid bodies"):
        _played(rigid, [_spring("mode 1")], 1)


def test_what_acts_on_commands_has_no_place_in_a_mode() -> None:
    with pytest.raises(ConfigError, match="there is no 'mode 1' on this bench"):
        _played(_model().linear(), [make_effect("dead-zone", "mode 1", {"width": 0.1})], 1)
