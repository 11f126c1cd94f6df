"""Two causes of which one is the model's own numbers: neither may hide in what the nuisances do beside the other."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from analysis.diagnosis.fitting.balance import again
from analysis.diagnosis.fitting.discrepancy import Discrepancy, form_error
from analysis.diagnosis.fitting.refit import exact_sensitivities
from analysis.diagnosis.pipeline import Options, search_causes
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.search.pruning import alone
from analysis.diagnosis.verdict.judging import judge
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import EFFECTS, make_effect
from sim_backend.model import EffectEntry
from sim_backend.replay import replay
from tests.analysis.diagnosis.residuals import DECAY_1_S, MODEL, RATE_HZ, RESONANCE_HZ

Array = NDArray[np.float64]

PERIOD = 2000
GAIN = (2.0 * np.pi * RESONANCE_HZ) ** 2
STIFFER, WIDTH = 0.3, 0.02


def _drive(rng: np.random.Generator) -> Array:
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[2:400] = np.exp(2j * np.pi * rng.random(398))
    wave = np.fft.irfft(spectrum, PERIOD)
    return np.tile(wave / wave.std(), 5)


def _stiffer(force: Array) -> Array:
    """The oscillator with a spring that is stiffer by a third, its mass and damper as they were, by scipy."""
    omega = 2.0 * np.pi * RESONANCE_HZ
    held = ([omega**2], [1.0, 2.0 * DECAY_1_S, omega**2 * (1.0 + STIFFER)])
    top, bottom, _ = cont2discrete(held, 1.0 / RATE_HZ)
    return np.asarray(lfilter(top.ravel(), bottom, force))


def test_a_stiffness_far_off_is_found_beside_a_dead_zone() -> None:
    """The dead zone stands out first; the frequency is then eight tolerances off, which is the stiffness' doing."""
    rng = np.random.default_rng(3)
    drive = _drive(rng)
    played = np.sign(drive) * np.maximum(np.abs(drive) - WIDTH, 0.0)
    reading = _stiffer(played) + 3e-3 * rng.standard_normal(drive.size)
    whole = (Window("all", 0, drive.size, False, PERIOD),)
    data = Dataset(RATE_HZ, (Record("run", drive[:, None], reading[:, None], whole),))
    among = {"dead-zone", "stiffness-shift", "damping-shift", "inertia-shift", "cubic-stiffness"}
    options = Options(tolerance=0.0173, without=tuple({e.reported() for e in EFFECTS} - among), workers=1)
    found = search_causes(data, MODEL, options)
    assert {e.name for e in found.best.effects} == {"dead-zone", "stiffness-shift"}
    judged = judge(found)
    assert judged.verdict == "named", judged.failed_check
    assert judged.named == (0, 1)
    stiffness = [i for i, (_, name) in enumerate(found.best.names) if name == "relative"][0]
    # its frequency is known to the tolerance of the nominal one, which is that of half the stiffness
    assert abs(found.best.values[stiffness] - STIFFER) < 4.0 * found.best.std[stiffness] < 0.3


def test_friction_is_found_beside_a_rounded_command() -> None:
    """As long as no number is rounded otherwise, longer steps are more gain: no gain may be set against them."""
    rng = np.random.default_rng(5)
    drive = _drive(rng)
    causes = [
        make_effect("command-quantisation", "x", {"step_size": 0.0213}),
        make_effect("coulomb-friction", "x", {"torque": 0.004, "breakaway_rate": 2.0}),
    ]
    played = replay(
        MODEL.linear(), causes, places_of(MODEL), transducers_of(MODEL), drive[:, None], RATE_HZ, substeps=8
    )
    reading = played.reading + 2e-4 * rng.standard_normal((drive.size, 1))
    whole = (Window("all", 0, drive.size, False, PERIOD),)
    data = Dataset(RATE_HZ, (Record("run", drive[:, None], reading, whole),))
    model = msgspec.structs.replace(
        MODEL, modes=[msgspec.structs.replace(MODEL.modes[0], input={"force": GAIN * 1.02})]
    )
    among = {"command-quantisation", "coulomb-friction", "cubic-stiffness"}
    options = Options(tolerance=0.0173, without=tuple({e.reported() for e in EFFECTS} - among), workers=1)
    found = search_causes(data, model, options)
    # either form of friction: both leave noise alone here, and which is fitted to its end hangs on the processor
    assert {e.reported() for e in found.best.effects} == {"command-quantisation", "coulomb-friction"}
    assert judge(found).verdict == "named"
    columns = exact_sensitivities(found.setting, found.best)[0][:, 0]
    own = [name for _, name in found.best.names].index("step_size") - len(found.best.names)
    gain = columns[:, 2]
    assert not columns[:, own].any() and np.max(np.abs(gain)) > 0.1
    # what is left out is that gain: a step that is longer by 1e-7 rounds none of these numbers otherwise
    longer = [make_effect("command-quantisation", "x", {"step_size": 0.0213 * (1.0 + 1e-7)}), causes[1]]
    other = replay(MODEL.linear(), longer, places_of(MODEL), transducers_of(MODEL), drive[:, None], RATE_HZ, substeps=8)
    np.testing.assert_allclose((other.reading - played.reading)[:, 0] / 1e-7, gain, atol=0.05 * np.max(gain))


