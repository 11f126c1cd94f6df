"""The promises that every effect of the library makes; a new effect is picked up from the lists by itself."""

import ast
import builtins
import inspect
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_backend.bench import Segment
from sim_backend.effects import BENCH_ONLY, EFFECTS, INSIDE, NOISES, Aux, Dimension, Site, effect_class, make_effect
from sim_backend.effects.view import RecordView
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from sim_backend.model import EffectEntry, Hardware, Mode, Model, Port, Ring
from sim_backend.simbench import SimBench
from tests.sim_backend.effects.along import along

ALL = (*EFFECTS, *INSIDE, *NOISES, *BENCH_ONLY)
STEPPED = [cls for cls in ALL if cls.step is not None]
RATE_HZ = 10_000.0
N = 2000

TABLE = {
    "structure": "stiffness-shift damping-shift inertia-shift extra-resonance cubic-stiffness hysteresis "
    "coulomb-friction viscoelastic-creep end-stop-contact cross-coupling backlash periodic-torque",
    "drive": "actuator-gain position-dependent-force-constant amplifier-saturation amplifier-lag delay dead-zone "
    "command-quantisation coil-heating",
    "sensor": "sensor-gain sensor-rotation periodic-sensor-error sensor-quantisation fringe-jump apex-noise "
    "sensor-drift",
    "surroundings": "vibration-line broadband-vibration thermal-stiffness-drift sample-clock-error dropped-samples "
    "constant-torque",
}
"""The slugs that users and files rely on."""


def by_name(classes):
    return pytest.mark.parametrize("cls", classes, ids=lambda cls: cls.name)


def three_axes(effects=()):
    """A bench with hardware; its noises stand last in the list, so that an effect comes before they draw."""
    axes = (
        ("theta_x", "N m", "rad", 29.56, 3.23e-4),
        ("theta_y", "N m", "rad", 29.2, 3.3e-4),
        ("z", "N", "m", 20, 0.1),
    )
    noise = [EffectEntry(effect="sensor-noise", where=f"s{i}", parameters={"std": 2e-9}) for i in (1, 3)]
    noise += [EffectEntry(effect="amplifier-noise", where=f"a{i}", parameters={"std": 1e-5}) for i in (1, 3)]
    return Model(
        name="three axes",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name=f"drive_{dof}", unit=unit, dof=dof) for dof, unit, *_ in axes],
        outputs=[Port(name=dof, unit=unit, dof=dof) for dof, _, unit, *_ in axes],
        modes=[
            Mode(
                label=dof,
                frequency_hz=f_hz,
                decay_rate_1_s=6.0,
                input={f"drive_{dof}": 1 / inertia},
                output={dof: 1.0},
            )
            for dof, _, _, f_hz, inertia in axes
        ],
        delay_s={f"drive_{dof}": 2e-4 for dof, *_ in axes},
        effects=[*effects, *noise],
        hardware=Hardware(
            actuators=Ring(names=["a1", "a2", "a3"], radius_m=0.03),
            sensors=Ring(names=["s1", "s2", "s3"], radius_m=0.03),
            force_constant_n_a=5.7,
            actuator_steepness_n_sqrt_w=7.9,
            peak_current_a=9.0,
            continuous_force_n=9.0,
            end_stop_angle_rad=0.012,
            end_stop_z_m=0.001,
            cold_finger_k=77.0,
            thermal_resistance_k_w=1.0,
            thermal_time_constant_s=0.05,
        ),
    )


