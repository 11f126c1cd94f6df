"""What the coils stand: predicted before anything moves, judged while a plan is played; against sums done by hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from campaigns.plans import PLANS, make_plan
from campaigns.plans.base import Plan, checked_segments, estimate, on_axis, open_loop
from campaigns.playing.runner import run_plan
from campaigns.strategies.overload import Interlock, overload
from sim_backend.bench import Bench, Coil, Record, Segment
from sim_backend.errors import CheckError, ConfigError
from sim_backend.model import Model, load_model, number
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model

RATE_HZ = 10_000.0
COIL = Coil(force_constant_n_a=5.7, steepness_n_sqrt_w=7.9, continuous_force_n=9.0)
# so weak that a coil gives 9 N before all of them dissipate 1 W
STEEP = Coil(force_constant_n_a=5.7, steepness_n_sqrt_w=30.0, continuous_force_n=9.0)
BENCH = SimBench(bench_model(), 0)
WATT_NM = float(1.0 / (5.7 / 7.9 * np.linalg.norm(BENCH.limits.to_current[:, 0])))
"""Torque about θx at which the coils dissipate 1 W: P = Σ (k i / S)², i = column times torque."""


FAST = {"frequency_hz": 20.0, "window_s": 0.01}


class Bursts(Plan, frozen=True, kw_only=True):
    """A torque about θx for `on_s` of every `period_s`, in segments of one period."""

    name = "bursts"
    title = "bursts of torque"

    torque_nm: float
    on_s: float
    period_s: float
    repeats: int

    def segments(self, bench: Bench) -> Iterator[Segment]:
        wave = np.zeros(round(self.period_s * RATE_HZ))
        wave[: round(self.on_s * RATE_HZ)] = self.torque_nm
        for i in range(self.repeats):
            yield open_loop(f"burst {i + 1}", on_axis(bench, "theta_x", wave), wave.size, self.channels(bench), {})


def test_dissipation_is_named_first_and_then_the_actuator():
    assert overload(np.array([0.8, 0.8, 0.8]), COIL) == ""  # 3 (0.8 × 5.7 / 7.9)² = 0.9995 W
    assert "1.14 W, the limit is 1 W" in overload(np.array([0.8, 0.8, 0.9495]), COIL)
    assert overload(np.array([0.0, 1.57, 0.0]), STEEP) == ""
    assert "actuator 2 gives 9.12 N (rms), the limit is 9 N" in overload(np.array([0.0, 1.6, 0.0]), STEEP)
    assert overload(np.array([np.nan, 0.0, 0.0]), COIL)


def test_peaks_are_allowed_as_long_as_their_mean_is():
    # a fortieth of the time: 6.2² / 40 = 0.96 W, 6.4² / 40 = 1.02 W
    estimate(Bursts(torque_nm=6.2 * WATT_NM, on_s=0.005, period_s=0.2, repeats=30), BENCH)
    with pytest.raises(ConfigError, match=r"plan bursts: segment 'burst 10': .* 1.02 W, the limit is 1 W .*smaller"):
        estimate(Bursts(torque_nm=6.4 * WATT_NM, on_s=0.005, period_s=0.2, repeats=30), BENCH)


def test_where_segments_are_cut_does_not_matter():
    wave = np.zeros((7, 3))
    wave[:, 0] = np.sqrt(7.0 / 3.0) * WATT_NM * np.array([1, -1, 0, 0, 1, 0, 0])  # 1 W in the mean

    def stops_at(size: float, n_samples: int) -> int | None:
        watch = Interlock(BENCH, COIL)
        for i in range(100_000 // n_samples):
            segment = Segment("cut", n_samples, np.zeros_like(wave), size * wave)
            if watch.failure(segment, Record(segment, {})):
                return i + 1
        return None

    # the window is full at 20,000 samples, in the 60th segment of 337; a segment need not be whole periods
    assert (stops_at(0.99, 337), stops_at(0.99, 45_003)) == (None, None)
    assert (stops_at(1.01, 337), stops_at(1.01, 45_003)) == (60, 1)


def test_segments_one_after_the_other_add_up_and_a_pause_helps():
    estimate(Bursts(torque_nm=1.2 * WATT_NM, on_s=1.0, period_s=1.0, repeats=1), BENCH)
    with pytest.raises(ConfigError, match="'burst 2'"):
        estimate(Bursts(torque_nm=1.2 * WATT_NM, on_s=1.0, period_s=1.0, repeats=2), BENCH)
    estimate(Bursts(torque_nm=1.2 * WATT_NM, on_s=1.0, period_s=2.0, repeats=5), BENCH)


@pytest.mark.parametrize(
    ("plan", "settings"),
    [
        ("sinesweep", {"amplitude": 0.004}),
        ("hysteresis", {"torques_nm": (0.05, 0.4)}),
        ("freerun", {"torque_nm": 0.7}),
        ("multisine", {"torque_rms_nm": 0.3}),
        ("settling", {"from_rad": -8.5e-3, **FAST}),
        ("thermal", {"from_rad": -8.5e-3, **FAST}),
        ("chop", {"from_rad": -8.5e-3, **FAST}),
        ("endstops", {"hold_s": 10.0}),
    ],
)
def test_a_feedforward_that_overheats_is_refused_before_anything_moves(plan, settings, tmp_path):
    bench = SimBench(load_model("as-built"), 0)
    estimate(make_plan(plan, {}), bench)
    with pytest.raises(ConfigError, match=rf"plan {plan}: segment .*the limit is 1 W.*smaller or slower"):
        run_plan(make_plan(plan, settings), bench, tmp_path / "run.h5", seed=0)
    assert not (tmp_path / "run.h5").exists()


@pytest.mark.parametrize("plan", sorted(PLANS))
def test_every_plan_is_watched_where_the_bench_states_its_coils(plan):
    assert make_plan(plan, {}).watch(SimBench(load_model("as-built"), 0)) is not None


def test_a_bench_that_does_not_state_its_coils_is_not_judged():
    bench = SimBench(load_model("design-4th-order"), 0)
    assert bench.limits.coil is None and make_plan("sinesweep", {}).watch(bench) is None
    assert list(checked_segments(make_plan("sinesweep", {"amplitude": 1.0}), bench))


def closed(seconds: float) -> Segment:
    n, feedback = round(seconds * RATE_HZ), make_plan("theodolite", {}).segments(BENCH)
    loops = next(feedback).feedback
    return Segment("held", n, np.zeros((1, 3)), np.zeros((1, 3)), feedback=loops, record=("theta_x",))


def test_what_a_feedback_adds_is_judged_from_what_was_measured():
    watch, segment = Interlock(BENCH, COIL), closed(2.0)
    asked = watch.asked(segment)
    measured = {name: np.full(segment.n_samples, 0.81) for name in asked.record if name.startswith("current_")}
    assert len(measured) == 3
    why = watch.failure(segment, Record(segment, measured))
    assert "segment 'held': the coils dissipate 1.02 W, the limit is 1 W" in why
    # readings that are missing are taken as they were commanded: here nothing
    half = {name: np.where(np.arange(segment.n_samples) % 2, np.nan, 0.81) for name in measured}
    assert Interlock(BENCH, COIL).failure(segment, Record(segment, half)) == ""


def test_nothing_more_is_recorded_where_the_feedforward_says_it_all():
    segment = next(make_plan("sinesweep", {}).segments(BENCH))
    watch = Interlock(BENCH, COIL)
    assert watch.asked(segment) is segment and watch.failure(segment, Record(segment, {})) == ""


def test_coils_may_be_overloaded_for_as_long_as_a_plan_says():
    wave = np.full((round(4.0 * RATE_HZ), 3), 0.0)
    wave[:, 0] = 2.1 * WATT_NM
    segment = Segment("pressed", len(wave), np.zeros_like(wave), wave)
    # 4.41 W: their mean over 2 s is above 1 W from the block on that ends at 0.5 s, for 36 blocks
    assert Interlock(BENCH, COIL, 3.6).failure(segment, Record(segment, {})) == ""
    assert "for at most 3.5 s" in Interlock(BENCH, COIL, 3.5).failure(segment, Record(segment, {}))


def stiff(times: float) -> Model:
    """The bench as built, its tilt `times` as stiff: the feedback must push so much harder for the same angle."""
    model = load_model("as-built")
    modes = [
        msgspec.structs.replace(m, frequency_hz=number(m.frequency_hz) * times**0.5) if "suspension" in m.label else m
        for m in model.modes
    ]
    return msgspec.structs.replace(model, modes=modes)


def test_a_feedback_that_pushes_too_hard_is_stopped_and_said_why(tmp_path: Path):
    settings = {"x_rad": (8e-3,), "y_rad": (0.0,), "settle_s": 4.0}
    with pytest.raises(
        CheckError, match=r"'move 1': the coils dissipate .*the limit is 1 W.* made safe at once.*weaker"
    ):
        run_plan(make_plan("theodolite", settings), SimBench(stiff(8.0), 0), tmp_path / "run.h5", seed=0)
