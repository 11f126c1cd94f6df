"""The pictures of a diagnosis against closed forms: what is drawn is the force, the response and the stretch."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest
from scipy.signal import cont2discrete, lfilter

from analysis.diagnosis.answer.figures import bode_figure, evidence_figures, swing_rows
from analysis.diagnosis.answer.mechanism import SEEN, Quantity, drawn_over, explained, mechanism_figure
from analysis.diagnosis.answer.opening import opening_figure, opening_output
from analysis.diagnosis.answer.page import write_page
from analysis.diagnosis.answer.surety import surety
from analysis.diagnosis.calibration import counted
from analysis.diagnosis.evidence.as_given import error_as_given
from analysis.diagnosis.evidence.domains import evidence
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.result import Cause, Diagnosis, Domain, Estimate, Gain, Remainder
from sim_backend.effects import make_effect
from sim_backend.model import EffectEntry, Mode, Model, Port

RATE_HZ = 1000.0
HZ, DECAY = 20.0, 12.0
NOISE_RAD = 1e-5
FRICTION_NM, SPRING = 0.02, 1.0
BREAKAWAY = 0.3


def axis(*effects: EffectEntry) -> Model:
    """One axis at 20 Hz, DC gain 1 rad/N m."""
    square = (2.0 * np.pi * HZ) ** 2
    return Model(
        name="axis",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="u", unit="N m", dof="x")],
        outputs=[Port(name="y", unit="rad", dof="x")],
        modes=[Mode(label="1", frequency_hz=HZ, decay_rate_1_s=DECAY, input={"u": square}, output={"y": 1.0})],
        effects=list(effects),
    )


def answer(force: np.ndarray) -> np.ndarray:
    """What the axis answers to a force held between samples, by the transfer function of scipy."""
    square = (2.0 * np.pi * HZ) ** 2
    b, a, _ = cont2discrete(([square], [1.0, 2.0 * DECAY, square]), 1.0 / RATE_HZ)
    return lfilter(b.ravel(), a, force)


def followed(u: np.ndarray, effect: str) -> np.ndarray:
    """Return the force that follows the motion under a drive, held between samples as the drive is."""
    square = (2.0 * np.pi * HZ) ** 2
    a, b = np.array([[0.0, 1.0], [-square, -2.0 * DECAY]]), np.array([[0.0], [square]])
    a, b, *_ = cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), 1.0 / RATE_HZ)
    state = np.zeros(2)
    force = np.zeros(u.size)
    for k, drive in enumerate(u):
        law = -FRICTION_NM * np.tanh(state[1] / BREAKAWAY) if "friction" in effect else -SPRING * state[0] ** 3
        force[k] = law
        state = a @ state + b[:, 0] * (drive + law)
    return force


def diagnosed(effect: str, verdict: str = "named", rows: int = 20_000) -> tuple[Diagnosis, np.ndarray, np.ndarray]:
    """Return a diagnosis of a record with a force that follows the motion, that force, and the position."""
    rng = np.random.default_rng(3)
    t = np.arange(rows) / RATE_HZ
    u = 0.2 * np.sin(2.0 * np.pi * 3.0 * t) + lfilter([0.005], [1.0, -0.98], rng.standard_normal(rows))
    force = followed(u, effect)
    x = answer(u + force)
    y = x + NOISE_RAD * rng.standard_normal(rows)
    half = rows // 2
    windows = (Window("fitted", 0, half), Window("held-out", half, rows, held_out=True))
    linear = axis().linear()
    numbers = {"torque": FRICTION_NM, "breakaway_rate": BREAKAWAY} if "friction" in effect else {"stiffness": SPRING}
    named = Cause(effect, "x", 0.97, {}, "why")
    found = Diagnosis(
        verdict=verdict,  # type: ignore[arg-type]
        sentence="A sentence.",
        causes=(named,) if verdict == "named" else (),
        ambiguous=(),
        evidence={},
        gain=Gain(("uid#held-out",), 0.5, 0.1, 0.09, 0.8, (0.78, 0.82)),
        next_experiment=None,
        data=Dataset(RATE_HZ, (Record("uid", u[:, None], y[:, None], windows),)),
        nominal=linear,
        linear=linear,
        effects=(make_effect(effect, "x", numbers),),
        before=((y - answer(u))[:, None],),
        after=((y - x)[:, None],),
    )
    return found, force, x


def white() -> Whitener:
    """The whitener of the record's noise."""
    return Whitener(np.array([[1.0 / NOISE_RAD]]), True)


