import json

import msgspec
import numpy as np
import pytest

from analysis.diagnosis.answer.changes import changes
from analysis.diagnosis.answer.output import document, extended_model, prepare_folder, write_files
from analysis.diagnosis.answer.page import write_page
from analysis.diagnosis.calibration import calibrated, counted
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.records.loading import Source
from analysis.diagnosis.result import Cause, Diagnosis, Domain, Estimate, Gain, NextExperiment
from sim_backend.effects import make_effect
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, Quantity, Value, load_model, number
from sim_backend.simbench import SimBench

SHA = "ab" * 32
SOURCES = (Source("data/run.h5", SHA, "uid-1", 4000),)
CONTRACT = {
    "schema",
    "verdict",
    "causes",
    "ambiguous",
    "remainder",
    "sensitivity",
    "evidence",
    "gain",
    "next_experiment",
    "inputs",
}
DOMAINS = {"frequency", "amplitude", "position", "direction", "rate", "time", "temperature"}


@pytest.fixture
def diagnosis(oscillator):
    """A made-up diagnosis: a cubic stiffness and a re-tuned frequency, with numbers that can be told apart."""
    rng = np.random.default_rng(0)
    residual = 1e-6 * rng.standard_normal((4000, 1))
    windows = (Window("steps", 0, 3000), Window("held-out <b>noise</b>", 3000, 4000, held_out=True))
    data = Dataset(1000.0, (Record("uid-1", rng.standard_normal((4000, 1)), rng.standard_normal((4000, 1)), windows),))
    linear = oscillator.linear()
    curve = Domain(
        "uid-1", "x", np.array([1.0, 2.0]), "m", np.array([5.0, np.inf]), np.ones(2), 1e-9, "x at <i>top</i>"
    )
    return Diagnosis(
        verdict="named",
        sentence="The springs harden & <script>alert(1)</script>.",
        causes=(Cause("cubic-stiffness", "x", 0.97, {"stiffness": Estimate(2.5, 0.125, "N/m^3")}, "It bends."),),
        ambiguous=(("delay", "amplifier-lag"),),
        evidence={"position": (curve, curve), "cross-axis": ()},
        gain=Gain(("uid-1#held-out <b>noise</b>",), 0.5, 0.1, 0.09, 0.8, (0.78, 0.82)),
        next_experiment=NextExperiment("freerun", {"torque_nm": 0.02}, ("delay", "amplifier-lag"), 6.5),
        data=data,
        nominal=linear,
        linear=linear.with_(omega_rad_s=linear.omega_rad_s * 1.02),
        effects=(make_effect("cubic-stiffness", "x", {"stiffness": 2.5}),),
        before=(5.0 * residual,),
        after=(residual,),
        considered=(("cubic-stiffness", 0.0), ("backlash", -40.0)),
        notes=("Mind the gap",),
        linear_std=linear.with_(omega_rad_s=linear.omega_rad_s * 0.001),
    )


def test_the_document_is_that_of_the_contract(diagnosis, oscillator):
    found = json.loads(json.dumps(document(diagnosis, oscillator, SOURCES), allow_nan=False))
    assert found["schema"] == "mccd-diagnosis/1"
    blind = counted(0.97)
    assert blind is not None
    assert set(found) >= CONTRACT and set(found["evidence"]) >= DOMAINS
    assert found["causes"] == [
        {
            "effect": "cubic-stiffness",
            "where": "x",
            "probability": calibrated(0.97),
            "posterior": 0.97,
            "blind": {"names": blind.names, "right": blind.right, "ci95": list(blind.interval)},
            "parameters": {"stiffness": {"value": 2.5, "std": 0.125, "unit": "N/m^3"}},
            "why": "It bends.",
        }
    ]
    assert found["ambiguous"] == [["delay", "amplifier-lag"]]
    assert found["gain"] == {
        "held_out": ["uid-1#held-out <b>noise</b>"],
        "rms_given": None,
        "rms_before": 0.5,
        "rms_after": 0.1,
        "noise_floor": 0.09,
        "reduction": 0.8,
        "ci95": [0.78, 0.82],
    }
    assert found["next_experiment"]["expected_sigma"] == 6.5
    assert found["inputs"] == [{"file": "data/run.h5", "sha256": SHA}]
    # what is not finite has no form in JSON; the p-value of the domain counts both of its curves
    assert found["evidence"]["position"]["curves"][0]["level"] == [5.0, None]
    assert found["evidence"]["position"]["p_value"] == 2e-9
    assert found["evidence"]["time"] == {}


