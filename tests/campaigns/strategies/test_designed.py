"""Designed strategies on benches that are, or are not, what they were designed on: theory says what is left."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from campaigns.calibration import INSIDE_PERCENT
from campaigns.plans import checked_segments, make_plan
from campaigns.playing.campaign import load_campaign
from campaigns.playing.designed_campaign import designed_campaign
from campaigns.strategies.controller import AxisControl, Blocks, Controller, dump_controller
from campaigns.strategies.design import Design
from campaigns.strategies.designed import feedforward_of, mechanism, motion_of
from sim_backend.control.chop import Chop
from sim_backend.control.concentrated import concentrated_move
from sim_backend.control.feedback import theta_controller
from sim_backend.control.inversion import fitted_inverse, inverse_poles
from sim_backend.control.repetitive import process_sensitivity, q_response, q_taps
from sim_backend.errors import ConfigError
from sim_backend.linear import discretise
from sim_backend.model import EffectEntry
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model

RATE_HZ, PERIOD, DWELL = 10_000.0, 2000, 1000
GAIN = 0.5


def controller(model=None):
    """Return a controller of θy designed on the small bench's own modes."""
    known = bench_model(hardware=False) if model is None else model
    plant, feedback = discretise(Design(known, RATE_HZ).axis("theta_y"), RATE_HZ), theta_controller()
    f = np.geomspace(0.5, 4900.0, 1500)
    closed = process_sensitivity(plant.frequency_response(f)[:, 0, 0], feedback.frequency_response(f))
    weight = np.where(f < 1500.0, 1.0, 0.01)
    learning = fitted_inverse(f, closed, weight, inverse_poles(plant, feedback), 10, RATE_HZ)
    axis = AxisControl(
        dof="theta_y",
        reach_rad=8.5e-3,
        move_samples=60,
        concentration=3.0,
        feedback=Blocks.of(feedback),
        learning=Blocks.of(learning),
        lead_samples=10,
        q_cutoff_hz=700.0,
        q_half_length=60,
        wait_s=0.4,
        gains=[GAIN] * 4,
    )
    coils = SimBench(bench_model(), 0).limits.to_current.tolist()
    return Controller(name="test", sample_rate_hz=RATE_HZ, model=known, axes=[axis], to_current=coils)


@pytest.fixture
def path(tmp_path: Path) -> str:
    file = tmp_path / "controller.toml"
    file.write_text(dump_controller(controller()), encoding="utf-8")
    return str(file)


def play(bench, path, strategy, **settings):
    """Return θy and its reference by phase, each (periods, PERIOD)."""
    chosen = {"strategy": strategy, "controller": path, "alpha_deg": 90.0, "cycles": 3, **settings}
    out: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for segment in checked_segments(make_plan("settling", chosen), bench):
        record = bench.play(segment)
        if segment.n_samples % PERIOD == 0:
            y = record.channels["theta_y"].reshape(-1, PERIOD)
            phase = str(segment.settings["phase"])
            before = [out[phase][0]] if phase in out else []
            out[phase] = (np.concatenate([*before, y]), segment.reference[:, 1])
    return out


def test_a_perfect_model_is_followed(path):
    y, reference = play(SimBench(bench_model(), 0), path, "designed-modes")["chop"]
    # the input of a motion without beginning acts a little ahead of each move: before the first one it could not, and
    # the move's spectrum beyond its band, some 1e-6 of 8.5 mrad, is what is missing; after one period, rounding
    np.testing.assert_allclose(y[0], reference, atol=1e-6 * 8.5e-3 * 10.0)
    np.testing.assert_allclose(y[1:], np.tile(reference, (2, 1)), atol=1e-13)


def test_what_the_feedforward_knows_can_be_less_than_the_model(path):
    known = bench_model(hardware=False)
    weak = msgspec.structs.replace(known.modes[1], label="weak", frequency_hz=200.0, input={"torque_y": 60.0})
    model = msgspec.structs.replace(known, modes=[*known.modes, weak])
    plant = Design(model, RATE_HZ).axis("theta_y")
    assert plant.n_blocks == 2 and mechanism(plant).n_blocks == 1
    design = Design(model, RATE_HZ, controller(model))
    assert design.controller is not None
    motion = motion_of(design.controller.axes[0], Chop((8.5e-3, 0.0), DWELL, RATE_HZ))
    linear, modes = (feedforward_of(design, "theta_y", motion, k) for k in ("linear", "modes"))
    alone = feedforward_of(Design(known, RATE_HZ), "theta_y", motion, "modes")
    np.testing.assert_array_equal(linear, alone)
    assert np.max(np.abs(modes - linear)) > 1e-3 * np.max(np.abs(linear))