def drawn(canvas, series: str):
    numbers = canvas.numbers()
    part = numbers[numbers.series == series]
    return part.x.to_numpy(), part.y.to_numpy(), part.x_quantity.iloc[0], part.y_quantity.iloc[0]


def test_friction_is_seen_over_the_rate_with_its_torque():
    found, *_ = diagnosed("coulomb-friction")
    figure = mechanism_figure(found, axis(), white())
    assert figure is not None
    for series in ("measured", "extended model"):
        x, y, over, what = drawn(figure.canvas, series)
        assert over == "rate of x (rad/s)" and what == "torque that the linear model lacks (mN m)"
        fast = np.abs(x) > 1.0
        # the corners of a force that switches are beyond the noise's band: its mean is not
        assert np.mean(y[fast] * np.sign(x[fast])) == pytest.approx(-1e3 * FRICTION_NM, rel=0.1), series


def test_a_spring_is_seen_over_the_position_with_its_cube():
    found, *_ = diagnosed("cubic-stiffness")
    figure = mechanism_figure(found, axis(), white())
    assert figure is not None
    x, y, over, _ = drawn(figure.canvas, "measured")
    assert over == "position of x (mrad)"
    cube = float(np.sum(y * x**3) / np.sum(x**6))
    # force in mN m over the cube of mrad: 1e-3 / 1e-9
    assert cube * 1e6 == pytest.approx(-SPRING, rel=0.05)
    assert "is a function of position of x" in figure.caption


def test_without_an_effect_there_is_no_picture_of_one():
    found, *_ = diagnosed("coulomb-friction", "unknown")
    assert mechanism_figure(dataclasses.replace(found, effects=()), axis(), white()) is None


def test_what_a_quantity_explains_is_all_of_its_own_and_nothing_of_another():
    rng = np.random.default_rng(0)
    x, other = rng.standard_normal((2, 30_000))
    assert explained(x, np.sign(x)) > 0.95
    # thirty means of chance: 30 / 30,000
    assert explained(other, np.sign(x)) < 0.005
    assert explained(np.zeros(100), x[:100]) == 0.0


def test_the_opening_shows_held_out_rows_where_the_extended_model_gains_most():
    found, *_ = diagnosed("cubic-stiffness")
    figure = opening_figure(found.data, found.before, found.after, np.array([NOISE_RAD]), axis())
    assert figure is not None
    t, shown, *_ = drawn(figure.canvas, "measured")
    y = found.data.records[0].y[10_000:, 0]
    rows = np.round(t * RATE_HZ).astype(int)
    assert shown == pytest.approx(1e3 * y[rows])
    left = found.before[0][10_000:, 0] ** 2 - found.after[0][10_000:, 0] ** 2
    length = int(rows[-1] - rows[0]) + 1
    sums = np.convolve(left, np.ones(length), "valid")
    assert sums[rows[0]] == pytest.approx(sums.max(), rel=1e-6)
    simulated = 1e3 * (y - found.before[0][10_000:, 0])
    numbers = figure.canvas.numbers()
    above = numbers[(numbers.series == "adjusted") & (numbers.panel == "x")]
    assert above.y.to_numpy() == pytest.approx(simulated[np.round(above.x * RATE_HZ).astype(int)])


def test_what_is_small_beside_the_error_before_has_a_panel_of_its_own():
    found, *_ = diagnosed("cubic-stiffness")
    rms = np.array([NOISE_RAD])
    figure = opening_figure(found.data, found.before, tuple(0.001 * x for x in found.before), rms, axis())
    assert figure is not None
    numbers = figure.canvas.numbers()
    panels = {panel: set(rows.series) for panel, rows in numbers.groupby("panel")}
    assert panels["panel 2"] == {"as given", "adjusted"} and panels["panel 3"] == {"extended"}
    largest = np.abs(numbers[numbers.panel == "panel 3"].y).max()
    assert figure.canvas.axes[2].get_ylim()[1] < 2.0 * max(largest, 2.0 * 1e6 * NOISE_RAD)
    figure = opening_figure(found.data, found.before, tuple(0.5 * x for x in found.before), rms, axis())
    assert figure is not None and len(figure.canvas.axes) == 2


