"""The paper's feedback is tuned for one mirror: another real bench is not chopped with it without its own model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from campaigns.plans import make_plan
from sim_backend.bench import Identity
from sim_backend.errors import ConfigError
from sim_backend.model import dump_model, load_model
from sim_backend.simbench import SimBench


class Attached(SimBench):
    """A bench at the end of a line, as its identity tells."""

    called = "shaker 3"

    @property
    def identity(self) -> Identity:
        return replace(super().identity, kind="serial", name=self.called)


def bench(called: str, kind: type[SimBench] = Attached) -> SimBench:
    made = kind(load_model("as-built"), 0)
    if isinstance(made, Attached):
        made.called = called
    return made


@pytest.mark.parametrize("plan", ["chop", "settling"])
@pytest.mark.parametrize("strategy", ["hybrid", "mbff"])
def test_another_real_bench_is_refused_before_it_moves(plan: str, strategy: str) -> None:
    with pytest.raises(ConfigError, match=r"mirror of the bundled model 'design-4th-order'.*'shaker 3'.*--model"):
        next(make_plan(plan, {"strategy": strategy}).segments(bench("shaker 3")))


def test_the_mirror_a_simulated_bench_and_one_with_its_own_model_are_chopped(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(dump_model(load_model("design-4th-order")), encoding="utf-8")
    plan = make_plan("chop", {})
    for one, made in (
        (bench("as-built"), plan),
        (bench("", SimBench), plan),
        (bench("shaker 3"), make_plan("chop", {"model": str(own)})),
    ):
        assert next(made.segments(one)).n_samples > 0
