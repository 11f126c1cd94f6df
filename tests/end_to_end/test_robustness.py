"""The count of benches that meet every requirement: what is drawn, what counts as missed, and its interval."""

import json
from typing import Any

import numpy as np
import pytest
from scipy.stats import binomtest

from benchmarks.robustness import exit_code, main, percent, resumed, summary, wilson
from benchmarks.robustness_benches import Spread, drawn_bench, far_bench
from benchmarks.robustness_own_logs import OWN, identified_and_played
from benchmarks.robustness_trial import LIMITS, StoppedError, is_kept_safe, is_safe, misses, played, reason, verdict
from sim_backend.bench import Record, Segment
from sim_backend.errors import ConfigError, HardwareError
from sim_backend.model import Model, load_model, number
from sim_backend.simbench import SimBench
from tests.shifted_bench import shifted_bench

BENCH = load_model("as-built")


@pytest.mark.parametrize(("met", "n"), [(0, 40), (39, 40), (1000, 1000)])
def test_the_interval_is_scipys(met, n):
    reference = binomtest(met, n).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(wilson(met, n), (reference.low, reference.high), atol=1e-6)


def test_benches_are_drawn_as_the_spread_says():
    drawn = [drawn_bench(BENCH, Spread(), np.random.default_rng(i)) for i in range(300)]
    kelvin = np.array([d["cold_finger_k"] for _, d in drawn])
    assert 63.5 <= kelvin.min() < 64.5 and 76.0 < kelvin.max() <= 77.0
    of = {m.label: i for i, m in enumerate(BENCH.modes)}
    for label, std in (("theta_x cryostat 490 Hz", 0.001), ("theta_y suspension", np.hypot(0.001, 0.005))):
        values = np.array([number(bench.modes[of[label]].frequency_hz) for bench, _ in drawn])
        relative = values / number(BENCH.modes[of[label]].frequency_hz) - 1.0
        if "cryostat" in label:  # stiffer where it is colder: 1e-4 of the modulus per kelvin
            relative = (1.0 + relative) / (1.0 - 0.5e-4 * (kelvin - 77.0)) - 1.0
        # 300 draws know a standard deviation to 4 %
        assert relative.std() == pytest.approx(std, rel=0.16) and abs(relative.mean()) < 4.0 * std / np.sqrt(300.0)
    noise = [e.parameters["std"] for bench, _ in drawn for e in bench.effects if e.effect == "amplifier-noise"]
    ratio = np.array([number(v) for v in noise]) / 0.000175
    assert ratio.std() == pytest.approx(0.05, rel=0.16)
    assert len(drawn[0][0].effects) == len(BENCH.effects)


def test_a_wider_spread_leaves_the_material_alone():
    wide = Spread().times(3.0)
    assert (wide.frequency, wide.noise, wide.modulus_per_k) == pytest.approx((0.003, 0.15, -1e-4))


def test_what_is_above_its_limit_or_no_number_is_missed():
    good: dict[str, float | None] = dict.fromkeys(LIMITS, 0.0)
    assert misses(good) == []
    assert misses({**good, "stability": 1.71e-6, "settling theta_x": None}) == ["settling theta_x", "stability"]
    assert misses({"error": "diverged"}) == list(LIMITS)  # of a trial that failed