def test_the_opening_shows_the_output_that_gains_whatever_another_misses():
    n = 2000
    record = Record("uid", np.zeros((n, 2)), np.zeros((n, 2)), (Window("held-out", 0, n, held_out=True),))
    data, noise = Dataset(RATE_HZ, (record,)), np.ones(2)
    before, after = np.full((n, 2), [9.0, 3.0]), np.full((n, 2), [9.0, 1.0])
    assert opening_output(data, [before], [after], noise) == 1
    assert opening_output(data, [before], [before], noise) == 0


def test_a_cause_is_drawn_over_its_own_motion_where_another_moves_with_it():
    rng = np.random.default_rng(0)
    x = rng.standard_normal(5000)
    force = np.sign(x) + 0.3 * rng.standard_normal(x.size)
    own = Quantity("command", "command of y", "N", x + 0.2 * rng.standard_normal(x.size))
    other = Quantity("command", "command of x", "N", x, own=False)
    effect = make_effect("dead-zone", "y", {"width": 1.0})
    assert explained(other.values, force) > explained(own.values, force) > SEEN
    chosen = drawn_over(effect, force, [other, own])
    assert chosen is not None and chosen[0] is own
    unlike = dataclasses.replace(own, values=rng.standard_normal(x.size))
    chosen = drawn_over(effect, force, [other, unlike])
    assert chosen is not None and chosen[0] is other


def test_a_consistent_model_is_drawn_once():
    found, *_ = diagnosed("cubic-stiffness")
    figure = opening_figure(found.data, found.after, found.after, np.array([NOISE_RAD]), axis())
    assert figure is not None
    assert set(figure.canvas.numbers().series) == {"measured", "as given", "adjusted"}


def test_swings_are_those_of_the_motion_and_not_of_the_noise():
    rng = np.random.default_rng(0)
    t = np.arange(10_000) / RATE_HZ
    y = np.sin(2.0 * np.pi * 5.0 * t) + 0.05 * rng.standard_normal(t.size)
    assert swing_rows(y) == pytest.approx(200, rel=0.05)
    assert swing_rows(np.zeros(1000)) == 500


def test_what_limits_an_answer_and_what_to_do_is_told_beside_it():
    found, *_ = diagnosed("coulomb-friction")
    curve = Domain("uid", "x", np.zeros(2), "rad", np.ones(2), np.ones(2), 1e-30, "x at 3 mrad")
    more = dataclasses.replace(
        found,
        gain=None,
        remainder=Remainder(0.06, 1e-9, "grows with position"),
        notes=("the noise is taken from the residual",),
        considered=(("backlash", -np.log(50.0)), ("delay", -90.0)),
        evidence={"rate": (curve,)},
    )
    told = surety(more)
    blind = counted(found.causes[0].posterior)
    assert blind is not None
    assert told.how[0] == f"Coulomb friction at x: {100.0 * found.causes[0].probability:.0f} % probable."
    assert told.how[1].startswith(f"Of {blind.names} such names in blind cases on simulated benches {blind.right} were")
    assert told.limits[0] == (
        "Of the explanations compared, the next best, backlash, makes the data 50 times less likely."
    )
    assert "6.00 % of the squared error" in told.limits[1] and "p = 1·10⁻⁹" in told.limits[1]
    assert told.limits[2].startswith("No segment was held out")
    assert told.limits[3] == "The noise is taken from the residual"
    far = dataclasses.replace(more, considered=(("b", -200.0 * np.log(10.0) - 0.1),))
    assert "10²⁰⁰ times" in surety(far).how[-1] and not any("10²⁰⁰" in text for text in surety(far).limits)
    assert "nothing is tied" in told.steps[0]
    assert any("at least twice" in step for step in told.steps) and any("Hold out" in step for step in told.steps)
    unknown = dataclasses.replace(more, verdict="unknown", causes=())
    assert surety(unknown).how == ("That the model is wrong: by rate, x at 3 mrad (p < 10⁻¹²).",)