def test_what_a_cause_is_worth_does_not_hang_on_where_it_left_the_nuisances() -> None:
    """Of two causes one is taken away. A frequency that is left e times too high finds no way back by itself."""
    rng = np.random.default_rng(3)
    drive = _drive(rng)
    reading = _stiffer(drive) + 2e-3 + 3e-3 * rng.standard_normal(drive.size)
    whole = (Window("all", 0, drive.size, False, PERIOD),)
    data = Dataset(RATE_HZ, (Record("run", drive[:, None], reading[:, None], whole),))
    among = {"constant-torque", "stiffness-shift"}
    options = Options(tolerance=0.0173, without=tuple({e.reported() for e in EFFECTS} - among), workers=1)
    found = search_causes(data, MODEL, options)
    setting, best, nominal = found.setting, found.best, again(found.setting, found.tuned)
    keep = [i for i, e in enumerate(best.effects) if e.name == "constant-torque"]
    near = alone(setting, best, nominal, keep)
    strayed = replace(best, change=best.change + np.eye(best.change.size)[0])
    assert again(setting, strayed, keep=keep).objective > nominal.objective + 1e6
    assert abs(alone(setting, strayed, nominal, keep).objective - near.objective) < 0.1


def test_what_is_explained_in_one_reading_is_no_leeway_in_another() -> None:
    discrepancy = Discrepancy(("theta_x", "theta_y"), (30.0, 0.1))
    assert discrepancy.at("theta_y") == discrepancy.at("theta_x->theta_y") == 0.1
    assert discrepancy.at("theta_x") == 30.0
    assert discrepancy.at("coil 1") == discrepancy.of(()) == discrepancy.total == 30.1
    assert abs(discrepancy.of((0.01, 0.99)) - 0.399) < 1e-12  # a torque of theta_y, a tenth of which moves theta_x


def test_what_does_not_follow_the_drive_is_no_leeway_of_a_linear_form() -> None:
    discrepancy = Discrepancy(("theta_x", "theta_y"), (30.0, 10.0), linear=(28.0, 0.0))
    assert discrepancy.along((1.0, 0.0)).parts == (30.0, 10.0)
    assert discrepancy.along((0.25, 0.25)).parts == (9.0, 10.0)  # of theta_y the form is no linear one


@pytest.mark.parametrize(
    ("effect", "along_the_drive", "beside_it"),
    [
        ("actuator-gain", 1e-4, 1e-6),  # to a per cent, and with a distortion of a thousandth
        ("amplifier-lag", 3e-3, 1e-6),  # of another form, but linear
        ("constant-torque", 1e-4, 1e-4),
        ("coulomb-friction", 3e-3, 3e-3),
    ],
)
def test_what_is_linear_is_wrong_along_the_drive(effect: str, along_the_drive: float, beside_it: float) -> None:
    made = make_effect(effect, "x", {})
    assert form_error(made) == along_the_drive
    assert form_error(made, 0.0) == beside_it
    assert form_error(made, 0.5) == pytest.approx(0.5 * (along_the_drive + beside_it))


def test_a_model_that_has_a_shift_of_its_own_has_it_once() -> None:
    """An extended model with a stiffer spring explains the bench that has it: nothing is left to be found."""
    rng = np.random.default_rng(4)
    drive = _drive(rng)
    reading = _stiffer(drive) + 3e-3 * rng.standard_normal(drive.size)
    whole = (Window("all", 0, drive.size, False, PERIOD),)
    data = Dataset(RATE_HZ, (Record("run", drive[:, None], reading[:, None], whole),))
    entry = EffectEntry(effect="stiffness-shift", where="x", parameters={"relative": STIFFER})
    model = msgspec.structs.replace(MODEL, effects=[entry])
    found = search_causes(data, model, Options(tolerance=0.0173, workers=1))
    assert judge(found).verdict == "consistent"
    assert np.max(np.abs(found.tuned.change)) < 0.0173