def test_a_controller_that_is_not_there_stops_it_before_the_first_trial(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        main(["--controller", str(tmp_path / "none.toml"), "--out", str(tmp_path / "out.json")])
    assert not (tmp_path / "out.jsonl").exists()


@pytest.mark.parametrize("frequency", [0.01, 0.03])
def test_far_benches_fill_their_range_and_do_not_leave_it(frequency):
    drawn = [far_bench(BENCH, np.random.default_rng(i), frequency) for i in range(300)]

    def ratios(of: str) -> np.ndarray:
        was = np.array([number(getattr(mode, of)) for mode in BENCH.modes])
        return np.array([[number(getattr(mode, of)) for mode in bench.modes] for bench, _ in drawn]) / was - 1.0

    for found, most in ((ratios("frequency_hz"), frequency), (ratios("decay_rate_1_s"), 0.2)):
        assert np.abs(found).max() <= most
        # of 300 uniform draws one lies within 5 % of either end but for once in 10^7, for each of the modes
        assert np.all(found.max(axis=0) > 0.9 * most) and np.all(found.min(axis=0) < -0.9 * most)
    for name, low, high in (("noise", 0.5, 2.0), ("iron", 0.5, 2.0), ("amplifier_hz", 1e3, 5e3)):
        values = np.array([told[name] for _, told in drawn])
        assert low <= values.min() and values.max() <= high
        # log-uniform: half of the benches lie below the geometric mean, 300 draws know that to 3 %
        assert np.mean(values < np.sqrt(low * high)) == pytest.approx(0.5, abs=0.12)
    kelvin = [told["cold_finger_k"] for _, told in drawn]
    assert 63.0 <= min(kelvin) and max(kelvin) <= 77.0


def test_a_far_bench_is_as_late_and_as_noisy_as_it_says():
    bench, told = far_bench(BENCH, np.random.default_rng(5))
    added = bench.effects[len(BENCH.effects) :]
    assert [(e.effect, e.where) for e in added] == [
        (effect, dof) for dof in ("theta_x", "theta_y") for effect in ("delay", "amplifier-lag")
    ]
    assert number(added[0].parameters["seconds"]) == pytest.approx(1e-4 * told["delay_samples"])
    assert number(added[1].parameters["time_constant_s"]) == pytest.approx(0.5 / np.pi / told["amplifier_hz"])
    for before, after in zip(BENCH.effects, bench.effects, strict=False):
        for effect, name, factor in (
            ("amplifier-noise", "std", "noise"),
            ("sensor-noise", "std", "noise"),
            ("jiles-atherton", "size", "iron"),
        ):
            if before.effect == effect:
                ratio = number(after.parameters[name]) / number(before.parameters[name])
                assert ratio == pytest.approx(told[factor])


PERIOD, DWELL = 2000, 1000


def chopped(off_rad: list[float], torque_nm: float = 0.0, at: int = 500) -> Record:
    """Cycles of a chop of θx whose angle is off by this much at one sample of each, under a constant torque."""
    reference = np.zeros((PERIOD, 3))
    reference[:DWELL, 0] = 8.5e-3
    n = PERIOD * len(off_rad)
    made = Segment("chop", n, reference, np.zeros((PERIOD, 3)), settings={"dwell_samples": DWELL, "position_2_at": 0})
    angle = np.tile(reference[:, 0], len(off_rad))
    angle[at::PERIOD] += off_rad
    channels = {name: np.zeros(n) for name in ("command_theta_y", "command_z", "theta_y")}
    return Record(made, {**channels, "theta_x": angle, "command_theta_x": np.full(n, torque_nm)})


def test_a_run_is_safe_unless_an_axis_strays_for_more_than_three_cycles_in_a_row():
    limits, off, kept = SimBench(BENCH, 0).limits, 51e-6, 49e-6

    def safe(*errors: float, at: int = 500) -> bool:
        return is_safe([chopped(list(errors), at=at)], limits, 1e4)

    assert safe(*[kept] * 9) and safe(off, off, off, kept, off, off, off)
    assert not safe(kept, off, off, off, off)
    assert not safe(*[-off] * 4) and not safe(*[float("nan")] * 4)
    assert safe(*[1e-3] * 9, at=49) and not safe(*[1e-3] * 9, at=50)  # 5 ms, or 50 samples, after the step
    # cycles of one segment go on in the next
    assert not is_safe([chopped([off, off]), chopped([off, off])], limits, 1e4)


def test_a_run_is_safe_unless_the_coils_dissipate_more_than_a_watt_for_as_long():
    limits = SimBench(BENCH, 0).limits
    watt_nm = float(1.0 / (5.7 / 7.9 * np.linalg.norm(limits.to_current[:, 0])))
    assert is_safe([chopped([0.0] * 5, 0.99 * watt_nm)], limits, 1e4)
    assert not is_safe([chopped([0.0] * 5, 1.01 * watt_nm)], limits, 1e4)
    assert is_safe([chopped([0.0] * 3, 1.01 * watt_nm)], limits, 1e4)


@pytest.mark.parametrize(("late", "safe"), [(15.0, True), (5.0, False)])
def test_a_chop_that_its_watch_stops_says_why_and_whether_in_time(late, safe):
    """15 samples late the first cycle is the last; 5 late, θx rings more with each cycle, above 50 µrad at once."""
    bench = shifted_bench(delay_samples=late)
    with pytest.raises(StoppedError, match="cycle .* the limit is") as stopped:
        played(bench, 0, "settling", alpha_deg=0.0, cycles=200, strategy="hybrid")
    assert stopped.value.safe is safe


def test_a_chop_that_is_refused_before_it_begins_was_safe():
    with pytest.raises(StoppedError, match="refused: .*limit is 1 W") as stopped:
        played(BENCH, 0, "settling", from_rad=-8.5e-3, frequency_hz=20.0, window_s=0.01, strategy="hybrid")
    assert stopped.value.safe


def told(error: Exception) -> dict[str, Any]:
    def judge(_bench: Model, _seed: int) -> dict[str, float]:
        raise error

    return verdict(judge, BENCH, 0)


def test_a_verdict_knows_a_stop_from_a_failure_of_the_bench():
    assert told(StoppedError("late", safe=True)) == {"error": "late", "safe": True}
    assert told(StoppedError("too late", safe=False)) == {"error": "too late", "safe": False}
    assert told(HardwareError("gone")) == {"error": "gone", "safe": False}
    assert verdict(lambda _bench, _seed: {"stability": np.nan, "z": 1.0}, BENCH, 0) == {"stability": None, "z": 1.0}


GOOD: dict[str, Any] = {**dict.fromkeys(LIMITS, 0.0), "safe chop": 1.0, "safe theta_x": 1.0}


def test_a_result_is_safe_if_each_of_its_chops_was():
    assert is_kept_safe(GOOD) and not is_kept_safe({**GOOD, "safe theta_x": 0.0})
    assert not is_kept_safe({"stability": 0.0})


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (GOOD, ""),
        ({**GOOD, "safe chop": 0.0}, "not safe"),
        ({**GOOD, "accuracy": 1.0, "safe chop": 0.0}, "missed: accuracy; not safe"),
        ({"error": "diverged", "safe": False}, "diverged; not safe"),
        ({**GOOD, "stability": 2e-6, "accuracy": None}, "missed: stability, accuracy"),
        (
            {"safe": True, "error": "cycle 7 (learning 3): learning of theta_x does not converge: after 19 µrad the …"},
            "learning of theta_x does not converge",
        ),
        (
            {
                "safe": True,
                "error": "cycle 12 (chop): after its step theta_y is off by 61.2 µrad, the limit is 50 µrad",
            },
            "after its step theta_y is off by # µrad",
        ),
        (
            {
                "safe": True,
                "error": "design refused: axis 'theta_x': learning below 820 Hz: a period may leave 0.91 of it, …",
            },
            "design refused: axis 'theta_x': learning below # Hz: a period may leave # of it, …",
        ),
    ],
)
def test_reasons_are_told_without_their_numbers(found, expected):
    assert reason(found) == expected


