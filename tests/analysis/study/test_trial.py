"""One trial: what is drawn for it, that it is the test that the command plays, and that no failure is lost."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from analysis.recorded.settle import settle_of
from analysis.study.definition import parse_study
from analysis.study.kinds import KINDS
from analysis.study.kinds.settling import SettlingTrial
from analysis.study.trial import Job, run_trial, run_trials
from campaigns.benches import open_bench
from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.kernel.structure import LANES
from sim_backend.model import number
from sim_backend.simbench import SimBench
from tests.analysis.study.studies import spread
from tests.lanes import lanes_asked

HEAD = (
    'schema = "mccd-study/1"\nname = "s"\nkind = "settling"\ntrials = 1000\nseed = 5\n'
    "[settings]\ncycles = 2\nalpha_deg = 90.0\n"
)
FREQUENCY = "model.modes[theta_y suspension].frequency_hz"
OWN_HZ = 29.4775


def job(*varies: str) -> Job:
    return Job.of(parse_study(HEAD + "".join(f"[[vary]]\n{text}\n" for text in varies), "study"))


def drawn(one: Job, n: int = 1000) -> np.ndarray:
    return np.array([one.varied(t) for t in range(n)], dtype=float)


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("normal = { std = 0.01 }\nrelative = true", stats.norm(OWN_HZ, 0.01 * OWN_HZ)),
        ("normal = { std = 0.5 }", stats.norm(OWN_HZ, 0.5)),
        ("normal = { mean = 20.0, std = 0.5 }", stats.norm(20.0, 0.5)),
        ("normal = { mean = 0.1, std = 0.02 }\nrelative = true", stats.norm(1.1 * OWN_HZ, 0.02 * OWN_HZ)),
        ("uniform = { low = 20.0, high = 30.0 }", stats.uniform(20.0, 10.0)),
        ("uniform = { low = -0.1, high = 0.1 }\nrelative = true", stats.uniform(0.9 * OWN_HZ, 0.2 * OWN_HZ)),
    ],
)
def test_draws_follow_their_law(text: str, law: stats.rv_continuous) -> None:
    values = drawn(job(f'place = "{FREQUENCY}"\n{text}'))[:, 0]
    # the seed is fixed, so this passes or fails for good; a right law fails for one seed in a thousand
    assert stats.kstest(values, law.cdf).pvalue > 1e-3


def test_each_number_of_a_place_is_drawn_on_its_own_unless_together() -> None:
    place = 'place = "model.effects[sensor-noise@*].parameters.std"\nnormal = { std = 0.1 }\nrelative = true'
    apart, together = drawn(job(place)), drawn(job(f"{place}\ntogether = true"))
    assert apart.shape == together.shape == (1000, 3)
    # correlations of independent draws scatter by 1/√1000
    assert np.all(np.abs(np.corrcoef(apart.T)[np.triu_indices(3, 1)]) < 4.0 / np.sqrt(1000))
    assert np.all(together == together[:, :1])


def test_another_place_changes_no_draw() -> None:
    first = f'place = "{FREQUENCY}"\nnormal = {{ std = 0.01 }}'
    other = 'place = "model.modes[z suspension].frequency_hz"\nnormal = { std = 0.01 }'
    assert np.array_equal(drawn(job(first))[:, 0], drawn(job(other, first))[:, 1])
    both = drawn(job(first, other)) - [OWN_HZ, 20.068674719]
    assert abs(np.corrcoef(both.T)[0, 1]) < 4.0 / np.sqrt(1000)


def test_every_point_of_the_grid_has_the_same_bench_and_the_same_noise() -> None:
    one = Job.of(spread())
    for draw in range(3):
        first, second = (one.setup(t, one.varied(t)) for t in (2 * draw, 2 * draw + 1))
        assert first.bench == second.bench and first.seed == second.seed
        assert (first.settings["strategy"], second.settings["strategy"]) == ("hybrid", "mbff")
        assert first.bench is second.bench  # made and checked once for both
    assert len({one.setup(t, one.varied(t)).seed for t in range(0, 10, 2)}) == 5


def test_benches_that_differ_in_the_last_bit_are_told_apart() -> None:
    one = job('place = "model.modes[theta_x suspension].output_rate.theta_x"\nsweep = [0.0, -0.0, 5e-324, 0.0]')
    values = [one.setup(t, one.varied(t)).bench.modes[0].output_rate["theta_x"] for t in range(4)]
    assert [number(v).hex() for v in values] == ["0x0.0p+0", "-0x0.0p+0", (5e-324).hex(), "0x0.0p+0"]


def test_a_sweep_over_the_model_and_over_parts_of_a_number() -> None:
    one = job(
        'place = "model"\nsweep = ["as-built", "printed"]',
        'place = "model.modes[z suspension].frequency_hz"\nrelative = true\nsweep = [-0.1, 0.0]',
    )
    setups = [one.setup(t, one.varied(t)) for t in range(4)]
    assert [s.bench.name for s in setups] == ["as-built", "as-built", "printed", "printed"]
    z = [number(next(m for m in s.bench.modes if m.label == "z suspension").frequency_hz) for s in setups]
    assert z == pytest.approx([0.9 * 20.068674719, 20.068674719] * 2, rel=1e-15)


def test_a_trial_is_the_test_that_the_command_plays(tmp_path: Path) -> None:
    one = job()
    setup = one.setup(7, one.varied(7))
    plan = make_plan("settling", {"cycles": 2, "alpha_deg": 90.0})
    with contextlib.closing(open_bench("sim", setup.seed)) as bench:
        run_plan(plan, bench, tmp_path / "run.h5", seed=setup.seed)
    with read_run(tmp_path / "run.h5") as run:
        test = settle_of(run)
    assert test.power is not None
    found = dict(zip([c.name for c in one.columns], run_trial(one, 7).results, strict=True))
    assert found == {
        "settling_s": test.settling_s,
        "stability_3sigma_rad": test.stability.stability_rad,
        "power_w": test.power.total_w,
        "peak_current_a": test.power.peak_a,
        "parasitic_z_m": test.parasitic_z_m,
    }


def test_an_unstable_bench_is_a_result_with_its_reason() -> None:
    # springs of a negative rate cannot be written; a torque with the wrong sign and a closed loop is unstable
    one = job('place = "model.modes[theta_y suspension].input.torque_y"\nsweep = [-3091.7]')
    outcome = run_trial(one, 0)
    assert outcome.status == "failed" and "unstable" in outcome.reason
    assert outcome.varied == (-3091.7,) and set(outcome.results) == {None}


def test_a_draw_that_makes_no_model_is_a_result_too() -> None:
    outcome = run_trial(job(f'place = "{FREQUENCY}"\nnormal = {{ mean = -5.0, std = 0.0 }}'), 0)
    assert outcome.status == "failed" and "must be zero" in outcome.reason


def test_an_error_that_nobody_foresaw_is_kept_and_told_from_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    right = run_trials(job(), range(4))
    kind = KINDS["settling"]
    assert isinstance(kind, SettlingTrial)
    play, measured = SimBench.begin, kind.measured
    numbers = iter(range(4))

    def breaks(*of: Any) -> Any:
        if next(numbers) == 1:
            raise ZeroDivisionError("nobody thought of it")
        return measured(*of)

    def breaks_while_played(bench: SimBench, *of: Any) -> Any:
        if bench.identity.serial == f"seed-{job().setup(2, ()).seed}":
            raise ZeroDivisionError("nobody thought of it")
        return play(bench, *of)

    for owner, name, function, broken in (
        (kind, "measured", breaks, 1),
        (SimBench, "begin", breaks_while_played, 2),
    ):
        with monkeypatch.context() as patched:
            patched.setattr(owner, name, function)
            found = run_trials(job(), range(4))
        for i, (outcome, whole) in enumerate(zip(found, right, strict=True)):
            if i == broken:
                assert (outcome.status, outcome.reason) == ("broken", "ZeroDivisionError: nobody thought of it")
            else:
                assert (outcome.status, outcome.results) == ("done", whole.results)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), MemoryError()])
def test_what_lies_outside_a_trial_is_no_result_of_it(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(*_of: object) -> None:
        raise error

    for owner, name in ((KINDS["settling"], "measured"), (SimBench, "begin"), (Job, "setup")):
        with monkeypatch.context() as patched, pytest.raises(type(error)):
            patched.setattr(owner, name, breaks)
            run_trials(job(), (0, 1))


@pytest.mark.parametrize("lanes", [False, True])
def test_trials_side_by_side_are_what_each_is_alone(lanes: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = lanes_asked(monkeypatch, there=lanes)
    # every second one is unstable, and two strategies play other segments
    one = job(
        f'place = "{FREQUENCY}"\nnormal = {{ std = 0.01 }}\nrelative = true',
        'place = "model.modes[theta_y suspension].input.torque_y"\nsweep = [3091.7, -3091.7]',
        'place = "settings.strategy"\nsweep = ["mbff", "hybrid"]',
    )
    trials = [*range(16), *range(100, 116, 4)]
    together = run_trials(one, trials)
    assert (LANES in asked) is lanes
    asked.clear()
    for trial, found in zip(trials, together, strict=True):
        alone = run_trial(one, trial)
        assert (found.trial, found.status, found.reason, found.varied, found.results) == (
            (trial, alone.status, alone.reason, alone.varied, alone.results)
        )
    assert {found.status for found in together} == {"done", "failed"} and set(asked) == {1}


def test_the_seed_of_a_trial_fits_into_a_log() -> None:
    for seed in (0, 2**63 - 1):
        one = Job.of(parse_study(HEAD.replace("seed = 5", f"seed = {seed}"), "study"))
        assert all(0 <= one.setup(t, ()).seed < 2**63 for t in range(50))
