"""The count of benches that meet every requirement: what is drawn, what counts as missed, and its interval."""

import numpy as np
import pytest
from scipy.stats import binomtest

from benchmarks.robustness import LIMITS, Spread, drawn_bench, main, misses, wilson
from sim_backend.errors import ConfigError
from sim_backend.model import load_model, number

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
    assert misses({"error": "diverged"}) == list(LIMITS)  # type: ignore[dict-item]  # of a trial that failed


def test_a_controller_that_is_not_there_stops_it_before_the_first_trial(tmp_path):
    with pytest.raises(ConfigError, match="no such file"):
        main(["--controller", str(tmp_path / "none.toml"), "--out", str(tmp_path / "out.json")])
    assert not (tmp_path / "out.jsonl").exists()