def test_a_summary_counts_why_benches_failed_and_the_exit_code_asks_for_safety():
    stopped = [
        {"error": f"cycle {n} (chop): the coils dissipate 1.{n} W, the limit is 1 W", "safe": True} for n in (1, 2)
    ]
    found = summary([{"ours": one} for one in (GOOD, *stopped)], ["ours"])["ours"]
    assert found["reasons"] == {"the coils dissipate # W": 2}
    assert (found["met"], found["safe"], found["of"]) == (1, 3, 3)
    assert exit_code(found, 0.3) == 0 and exit_code(found, 0.99) == 1 and exit_code(found, None) == 0
    assert exit_code({**found, "safe": 2}, 0.3) == 1 and exit_code({**found, "safe": 2}, None) == 1


def test_trials_go_on_where_they_were_and_not_with_other_settings(tmp_path, capsys):
    lines, asked = tmp_path / "x.jsonl", list[int]()

    def play(index: int) -> dict[str, Any]:
        asked.append(index)
        return {"index": index}

    assert resumed(lines, 2, {"seed": 1}, play) == [{"index": 0}, {"index": 1}]
    assert resumed(lines, 3, {"seed": 1}, play) == [{"index": i} for i in range(3)] and asked == [0, 1, 2]
    assert len(lines.read_text().splitlines()) == 4
    with pytest.raises(SystemExit, match="move it away"):
        resumed(lines, 4, {"seed": 2}, play)
    assert asked == [0, 1, 2]


@pytest.mark.parametrize(
    "given",
    [
        [],
        ["--controller", "c.toml", "--own-logs"],
        ["--own-logs", "--far", "--scale", "2"],
        ["--own-logs", "--frequency", "3%"],
        ["--own-logs", "--far", "--frequency", "60%"],
    ],
)
def test_options_that_would_be_ignored_are_refused(given, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*given, "--out", str(tmp_path / "out.json")])
    assert ended.value.code == 2 and not list(tmp_path.iterdir())


def test_a_part_is_read_as_percent_or_as_a_number():
    assert percent("3%") == percent("0.03") == pytest.approx(0.03)


def test_a_bench_whose_own_logs_refuse_a_design_says_at_which_step(monkeypatch):
    def refused(*_of: object) -> None:
        raise ConfigError("axis 'theta_x': the swept response contradicts the model")

    monkeypatch.setattr("benchmarks.robustness_own_logs._measured", lambda *_of: [])
    monkeypatch.setattr("benchmarks.robustness_own_logs._designed", refused)
    found = identified_and_played(BENCH, {"noise": 1.5}, 3)
    assert found[OWN]["error"].startswith("design refused: axis 'theta_x'") and found[OWN]["safe"]
    assert found["noise"] == 1.5 and set(found["took_s"]) == {"measure", "design"}
    assert json.loads(json.dumps(found)) == found
