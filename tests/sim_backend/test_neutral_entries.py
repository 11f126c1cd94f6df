"""What the file of the bench as built states at neutral values: off it changes nothing, on it does what is told."""

import msgspec
import numpy as np
import pytest

from sim_backend.assembly import places_of, retuned
from sim_backend.bench import Segment
from sim_backend.effects import make_effect
from sim_backend.model import load_model, number
from sim_backend.simbench import SimBench

NOISES = ("amplifier-noise", "sensor-noise", "apex-noise")


def with_pair():
    """Return the bench with the pair of Table 6.1, as docs/bench-model.md says."""
    model = load_model("as-built")
    modes = [
        msgspec.structs.replace(m, frequency_hz=1405.0, input={"torque_x": -1627.083774735})
        if m.label == "theta_x mirror on its support"
        else m
        for m in model.modes
    ]
    effects = [
        msgspec.structs.replace(e, parameters={**e.parameters, "participation": -0.52616})
        if e.effect == "extra-resonance"
        else e
        for e in model.effects
    ]
    return msgspec.structs.replace(model, modes=modes, effects=effects)


def played_linear(model):
    """Return the linear model that a bench plays."""
    effects = [make_effect(e.effect, e.where, {k: number(v) for k, v in e.parameters.items()}) for e in model.effects]
    return retuned(model.linear(), effects, places_of(model))


def test_neutral_entries_change_no_bit_of_the_linear_model():
    model = load_model("as-built")
    stated, played = model.linear(), played_linear(model)
    for name in ("omega_rad_s", "sigma_1_s", "b", "c", "c_rate", "d", "delay_s"):
        np.testing.assert_array_equal(getattr(played, name), getattr(stated, name), err_msg=name)


def test_the_pair_shares_what_the_broad_mode_has():
    one, two = (played_linear(m) for m in (load_model("as-built"), with_pair()))
    hz = np.sort(two.omega_rad_s / (2 * np.pi))
    np.testing.assert_allclose(hz[hz > 1000.0][[0, -1]], [1405.0, 1470.0], rtol=1e-12)
    share = two.c[0] * two.b[:, 0]
    high = two.omega_rad_s > 2 * np.pi * 1000.0
    # five digits of the participation
    assert share[high][0] == pytest.approx(share[high][-1], rel=1e-5)
    assert np.sum(share[high]) == pytest.approx(np.sum((one.c[0] * one.b[:, 0])[one.omega_rad_s > 6000.0]), rel=1e-5)
    # far below, the mean of 1/f² of the pair is 0.5 % above that of 1440 Hz, and the mode's share of the response there
    # is (29.6/1440)²
    f = np.array([5.0, 100.0])
    np.testing.assert_allclose(
        two.frequency_response(f)[:, 0, 0], one.frequency_response(f)[:, 0, 0], rtol=0.006 * (100 / 1440) ** 2
    )


def test_delays_of_the_file_make_the_reading_later_by_their_sum():
    model = load_model("as-built")
    quiet = [e for e in model.effects if e.effect not in NOISES]
    late = [
        msgspec.structs.replace(e, parameters={"seconds": 2e-4 if e.note == "computing" else 1e-4})
        if e.effect == "delay"
        else e
        for e in quiet
    ]
    wave = np.zeros((200, 3))
    wave[20:, 0] = 0.01
    step = Segment("step", 200, np.zeros_like(wave), wave)
    prompt, delayed = (
        SimBench(msgspec.structs.replace(model, effects=effects), 0).play(step).channels["theta_x"]
        for effects in (quiet, late)
    )
    np.testing.assert_allclose(delayed[3:], prompt[:-3], rtol=0, atol=1e-15)


VIBRATIONS = {"broadband-vibration": {"rms": 1e-5}, "vibration-line": {"cosine": 1e-5}}


def played_at_rest(model, seed=4):
    still = np.zeros((2000, 3))
    return SimBench(model, seed).play(Segment("rest", 2000, still, still)).channels


def test_a_ground_that_stands_still_changes_no_bit():
    model = load_model("as-built")
    moved = {(e.effect, e.where) for e in model.effects if e.effect in VIBRATIONS}
    assert moved == {(name, axis) for name in VIBRATIONS for axis in ("theta_x", "theta_y", "z")}
    without = msgspec.structs.replace(model, effects=[e for e in model.effects if e.effect not in VIBRATIONS])
    stated, plain = played_at_rest(model), played_at_rest(without)
    for channel, values in plain.items():
        np.testing.assert_array_equal(stated[channel], values, err_msg=channel)


@pytest.mark.parametrize("name", VIBRATIONS)
@pytest.mark.parametrize("axis", ["theta_x", "theta_y", "z"])
def test_a_ground_that_moves_adds_to_its_axis_and_leaves_all_other_noise_as_it_was(name, axis):
    model = load_model("as-built")
    effects = [
        msgspec.structs.replace(e, parameters={**e.parameters, **VIBRATIONS[name]})
        if (e.effect, e.where) == (name, axis)
        else e
        for e in model.effects
    ]
    still, moved = played_at_rest(model), played_at_rest(msgspec.structs.replace(model, effects=effects))
    # what a torque of 1e-5 N m deflects at rest, and a force of 1e-5 N
    size = {"theta_x": 9e-7, "theta_y": 9e-7, "z": 6e-9}[axis]
    off = {dof: np.max(np.abs(moved[dof] - still[dof])) for dof in ("theta_x", "theta_y", "z")}
    assert 0.1 * size < off[axis] < 100.0 * size
    # the axes are apart but for the rounding of the heads' transformation
    assert all(off[dof] < 1e-9 for dof in off if dof != axis)
    np.testing.assert_array_equal(moved["current_a1"], still["current_a1"])