def test_every_number_of_the_page_is_in_the_document(diagnosis, oscillator):
    import dataclasses

    adjusted = diagnosis.nominal.with_(omega_rad_s=diagnosis.nominal.omega_rad_s * 1.01)
    more = dataclasses.replace(diagnosis, adjusted=adjusted, tolerance=0.03, next_experiment=None)
    found = document(more, oscillator, SOURCES)
    assert found["considered"] == [
        {"hypothesis": "cubic-stiffness", "log_odds": 0.0},
        {"hypothesis": "backlash", "log_odds": -40.0},
    ]
    frequency, stiffness = found["parameters"]
    told = [frequency[name] for name in ("given", "adjusted", "extended", "std")]
    assert told == pytest.approx([20.0, 20.2, 20.4, 0.02]) and frequency["unit"] == "Hz"
    assert (stiffness["given"], stiffness["adjusted"], stiffness["extended"]) == (None, None, 2.5)
    assert found["tolerance"] == 0.03 and "nothing is tied" in found["next_steps"][0]


def test_the_extended_model_says_where_each_new_number_comes_from(diagnosis, oscillator, tmp_path):
    write_files(diagnosis, oscillator, SOURCES, tmp_path)
    extended = load_model(tmp_path / "extended.toml")
    (mode,) = extended.modes
    assert isinstance(mode.frequency_hz, Quantity)
    assert mode.frequency_hz.value == pytest.approx(20.4, rel=1e-12)
    assert mode.frequency_hz.std == pytest.approx(0.02, rel=1e-12)
    assert mode.frequency_hz.origin == "fitted"
    assert SHA in mode.frequency_hz.source and "uid-1" in mode.frequency_hz.source
    # what the fit left alone keeps its origin
    assert mode.decay_rate_1_s == 6.0 and mode.input == {"force": (2.0 * np.pi * 20.0) ** 2}
    (effect,) = extended.effects
    assert (effect.effect, effect.where) == ("cubic-stiffness", "x")
    stiffness = effect.parameters["stiffness"]
    assert isinstance(stiffness, Quantity)
    assert (stiffness.value, stiffness.std, stiffness.origin) == (2.5, 0.125, "fitted") and SHA in stiffness.source
    assert SimBench(extended, seed=0).axes == ("x",)


def test_effects_of_the_nominal_model_are_not_applied_twice(diagnosis, oscillator):

    known = (
        EffectEntry(effect="stiffness-shift", where="x", parameters={"relative": 0.1}),
        EffectEntry(effect="coulomb-friction", where="x", parameters={"torque": 1e-3}),
    )
    nominal = msgspec.structs.replace(oscillator, effects=list(known))
    extended = extended_model(nominal, diagnosis, SOURCES)
    # the shift is in the re-tuned modes already, friction acts on a signal and stays
    assert [e.effect for e in extended.effects] == ["coulomb-friction", "cubic-stiffness"]


def test_the_difference_lists_what_changed_and_nothing_else(diagnosis, oscillator):
    rows = changes(oscillator, extended_model(oscillator, diagnosis, SOURCES))
    assert [(r.place, r.what, r.before, r.unit) for r in rows] == [
        ("only", "frequency", 20.0, "Hz"),
        ("cubic-stiffness at x", "stiffness", None, "N/m^3"),
    ]
    assert rows[0].relative == pytest.approx(0.02) and rows[1].after == 2.5
    assert changes(oscillator, oscillator) == []