def test_the_iron_is_fed_forward_with_the_other_sign(path):
    spring = EffectEntry(effect="cubic-stiffness", where="theta_y", parameters={"stiffness": 4000.0})
    model = msgspec.structs.replace(bench_model(hardware=False), effects=[spring])
    design = Design(model, RATE_HZ, controller(model))
    assert design.controller is not None
    motion = motion_of(design.controller.axes[0], Chop((8.5e-3, 0.0), DWELL, RATE_HZ))
    difference = feedforward_of(design, "theta_y", motion, "hysteresis") - feedforward_of(
        design, "theta_y", motion, "modes"
    )
    np.testing.assert_allclose(difference, 4000.0 * motion**3, rtol=1e-9, atol=1e-15)


def wrong_bench(factor):
    """Return the small bench with θy driven harder by a factor."""
    model = bench_model()
    modes = [
        m if m.label != "theta_y" else msgspec.structs.replace(m, input={k: v * factor for k, v in m.input.items()})
        for m in model.modes
    ]
    return SimBench(msgspec.structs.replace(model, modes=modes), 0)


def test_learning_shrinks_the_error_by_what_its_response_says(path):
    factor = 1.05
    played = play(wrong_bench(factor), path, "designed")
    lines = {}
    for phase in ("settling in", "learning 1", "learning 2", "learning 3", "chop"):
        y, reference = played[phase]
        lines[phase] = np.fft.rfft(y[-1] - reference)[1:60]
    f = np.arange(1, 60) * RATE_HZ / PERIOD
    plant = discretise(Design(bench_model(hardware=False), RATE_HZ).axis("theta_y"), RATE_HZ)
    p, k = factor * plant.frequency_response(f)[:, 0, 0], theta_controller().frequency_response(f)
    ahead = np.exp(2j * np.pi * f / RATE_HZ * 10) * controller().axes[0].learning.filter(RATE_HZ).frequency_response(f)
    q = q_response(q_taps(700.0, 60, RATE_HZ), f, RATE_HZ)
    left = q * (1.0 - GAIN * p / (1.0 + p * k) * ahead)
    # period by period, the first one from what was heard while settling in: e' = Q (1 - k z^lead S_p L) e + (1 - Q) e_0
    expected = lines["settling in"]
    for phase in ("learning 1", "learning 2", "learning 3"):
        expected = left * expected + (1.0 - q) * lines["settling in"]
        # the loop's own memory of 10 ms reaches across the border of two periods
        error = np.linalg.norm(lines[phase] - expected) / np.linalg.norm(expected)
        assert error < 0.05, phase
    assert np.linalg.norm(lines["chop"]) < 0.08 * np.linalg.norm(lines["settling in"])


