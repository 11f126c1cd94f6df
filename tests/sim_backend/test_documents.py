"""What no document may be is told with its place and its limit, by every loader."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from analysis.challenge.pool import pool
from analysis.challenge.run import cases_of
from analysis.study.definition import load_study
from campaigns.importing.mapping import read_map
from campaigns.playing.campaign import load_campaign
from campaigns.playing.campaign_run import read_state
from campaigns.strategies.controller import load_controller
from mccdcli.settings import load_settings
from sim_backend.documents import MOST_LEVELS, SyntaxFault, json_of, toml_of
from sim_backend.errors import DataError, MccdError
from sim_backend.model import load_model

DEEP = "[" * 100_000 + "]" * 100_000
TABLES = ".".join("a" * 100_000) + " = 1"


def _settings(path: Path) -> object:
    os.environ["MCCD_CONFIG"] = str(path)
    return load_settings({}, {})


LOADERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "settings": ("mccd.toml", _settings),
    "model": ("model.toml", load_model),
    "model as JSON": ("model.json", load_model),
    "campaign": ("campaign.toml", load_campaign),
    "study": ("study.toml", load_study),
    "controller": ("controller.toml", load_controller),
    "import map": ("map.toml", read_map),
    "state of a campaign": ("campaign.json", lambda path: read_state(path.parent)),
    "score": ("score.json", lambda path: pool([path])),
    "challenge": ("challenge.json", lambda path: cases_of(path.parent)),
}
TEXTS = {
    "nothing": b"",
    "no text": b"\xff\xfe\x00",
    "zeros": bytes(1000),
    "deep list": f"a = {DEEP}".encode(),
    "deep list as JSON": DEEP.encode(),
    "deep object as JSON": ('{"a":' * 100_000 + "1" + "}" * 100_000).encode(),
    "deep tables": TABLES.encode(),
    "long number": b"a = " + b"1" * 5000,
    "number of 65 bits": b"a = 36893488147419103232",
    "number of 65 bits as JSON": b'{"a": 36893488147419103232}',
    "long line": b"x" * 1_000_000,
    "number": b"1",
    "list as JSON": b"[1, 2]",
    "empty object": b"{}",
    "nothing known": b'{"schema": "mccd-campaign-state/1", "cases": 1, "seal": []}',
}


@pytest.mark.parametrize("kind", LOADERS)
@pytest.mark.parametrize("text", TEXTS)
def test_every_loader_ends_in_one_clear_error(
    kind: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MCCD_CONFIG", "")
    name, load = LOADERS[kind]
    (tmp_path / name).write_bytes(TEXTS[text])
    if kind == "settings" and text == "nothing":
        return  # nothing is set
    with pytest.raises(MccdError, match=name):
        load(tmp_path / name)


def test_lists_and_tables_may_nest_so_deeply_and_no_deeper() -> None:
    most = "[" * (MOST_LEVELS - 1) + "]" * (MOST_LEVELS - 1)
    assert toml_of(f"a = {most}", "x")
    with pytest.raises(MccdError, match=f"x: lists or tables nest more than {MOST_LEVELS} levels deep"):
        toml_of(f"a = [[{most}]]", "x")


def test_whole_numbers_have_64_bits() -> None:
    assert toml_of("a = 9223372036854775807\nb = -9223372036854775808", "x")["a"] == 2**63 - 1
    with pytest.raises(MccdError, match="whole number 9.22e.18; the limit is 64 bits"):
        toml_of("a = 9223372036854775808", "x")


def test_what_is_no_toml_is_told_apart() -> None:
    with pytest.raises(SyntaxFault, match="x: not valid TOML: .*line 1"):
        toml_of("a = = 1", "x")
    with pytest.raises(DataError, match="x: not valid JSON: .*; correct it there"):
        json_of("{", "x", error=DataError)
