"""What an import has asked of inputs and outputs together is kept; what no import has asked is found when wanted."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest

from campaigns.facts import RELATIONS, Fact, all_facts_of, missing_in
from campaigns.log import Channel, LogWriter, read_run

RATE_HZ = 500.0


def write(path, configuration: str) -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(3000)
    y = np.convolve(u, np.exp(-np.arange(60) / 12.0))[:3000] + 0.01 * rng.standard_normal(3000)
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    bench = {"kind": "imported", "name": "n"}
    with (
        LogWriter.create(path, channels, test="t", bench=bench, configuration=configuration) as log,
        log.segment("record", {}),
    ):
        log.append({"u": u, "y": y})


def test_what_was_asked_is_taken_from_the_log_and_the_rest_is_found(tmp_path):
    kept = Fact("coherence", "kept by the import", channel="y")
    asked = {"facts": [msgspec.to_builtins(kept)], "asked": ["coherence", "clock"]}
    write(tmp_path / "a.h5", json.dumps(asked))
    with read_run(tmp_path / "a.h5") as run:
        assert missing_in(run) == tuple(name for name in RELATIONS if name not in ("coherence", "clock"))
        facts = all_facts_of(run)
    assert [fact for fact in facts if fact.name == "coherence"] == [kept]
    assert {fact.name for fact in facts} == {"size", "closed-loop", "delay", "coherence"}


@pytest.mark.parametrize("configuration", ["{}", "[]", "none", '{"asked": 3}', '{"asked": {"a": 1}}'])
def test_a_log_that_holds_nothing_is_asked_everything(tmp_path, configuration):
    write(tmp_path / "a.h5", configuration)
    with read_run(tmp_path / "a.h5") as run:
        assert missing_in(run) == tuple(RELATIONS)
        assert {"clock", "coherence", "delay"} < {fact.name for fact in all_facts_of(run)}