def test_the_opening_shows_the_model_as_given_and_the_response_a_found_gain():
    found, *_ = diagnosed("cubic-stiffness")
    record = found.data.records[0]
    read = dataclasses.replace(record, y=1.3 * answer(record.u[:, 0])[:, None])
    found = dataclasses.replace(
        found, data=Dataset(RATE_HZ, (read,)), effects=(make_effect("sensor-gain", "x", {"relative": 0.3}),)
    )
    still = (np.full_like(read.y, NOISE_RAD),)
    figure = opening_figure(found.data, still, still, np.array([NOISE_RAD]), axis())
    assert figure is not None
    _, measured, *_ = drawn(figure.canvas, "measured")
    numbers = figure.canvas.numbers()
    given = numbers[(numbers.series == "as given") & (numbers.panel == "x")].y.to_numpy()
    assert given == pytest.approx(measured / 1.3, abs=1e-9 * np.abs(measured).max())
    response = bode_figure(found, axis(), 0)
    assert response is not None
    curves = [drawn(response.canvas, name)[1] for name in ("extended", "as given")]
    sizes = [curve[: curve.size // 3] for curve in curves]  # magnitude, phase, ratio
    assert sizes[0] == pytest.approx(1.3 * sizes[1])


def test_the_error_of_the_model_as_given_is_that_of_the_held_out_rows():
    found, *_ = diagnosed("cubic-stiffness")
    record = found.data.records[0]
    read = dataclasses.replace(record, y=1.3 * answer(record.u[:, 0])[:, None])
    data = Dataset(RATE_HZ, (read,))
    error = error_as_given(data, axis(), ["x"])
    late = read.y[10_000:, 0]
    expected = 0.3 / 1.3 * np.sqrt(np.mean(late**2)) / np.std(late)
    assert error == pytest.approx(expected, rel=1e-6)
    assert error_as_given(data, axis(), []) is None


def test_the_model_as_given_has_the_effects_that_its_file_states():
    found, _, x = diagnosed("cubic-stiffness")
    stiff = axis(EffectEntry(effect="cubic-stiffness", where="x", parameters={"stiffness": SPRING}))
    late = found.data.records[0].y[10_000:, 0]
    noise = NOISE_RAD / np.std(late)
    # the force of the record is held for a sample, half a sample late: 2 pi 20 Hz 0.5 ms = 6.3 % of it at resonance
    error, without = (error_as_given(found.data, model, ["x"]) for model in (stiff, axis()))
    assert without is not None and without > 100.0 * noise
    assert error == pytest.approx(noise, abs=0.063 * without)
    figure = opening_figure(found.data, found.after, found.after, np.array([NOISE_RAD]), stiff)
    assert figure is not None
    numbers = figure.canvas.numbers()
    _, measured, *_ = drawn(figure.canvas, "measured")
    given = numbers[(numbers.series == "as given") & (numbers.panel == "x")].y.to_numpy()
    assert given == pytest.approx(measured, abs=0.01 * np.abs(measured).max())


@pytest.mark.parametrize("period", [0, 500])
def test_a_page_says_where_the_noise_is_that_of_the_residual(tmp_path, period):
    """Where periods repeat it is known by itself, even if it is as large as all that is left."""
    found, *_ = diagnosed("cubic-stiffness", rows=4000)
    (record,) = found.data.records
    windows = tuple(dataclasses.replace(w, period=period) for w in record.windows)
    data = dataclasses.replace(found.data, records=(dataclasses.replace(record, windows=windows),))
    gain = Gain(("uid#held-out",), 0.5, 0.1, 0.1, 0.8, (0.7, 0.9))
    page = write_page(dataclasses.replace(found, gain=gain, data=data), axis(), (), tmp_path)["index.html"].read_text()
    assert ("down to the noise" in page) == (period > 0)
    assert ("estimated from this very residual" in page) == (period == 0)


@pytest.mark.parametrize(
    ("verdict", "ci95", "shown", "missing"),
    [
        ("ambiguous", (-0.1, 0.1), (), ("extended model:", "less error", "noise not known")),
        ("ambiguous", (0.7, 0.9), ("extended model:", "less error", "noise not known"), ()),
        ("unknown", (0.7, 0.9), ("the best that the library can do",), ("extended model:", "less error", "noise")),
        ("named", (0.7, 0.9), ("extended model:", "less error", "noise not known"), ("−435",)),
    ],
)
def test_the_tiles_say_what_the_headline_says(tmp_path, verdict, ci95, shown, missing):
    found, *_ = diagnosed("cubic-stiffness", verdict, rows=4000)
    gain = Gain(("uid#held-out",), 5.351, 0.1, 0.09, 0.8, ci95, rms_given=5.5)
    page = write_page(dataclasses.replace(found, gain=gain), axis(), (), tmp_path)["index.html"].read_text()
    tiles = page[page.index('class="tiles"') : page.index("<nav")]
    assert "no fit" in tiles and "fit of the model as given: error 550\N{NO-BREAK SPACE}%" in tiles
    for text in shown:
        assert text in tiles, text
    for text in missing:
        assert text not in tiles, text


def test_many_causes_of_one_kind_stand_in_one_table_and_those_that_no_number_shows_are_told(tmp_path):
    found, *_ = diagnosed("cubic-stiffness", rows=4000)
    sure, unsure = {"softening": Estimate(0.02, 0.001, "1")}, {"softening": Estimate(0.02, 0.01, "1")}
    causes = tuple(
        Cause("slow-softening", f"mode {k}", 0.999, unsure if k == 3 else sure, "it softens") for k in range(1, 6)
    )
    page = write_page(dataclasses.replace(found, causes=causes), axis(), (), tmp_path)["index.html"].read_text()
    part = page[page.index('<section id="causes">') :]
    part = part[: part.index("</section>")]
    assert part.count("<table>") == 1 and part.count("it softens") == 1 and part.count("mode 3") == 3
    assert "At mode 3 no number is three standard deviations from zero" in part
    assert "Slow softening at 5 modes: each " in page


def test_both_curves_of_the_evidence_are_in_one_noise(tmp_path):
    """Halved, a residual is half as high everywhere; in a noise that is estimated from it, it would be as high."""
    found, *_ = diagnosed("cubic-stiffness", rows=4000)
    half = tuple(0.5 * left for left in found.before)
    shown = evidence(found.data, found.before, whitener_from(found.data, list(found.before)), axis())
    write_page(dataclasses.replace(found, after=half, evidence=shown, even=True), axis(), (), tmp_path)
    drawn = pd.read_csv(tmp_path / "figures" / "evidence-frequency.csv")
    levels = {name: rows.y.to_numpy() for name, rows in drawn.groupby("series")}
    assert levels["extended"] == pytest.approx(0.5 * levels["adjusted"], rel=1e-6)


def test_a_curve_that_is_worse_beside_the_extension_is_within_the_axis():
    found, *_ = diagnosed("cubic-stiffness", rows=4000)
    quiet = tuple(0.5 * NOISE_RAD / np.std(left) * left for left in found.before)
    (curve,) = evidence(found.data, quiet, white(), axis())["direction"]
    (figure,) = evidence_figures(
        {"direction": (curve,)}, {"direction": (dataclasses.replace(curve, level=3.0 * curve.level),)}, axis()
    )
    assert figure.canvas.axes[0].get_ylim()[1] > 3.0 * np.max(curve.level)


def test_a_loop_is_drawn_without_the_spring_that_it_is_beside():
    """A spring that slips: its straight line would hide the loops, which are drawn for two swings."""
    found, force, x = diagnosed("cubic-stiffness")
    play = 0.1 * np.max(np.abs(x))
    held = np.zeros_like(x)
    for k in range(1, x.size):
        held[k] = np.clip(held[k - 1], x[k] - play, x[k] + play)
    loop = 0.2 * (x - held)  # a spring beside what stays behind at each reversal
    y = answer(found.data.records[0].u[:, 0] - loop)
    noise = NOISE_RAD * np.random.default_rng(2).standard_normal(x.size)
    record = dataclasses.replace(found.data.records[0], y=(y + noise)[:, None])
    effect = make_effect("hysteresis", "x", {"stiffness_1": 0.2, "reach": play})
    named = Cause("hysteresis", "x", 0.97, {}, "why")
    found = dataclasses.replace(
        found,
        data=Dataset(RATE_HZ, (record,)),
        causes=(named,),
        effects=(effect,),
        before=((y + noise - answer(record.u[:, 0]))[:, None],),
        after=(noise[:, None],),
    )
    figure = mechanism_figure(found, axis(), white())
    assert figure is not None
    at, force, _, what = drawn(figure.canvas, "extended model")
    assert what.startswith("torque less its linear part")
    assert abs(np.corrcoef(at, force)[0, 1]) < 0.5
    assert "in proportion to the position" in figure.caption