def test_waiting_is_a_time_and_learning_ends_early_on_request(path):
    bench = SimBench(bench_model(), 0)

    def phases(**settings):
        plan = make_plan("settling", {"strategy": "designed", "controller": path, "alpha_deg": 90.0, **settings})
        parts = [(s.settings["phase"], s.n_samples // s.reference.shape[0]) for s in checked_segments(plan, bench)]
        return [part for part in parts if part[0] not in ("approach", "chop")]

    learning = [(f"learning {k}", 1) for k in (1, 2, 3, 4)]
    listening = [("settling in", 1), ("settling in", 1)]
    assert phases() == [*listening, *learning]
    assert phases(frequency_hz=0.5) == [("settling in", 1), *learning]  # a period of 2 s is wait enough
    assert phases(tuning={"learning_s": 0.4}) == [*listening, *learning[:2]]
    assert phases(tuning={"learning_s": 0.01}) == [*listening, *learning[:1]]
    assert phases(tuning={"learning_s": 60.0}) == [*listening, *learning]


def test_what_was_learned_stays_when_learning_ends(path):
    y, _ = play(wrong_bench(1.05), path, "designed", cycles=6)["chop"]
    # the bench is free of noise, so frozen periods are alike but for rounding of 2000 samples of 1e-2 rad
    assert np.max(np.linalg.norm(np.diff(y, axis=0), axis=1)) < 1e-12


def test_a_wide_chop_is_slower_and_held_within_the_same_torque(path):
    bench = SimBench(bench_model(), 0)
    peaks = {}
    for name, start in (("short", 0.0), ("wide", -8.5e-3)):
        plan = make_plan(
            "settling", {"strategy": "designed-modes", "controller": path, "from_rad": start, "alpha_deg": 90.0}
        )
        chop = [s for s in checked_segments(plan, bench) if s.settings["phase"] == "chop"][0]
        level = chop.feedforward[DWELL - 1, 1]
        peaks[name] = np.max(np.abs(chop.feedforward[:, 1] - 0.5 * (level + chop.feedforward[-1, 1])))
        n = 60 if name == "short" else 85  # 60 times the root of 2, rounded up
        way = concentrated_move(n, 3.0)
        np.testing.assert_allclose(chop.reference[: n + 1, 1], start + (8.5e-3 - start) * way, atol=1e-15)
    assert peaks["wide"] <= peaks["short"]  # the springs help a move that begins on the other side


def test_the_strategy_needs_a_controller_for_the_axes_that_move(path):
    bench = SimBench(bench_model(), 0)
    with pytest.raises(ConfigError, match="needs a controller file.*--controller"):
        list(checked_segments(make_plan("settling", {"strategy": "designed"}), bench))
    with pytest.raises(ConfigError, match="no axis 'theta_x'"):
        list(checked_segments(make_plan("chop", {"strategy": "designed", "controller": path}), bench))


def test_a_controller_for_another_rate_is_refused(tmp_path):
    made = controller()
    model = msgspec.structs.replace(made.model, sample_rate_hz=9000.0)
    slow = msgspec.structs.replace(made, sample_rate_hz=9000.0, model=model)
    file = tmp_path / "slow.toml"
    file.write_text(dump_controller(slow), encoding="utf-8")
    with pytest.raises(ConfigError, match="9000 Hz, the bench runs at 10000 Hz"):
        Design.controlled(str(file), 10_000.0)


def test_a_dwell_shorter_than_the_move_is_refused(path):
    bench = SimBench(bench_model(), 0)
    settings = {"strategy": "designed", "controller": path, "alpha_deg": 90.0, "frequency_hz": 100.0, "window_s": 0.002}
    with pytest.raises(ConfigError, match="outlasts the dwell of 50"):
        list(checked_segments(make_plan("settling", settings), bench))


def test_an_unstable_controller_is_refused(tmp_path):
    wild = controller()
    axis = msgspec.structs.replace(wild.axes[0], feedback=Blocks.of(theta_controller(50.0)))
    file = tmp_path / "wild.toml"
    file.write_text(dump_controller(msgspec.structs.replace(wild, axes=[axis])), encoding="utf-8")
    plan = make_plan("settling", {"strategy": "designed", "controller": str(file), "alpha_deg": 90.0})
    with pytest.raises(ConfigError, match="unstable"):
        list(checked_segments(plan, SimBench(bench_model(), 0)))


def test_the_controllers_text_decides_the_configuration(path):
    plan = make_plan("settling", {"strategy": "designed", "controller": path})
    assert plan.configuration()["controller"] == dump_controller(controller())
    assert "controller" not in make_plan("settling", {}).configuration()


def test_the_campaign_plays_every_form_of_table_6_7_and_every_piece_of_knowledge(path):
    campaign = designed_campaign(Path(path))
    plans: dict[str, Any] = campaign.plans()
    forms = {(p.alpha_deg, p.from_rad, p.to_rad) for p in plans.values() if p.name == "chop"}
    assert len(forms) == 9 and {alpha for alpha, _, _ in forms} == {0.0, 120.0, 240.0}
    assert sum(p.name == "settling" for p in plans.values()) == 8
    assert sum(p.name == "thermal" for p in plans.values()) == 1
    assert all(p.controller == path for p in plans.values())


def test_a_chop_has_the_disturbance_of_the_papers_own(path):
    paper = load_campaign("paper").levels()
    levels = designed_campaign(Path(path), paper).levels()
    chops = {name: level for name, level in levels.items() if name.startswith("designed-chop-")}
    assert chops == {f"designed-{name}": paper[name] for name in INSIDE_PERCENT} and len(chops) == 9
    assert set(designed_campaign(Path(path)).levels().values()) == {1.0}


def test_a_controller_that_would_learn_without_end_is_refused_before_anything_moves(tmp_path):
    good = controller()
    loud = msgspec.structs.replace(
        good.axes[0], learning=Blocks.of(good.axes[0].learning.filter(RATE_HZ).scaled(5.0)), gains=[1.0]
    )
    file = tmp_path / "loud.toml"
    file.write_text(dump_controller(msgspec.structs.replace(good, axes=[loud])), encoding="utf-8")
    plan = make_plan("settling", {"strategy": "designed", "controller": str(file), "alpha_deg": 90.0})
    # five times the inverse leaves four times the error
    with pytest.raises(ConfigError, match=r"a period would leave [34]\.\d+ of an error.*learning would diverge"):
        list(checked_segments(plan, SimBench(bench_model(), 0)))


def test_steps_are_one_cycle_while_they_are_learned_and_two_afterwards(path):
    plan = make_plan("settling", {"strategy": "designed", "controller": path, "alpha_deg": 90.0, "cycles": 6})
    cycles = [(s.label, s.n_samples // PERIOD) for s in checked_segments(plan, SimBench(bench_model(), 0))]
    chop = [("chop 1", 1), ("chop 2", 2), ("chop 3", 2), ("chop 4", 1)]
    waited = [("settling in 1", 1), ("settling in 2", 1)]
    assert cycles[1:] == [*waited, *((f"learning {k}", 1) for k in (1, 2, 3, 4)), *chop]