def test_a_changed_mode_is_told_by_its_damping_ratio_and_in_units(oscillator):
    mode = oscillator.modes[0]
    ((port, value),), (out,) = mode.input.items(), mode.output
    assert mode.decay_rate_1_s is not None and value is not None
    decay = Quantity(value=2.0 * number(mode.decay_rate_1_s), std=0.1)
    other = msgspec.structs.replace(mode, decay_rate_1_s=decay, input={port: 1.1 * number(value)})
    zeta, driven = changes(oscillator, msgspec.structs.replace(oscillator, modes=[other]))
    assert (zeta.what, zeta.unit) == ("damping ratio ζ (decay_rate_1_s ÷ 2πf)", "")
    assert zeta.before == pytest.approx(number(mode.decay_rate_1_s) / (2.0 * np.pi * 20.0))
    assert zeta.before is not None and zeta.after == pytest.approx(2.0 * zeta.before)
    units = {p.name: p.unit for p in (*oscillator.inputs, *oscillator.outputs)}
    assert (driven.what, driven.unit) == (f"gain from input {port}", f"{units[out]}/s^2 per {units[port]}")


def test_a_re_tuned_direct_path_is_in_the_extended_model_and_in_the_difference(diagnosis, oscillator):
    """A model that was fitted to the very runs may have one, and what was turned has to be what is simulated."""
    import dataclasses

    direct = msgspec.structs.replace(oscillator, feedthrough={"x": {"force": 0.02}})
    linear = diagnosis.linear.with_(d=np.array([[-0.01]]))
    std = diagnosis.linear_std.with_(d=np.array([[0.003]]))
    extended = extended_model(direct, dataclasses.replace(diagnosis, linear=linear, linear_std=std), SOURCES)
    np.testing.assert_array_equal(extended.linear().d, [[-0.01]])
    number_of_it = extended.feedthrough["x"]["force"]
    assert isinstance(number_of_it, Quantity)
    assert (number_of_it.origin, number_of_it.std) == ("fitted", 0.003) and "uid-1" in number_of_it.source
    (row,) = [r for r in changes(direct, extended) if r.place == "x, directly"]
    assert (row.what, row.before, row.after, row.std) == ("gain from force", 0.02, -0.01, 0.003)


def test_every_quantity_of_an_extended_as_built_bench_is_kept(diagnosis):
    import dataclasses

    bench = load_model("as-built")
    same = dataclasses.replace(
        diagnosis, linear=bench.linear(), linear_std=None, effects=(), causes=(), verdict="consistent"
    )
    extended = extended_model(bench, same, SOURCES)
    assert [number(m.frequency_hz) for m in extended.modes] == [number(m.frequency_hz) for m in bench.modes]
    assert changes(bench, extended) == []


def test_the_page_opens_with_the_sentence_and_escapes_whatever_files_say(diagnosis, oscillator, tmp_path):
    written = write_page(diagnosis, oscillator, SOURCES, tmp_path)
    page = written["index.html"].read_text(encoding="utf-8")
    assert "The springs harden &amp; &lt;script&gt;alert(1)&lt;/script&gt;." in page
    first = page.index("The springs harden")
    places = [page.index(f'id="{name}"') for name in ("surety", "causes", "evidence", "residual", "model")]
    assert places == sorted(places) and first < places[0]
    for foreign in ("<script>alert", "<b>noise</b>", "<i>top</i>"):
        assert foreign not in page
    # self-contained: nothing is fetched; the name space of SVG is a name, not an address
    assert " src=" not in page and 'rel="stylesheet"' not in page and "@import" not in page
    for text in (
        f"{100.0 * calibrated(0.97):.0f}\N{NO-BREAK SPACE}% probable",
        "delay or amplifier lag",
        "6.5 standard deviations",
        "<small>p = 1·10⁻⁹</small>",
        SHA,
        "Mind the gap",
    ):
        assert text in page


def test_the_figures_hold_the_residuals_they_are_drawn_from(diagnosis, oscillator, tmp_path):
    import pandas as pd

    write_page(diagnosis, oscillator, SOURCES, tmp_path)
    drawn = pd.read_csv(tmp_path / "figures" / "residual-x.csv")
    # the first segment and the second have the same size; whichever was drawn, before is five times after
    largest = drawn.groupby("series")["y"].apply(lambda y: np.abs(y).max())
    assert largest["adjusted"] == pytest.approx(5.0 * largest["extended"], rel=1e-9)
    assert set(drawn["y_quantity"]) == {"measured − simulated (µm)"}