def drive():
    """Held random commands with a quiet end, shape (N, 3)."""
    u = np.repeat(np.random.default_rng(1).uniform(-1, 1, (N // 50, 3)), 50, axis=0) * [0.05, 0.04, 0.5]
    u[-N // 5 :] = 0.0
    return u


def play(effects=()):
    bench = SimBench(three_axes(effects), 7, truth=True)
    u = drive()
    return bench.play(Segment("contract", N, np.zeros_like(u), u)).channels


@pytest.fixture(scope="module")
def nominal():
    return play()


def view_of(u, position, *, temperature_k=None, rate_hz=RATE_HZ, scale=1.0):
    """A view whose residual is noise with a line at 200 Hz and a ripple over the position."""
    t = np.arange(u.size) / rate_hz
    noise = np.random.default_rng(2).standard_normal(u.size)
    ripple = np.sin(2 * np.pi * position / max(np.ptp(position) / 15, 1e-30))
    residual = scale * (noise + 3 * np.sin(2 * np.pi * 200 * t) + 2 * ripple)
    return RecordView(rate_hz, u, position, np.gradient(position, 1 / rate_hz), residual, temperature_k, 29.6)


def views(nominal):
    """Records of several kinds: the bench's, a quantised one, a piezo's in V and m, a short one, one at rest."""
    u, x = nominal["command_theta_x"], nominal["theta_x"]
    sweep = np.sin(2 * np.pi * np.cumsum(np.linspace(1, 300, 8192)) / 6400)
    yield "bench", view_of(u, x, temperature_k=nominal["temperature"], scale=1e-7)
    yield "quantised", view_of(u, np.round(x / 1e-5) * 1e-5, scale=1e-7)
    yield "piezo", view_of(0.2 * sweep, 1e-6 + 1e-7 * sweep, rate_hz=6400.0, scale=1e-10)
    yield "short", view_of(u[:10], x[:10], scale=1e-7)
    yield "at rest", view_of(np.zeros(500), np.zeros(500), scale=0.0)


def where(cls):
    return "theta_y->theta_x" if cls.aux in (Aux.SOURCE_COMMAND, Aux.SOURCE_POSITION) else "theta_x"


def shapes_for(cls, nominal):
    """Return the first start that any of the records offers."""
    return next((s[0] for s in (cls.guess(view) for _, view in views(nominal)) if s), {})


def natural_sizes(cls, nominal, share=0.05):
    """Return sizes that are `share` of what the record's own signals make natural."""
    scale = {"u": 0.05, "y": float(np.max(np.abs(nominal["theta_x"]))), "s": 0.01, "k": 1.0}
    return {p.name: min(share * p.dimension.scale(**scale), p.high) for p in cls.parameters() if p.size}


@by_name(STEPPED)
def test_a_step_knows_nothing_but_its_arguments(cls):
    """What is kept of its machine code goes by its bytecode, names and constants: a global's value is not in them."""
    used = set(cls.step.__wrapped__.__code__.co_names)
    assert used <= {"math", *dir(math), *dir(builtins)}


def test_a_law_of_several_lines_is_written_once():
    """Two effects may add the same at different sites; then they share the step. `p[0] * aux` need not be shared."""
    written: dict[str, set[str]] = {}
    for cls in STEPPED:
        step = cls.step.__wrapped__
        (law,) = ast.parse(inspect.getsource(step)).body
        assert isinstance(law, ast.FunctionDef)
        if len(law.body) > 1:
            written.setdefault(cls.step.key.rpartition(".")[2], set()).add(step.__module__)
    assert len(written) > 10
    assert [sorted(modules) for modules in written.values() if len(modules) > 1] == []


def test_library_is_the_table():
    table = {slug: family for family, slugs in TABLE.items() for slug in slugs.split()}
    assert {cls.reported() for cls in EFFECTS} == set(table)
    assert {cls.name for cls in EFFECTS} - set(table) == {
        "jiles-atherton",
        "bouc-wen",
        "drive-hysteresis",
        "presliding-friction",
        "soft-saturation",
    }
    assert {cls.name: cls.family for cls in EFFECTS if cls.name in table} == table
    assert len({cls.name for cls in ALL}) == len(ALL)


@by_name(ALL)
def test_names_and_texts(cls):
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", cls.name)
    assert cls.__module__ == f"sim_backend.effects.{cls.name.replace('-', '_')}"
    assert effect_class(cls.name) is cls
    assert cls.family in TABLE
    # the sentence "the residual …"
    assert re.match(r"[a-z]", cls.symptom) and not cls.symptom.endswith(".") and "residual" not in cls.symptom
    assert cls.__doc__ and not cls.__doc__.startswith(cls.__name__ + "("), "a dataclass writes a docstring of its own"
    assert cls.parameters(), "an effect without parameters has no neutral value"
    for p in cls.parameters():
        assert p.about and not p.about.endswith("."), p.name
        assert p.low <= p.neutral <= p.high, p.name
        assert not (p.size and p.neutral != 0.0) and not (p.size and p.fixed), p.name


@by_name(ALL)
def test_units_are_strings_that_a_person_reads(cls):
    for p in cls.parameters():
        for u, y in (("N m", "rad"), ("V", "m"), ("1", "1")):
            unit = p.dimension.unit(u, y)
            assert unit and unit == unit.strip() and "  " not in unit, (p.name, unit)


@pytest.mark.parametrize(
    ("dimension", "unit"),
    [
        (Dimension(u=1, y=-3), "N m/rad^3"),
        (Dimension(u=-2), "1/(N m)^2"),
        (Dimension(u=1, y=-1, k=-1), "N m/rad/K"),
        (Dimension(u=1, y=-2, s=1), "N m s/rad^2"),
        (Dimension(), "1"),
    ],
)
def test_units_by_hand(dimension, unit):
    assert dimension.unit("N m", "rad") == unit


@by_name(ALL)
def test_neutral_is_no_effect_bit_for_bit(cls, nominal):
    assert cls(where(cls)).is_neutral()
    places = [where(cls)]
    places += ["a2"] if cls.site in (Site.COMMAND, Site.CURRENT, Site.STRUCTURE) and "->" not in places[0] else []
    places += ["s2"] if cls.site in (Site.HEAD, Site.READING) and "->" not in places[0] else []
    shapes = shapes_for(cls, nominal) if cls.sizes() else {}
    for place in places:
        got = play([EffectEntry(effect=cls.name, where=place, parameters=shapes)])
        for channel, values in nominal.items():
            np.testing.assert_array_equal(got[channel], values, err_msg=f"{channel} with {cls.name} at {place}")


@by_name(ALL)
def test_not_neutral_is_seen_in_the_reading(cls, nominal):
    parameters = {**shapes_for(cls, nominal), **natural_sizes(cls, nominal)}
    assert not make_effect(cls.name, where(cls), parameters).is_neutral()
    got = play([EffectEntry(effect=cls.name, where=where(cls), parameters=parameters)])
    changed = np.max(np.abs(got["theta_x"] - nominal["theta_x"]))
    # far above rounding (1e-16 of the swing of 5 mrad) and finite
    assert np.isfinite(changed) and changed > 1e-12, changed


def random_walks(nominal, n=400):
    """Signals without any plan; the position goes to twice the largest of the record, beyond every gap guessed."""
    rng = np.random.default_rng(3)
    position = np.cumsum(rng.standard_normal(n))
    position *= 2.0 * np.max(np.abs(nominal["theta_x"])) / np.max(np.abs(position))
    return {
        "signal": 0.05 * rng.uniform(-1, 1, n),
        "position": position,
        "rate": np.gradient(position, 1e-4),
        "aux": rng.standard_normal(n),
    }


@by_name([cls for cls in STEPPED if cls.sizes()])
def test_contribution_is_linear_in_the_sizes(cls, nominal):
    walks, shapes = random_walks(nominal), shapes_for(cls, nominal)
    rng = np.random.default_rng(4)
    one, two = ({k: v * rng.uniform(0.2, 1) for k, v in natural_sizes(cls, nominal).items()} for _ in range(2))
    both = {k: 2.0 * one[k] + 0.5 * two[k] for k in one}
    first, second, sum_ = (along(cls("theta_x->theta_x", **shapes, **s), **walks) for s in (one, two, both))
    # some ten additions and multiplications, each rounded to 1e-16 of its largest term
    np.testing.assert_allclose(sum_, 2.0 * first + 0.5 * second, rtol=0, atol=1e-14 * np.max(np.abs(sum_)))
    assert np.any(first != 0.0)


@by_name(STEPPED)
def test_neutral_contribution_is_exactly_zero(cls, nominal):
    shapes = shapes_for(cls, nominal) if cls.sizes() else {}
    np.testing.assert_array_equal(along(cls("theta_x->theta_x", **shapes), **random_walks(nominal)), 0.0)


@by_name(STEPPED)
def test_step_stands_alone(cls):
    # numba's cache sees neither other files nor changed globals: a step may name only `math` and builtins
    names = {n for n in cls.step.__wrapped__.__code__.co_names if n in cls.step.__wrapped__.__globals__}
    assert names <= {"math"}, names
    assert all(n in dir(math) or hasattr(builtins, n) or n == "math" for n in cls.step.__wrapped__.__code__.co_names)


@by_name(ALL)
def test_guesses_are_valid_starts(cls, nominal):
    own = {p.name for p in cls.parameters() if not p.size}
    offered = 0
    for kind, view in views(nominal):
        starts = cls.guess(view)
        offered += len(starts)
        for start in starts:
            assert set(start) <= own, kind
            cls(where(cls), **start)
        if cls in EFFECTS and cls.shapes() and starts:
            assert all(set(cls.shapes()) <= set(start) for start in starts), "a start chooses every shape"
    assert offered > 0, "no record of any kind shows it"


@by_name(ALL)
def test_bounds_are_enforced_with_the_value_and_the_limit(cls):
    for p in cls.parameters():
        outside = [v for v, edge in ((p.low - 1.0, p.low), (p.high + 1.0, p.high)) if math.isfinite(edge)]
        for value in (*outside, math.nan):
            with pytest.raises(ConfigError, match=f"effect {cls.name} at x: {p.name} is .*it must lie in"):
                cls("x", **{p.name: value})
        if not math.isinf(p.neutral):
            with pytest.raises(ConfigError, match=p.name):
                cls("x", **{p.name: math.inf})


@by_name(ALL)
def test_unknown_parameters_and_places_are_refused(cls):
    with pytest.raises(ConfigError, match="has no parameter 'colour'"):
        make_effect(cls.name, "theta_x", {"colour": 1.0})
    nowhere = "theta_y->nowhere" if "->" in where(cls) else "nowhere"
    with pytest.raises(ConfigError, match="nowhere"):
        SimBench(three_axes([EffectEntry(effect=cls.name, where=nowhere)]), 1)


@by_name([cls for cls in ALL if cls.aux in (Aux.SOURCE_COMMAND, Aux.SOURCE_POSITION)])
def test_effects_between_channels_need_both(cls):
    with pytest.raises(ConfigError, match="source->target"):
        SimBench(three_axes([EffectEntry(effect=cls.name, where="theta_x")]), 1)


def parameter_values(cls):
    """Draw every parameter within its bounds, over many orders of magnitude."""
    magnitude = st.floats(-9, 3).map(lambda e: 10.0**e)

    def value(p):
        signed = magnitude if p.low >= 0 else st.tuples(magnitude, st.sampled_from([-1.0, 1.0])).map(math.prod)
        return signed.map(lambda v: min(max(v, p.low), p.high))

    return st.fixed_dictionaries({p.name: value(p) for p in cls.parameters()})


@by_name(STEPPED)
@settings(max_examples=40)
@given(data=st.data())
def test_finite_for_any_finite_input(cls, data):
    effect = cls("theta_x->theta_x", **data.draw(parameter_values(cls)))
    numbers = st.lists(st.floats(-1e6, 1e6), min_size=20, max_size=20).map(np.array)
    walks = {name: data.draw(numbers) for name in ("signal", "position", "rate", "aux")}
    out = along(effect, **walks, dt_s=10.0 ** data.draw(st.floats(-6, 0)))
    assert np.all(np.isfinite(out)), effect


@by_name([cls for cls in ALL if cls.aux is Aux.EXOGENOUS])
def test_numbers_are_drawn_into_what_is_given(cls):
    effect = cls("theta_x->theta_x", **{p.name: 1.0 for p in cls.parameters()})
    table = np.full((2, 100), np.nan)
    drawn = effect.draw(100, RATE_HZ, np.random.default_rng(6), out=table[1])
    assert drawn.base is table and np.isnan(table[0]).all()
    np.testing.assert_array_equal(drawn, effect.draw(100, RATE_HZ, np.random.default_rng(6)))


@by_name([cls for cls in ALL if cls.site is Site.MODEL])
def test_retune_changes_no_other_axis_and_keeps_the_model_it_is_given(cls, nominal):
    model = three_axes().linear()
    before = {name: getattr(model, name).copy() for name in ModalModel.__dataclass_fields__}
    f_hz = np.geomspace(1, 3000, 50)
    effect = cls("theta_x", **{**shapes_for(cls, nominal), **natural_sizes(cls, nominal)})
    changed, response = effect.retune(model, 0, 0).frequency_response(f_hz), model.frequency_response(f_hz)
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(model, name), values)
    np.testing.assert_array_equal(changed[:, 1:, 1:], response[:, 1:, 1:])
    assert np.max(np.abs(changed[:, 0, 0] - response[:, 0, 0])) > 1e-6 * np.max(np.abs(response[:, 0, 0]))
    np.testing.assert_array_equal(cls("theta_x").retune(model, 0, 0).frequency_response(f_hz), response)


@by_name([cls for cls in ALL if cls.site is Site.RECORD])
def test_rewriting_keeps_the_length_and_the_input(cls, nominal):
    values = nominal["theta_x"].copy()
    effect = cls("theta_x", **{**shapes_for(cls, nominal), **natural_sizes(cls, nominal)})
    out = effect.rewrite(values, RATE_HZ, np.random.default_rng(0))
    assert out.shape == values.shape and np.any(out != values)
    np.testing.assert_array_equal(values, nominal["theta_x"])
    got = play(
        [
            EffectEntry(
                effect=cls.name, where="theta_x", parameters={p.name: getattr(effect, p.name) for p in cls.parameters()}
            )
        ]
    )
    for channel in nominal.keys() - {"theta_x"}:
        np.testing.assert_array_equal(got[channel], nominal[channel], err_msg=channel)


def test_an_effect_added_leaves_the_noise_of_the_others_as_it_was(nominal):
    loud = play([EffectEntry(effect="apex-noise", where="theta_x", parameters={"linear": 1e-3})])
    np.testing.assert_array_equal(loud["head_s1"], nominal["head_s1"])
    assert np.std(loud["theta_x"] - nominal["theta_x"]) > 1e-7