@pytest.mark.parametrize("verdict", ["consistent", "ambiguous", "unknown"])
def test_every_verdict_has_a_page(diagnosis, oscillator, tmp_path, verdict):
    import dataclasses

    bare = dataclasses.replace(
        diagnosis, verdict=verdict, causes=(), ambiguous=(), gain=None, next_experiment=None, evidence={}, effects=()
    )
    page = write_page(bare, oscillator, (), tmp_path)["index.html"].read_text(encoding="utf-8")
    assert f'<span class="verdict {verdict}">' in page
    # what to do next is told with every verdict, also that the model can be used
    steps = page[page.index("What to do next") :]
    assert ("No experiment is planned" in steps) == (verdict == "unknown")
    assert ("No plan of the bench is known" in steps) == (verdict == "ambiguous")
    assert ("Use the model at" in steps) == (verdict == "consistent")
    assert ("follows tells what causes it" in page) == (verdict == "unknown")


def test_a_folder_that_cannot_be_is_refused_before_the_work(tmp_path):
    (tmp_path / "file").write_text("here")
    with pytest.raises(ConfigError, match="cannot be made a folder"):
        prepare_folder(tmp_path / "file")
    assert prepare_folder(tmp_path / "a" / "b").is_dir()


def std_of(value: Value) -> float | None:
    assert isinstance(value, Quantity)
    return value.std


def test_several_of_one_kind_at_one_place_keep_their_own_deviations(diagnosis, oscillator):
    import dataclasses

    shapes = [{"frequency_hz": 100.0 * k, "damping_ratio": 0.01, "participation": 0.1 * k} for k in (1, 2)]
    effects = tuple(make_effect("extra-resonance", "x", shape) for shape in shapes)
    causes = tuple(
        Cause("extra-resonance", "x", 0.99, {n: Estimate(v, 0.01 * k, "1") for n, v in shape.items()}, f"peak {k}")
        for k, shape in enumerate(shapes, start=1)
    )
    two = extended_model(oscillator, dataclasses.replace(diagnosis, effects=effects, causes=causes), SOURCES).effects
    assert [e.note for e in two] == ["peak 1", "peak 2"]
    assert [number(e.parameters["frequency_hz"]) for e in two] == [100.0, 200.0]
    assert [std_of(e.parameters["frequency_hz"]) for e in two] == [0.01, 0.02]


def test_a_delay_among_the_effects_of_the_nominal_model_stays_once(diagnosis, oscillator):
    import dataclasses

    entry = EffectEntry(effect="delay", where="x", parameters={"seconds": 2e-4})
    nominal = msgspec.structs.replace(oscillator, effects=[entry])
    delayed = dataclasses.replace(
        diagnosis, linear=oscillator.linear().with_(delay_s=np.array([2e-4])), effects=(), causes=()
    )
    extended = extended_model(nominal, delayed, SOURCES)
    assert extended.effects == [] and extended.linear().delay_s == [2e-4]


def test_a_delay_that_was_turned_is_fitted(diagnosis, oscillator):
    import dataclasses

    late = msgspec.structs.replace(oscillator, delay_s={oscillator.inputs[0].name: 3e-4})
    turned = late.linear().with_(delay_s=np.array([1e-4]))
    spread = diagnosis.linear_std.with_(delay_s=np.array([2e-5]))
    found = dataclasses.replace(diagnosis, linear=turned, linear_std=spread, effects=(), causes=())
    (delay,) = extended_model(late, found, SOURCES).delay_s.values()
    assert isinstance(delay, Quantity)
    assert (delay.value, delay.origin, delay.std) == (1e-4, "fitted", 2e-5)


def test_a_number_that_no_fit_turned_has_no_deviation(diagnosis, oscillator):
    import dataclasses

    still = dataclasses.replace(diagnosis, linear_std=diagnosis.linear_std.with_(omega_rad_s=np.zeros(1)))
    std = std_of(extended_model(oscillator, diagnosis, SOURCES).modes[0].frequency_hz)
    assert std is not None and std > 0.0
    assert std_of(extended_model(oscillator, still, SOURCES).modes[0].frequency_hz) is None
