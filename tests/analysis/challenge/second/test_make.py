"""Cases of the second generator: reproducible, sealed, readable, and nothing in them that tells what is hidden."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.challenge.second.draw import CLEAR
from analysis.challenge.second.laws import LAWS
from analysis.challenge.second.make import Counts, make_challenge, plans_of
from analysis.challenge.second.reserve import reserved, unlisted
from analysis.challenge.truth import reveal
from campaigns.log import read_run, verify
from mccdcli.main import main
from sim_backend.errors import ConfigError
from sim_backend.model import load_model

COUNTS = Counts(none=4, one=1, unlisted=1)
NAMES = ("smooth-coulomb", "back-emf")
SEED = 41


@pytest.fixture(scope="module")
def challenge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("second")
    make_challenge(folder, COUNTS, seed=SEED, names=NAMES)
    return folder


def test_the_same_seed_makes_the_same_cases(challenge: Path, tmp_path: Path) -> None:
    make_challenge(tmp_path, COUNTS, seed=SEED, names=NAMES)
    files = sorted(p.relative_to(challenge) for p in challenge.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*") if p.is_file())
    for file in files:
        # every file of an HDF5 log is the same to the byte; so are models, seal and truth
        assert (challenge / file).read_bytes() == (tmp_path / file).read_bytes(), file


def test_logs_are_whole_and_hold_something_out(challenge: Path) -> None:
    for case in sorted((challenge / "cases").iterdir()):
        held_out = 0
        for path in sorted(case.glob("run-*.h5")):
            assert verify(path).ok
            with read_run(path) as run:
                held_out += sum(s.held_out for s in run.segments)
        assert held_out == 1


def test_the_nominal_model_has_the_axes_of_the_log_and_wrong_numbers(challenge: Path) -> None:
    for name, case in reveal(challenge).cases.items():
        model = load_model(challenge / "cases" / name / "nominal.toml")
        assert len(model.inputs) == len(model.outputs) == case.axes
        assert 1 <= len(model.modes) <= 6
        assert not model.effects


def test_nothing_public_tells_what_is_hidden(challenge: Path) -> None:
    public = json.loads((challenge / "challenge.json").read_text())
    assert set(public) == {"schema", "cases", "seal", "generator", "nominal_error"}
    words = {law.name for law in LAWS.values()} | {law.effect for law in LAWS.values()} - {"delay"}
    for path in challenge.glob("cases/*/*"):
        data = path.read_bytes()
        assert not [word for word in words if word.encode() in data], path
    assert len({p.stat().st_mtime for p in challenge.glob("cases/*/*")}) == 1
    assert {p.name for p in challenge.glob("cases/*/*")} <= {
        "nominal.toml", *(f"run-{k}.h5{end}" for k in (1, 2) for end in ("", ".sha256"))
    }  # fmt: skip


def test_sizes_are_within_what_they_should_be_of_the_limits(challenge: Path) -> None:
    hidden = [effect for case in reveal(challenge).cases.values() for effect in case.effects]
    assert len(hidden) == 2
    for effect in hidden:
        assert CLEAR[0] <= effect.size / effect.naming_limit <= CLEAR[1]
        assert effect.naming_limit >= effect.detection_limit > 0.0


def test_the_truth_has_noise_floor_and_traits(challenge: Path) -> None:
    for case in reveal(challenge).cases.values():
        assert 0.0 < case.held_out_floor < 0.2
        assert len(case.noise_rms) == case.axes
        assert {"loop", "excitation", "axis", "rate", "readings"} <= set(case.traits)
        assert bool(case.granted) == (case.traits["readings"] == "counts")


def test_counts_make_strata_and_pairs_of_two_causes() -> None:
    counts = Counts(none=3, one=1, two=5, outside=1, twisted=2, unlisted=1)
    plans = plans_of(counts, (), np.random.default_rng(0))
    found = {s: sum(p.stratum == s for p in plans) for s in ("none", "one", "two", "outside", "twisted", "unlisted")}
    listed = sum(law.group == "listed" for law in LAWS.values())
    twisted = sum(law.group == "twisted" for law in LAWS.values())
    assert found == {
        "none": 3, "one": listed, "two": 5, "outside": listed - 2, "twisted": 2 * twisted,
        "unlisted": len(unlisted(kept_back=False)),
    }  # fmt: skip
    for plan in plans:
        if plan.stratum == "two":
            assert LAWS[plan.laws[0]].effect != LAWS[plan.laws[1]].effect


def test_reserved_laws_are_made_only_when_asked_for() -> None:
    counts = Counts(none=0, one=0, unlisted=1)
    plain = {p.laws[0] for p in plans_of(counts, (), np.random.default_rng(0))}
    kept = {p.laws[0] for p in plans_of(counts, (), np.random.default_rng(0), kept_back=True)}
    assert plain.isdisjoint(kept)
    assert kept == reserved()
    assert len(kept) == len(plain | kept) // 3
    secret = min(kept)
    with pytest.raises(ConfigError, match="has no law"):
        plans_of(counts, (secret,), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--generator", "second", "--faint", "1"], "the second generator has no --faint"),
        (["--generator", "second", "--shape", "short"], "the second generator has no --shape"),
        (["--twisted", "1"], "the first generator has no --twisted"),
        (["--reserved"], "the first generator has no --reserved"),
        (["--generator", "second", "--family", "gremlin"], "has no law 'gremlin'"),
        (["--generator", "second", "--one", "0", "--none", "0"], "a challenge of no cases"),
    ],
)
def test_a_mistake_ends_in_one_line(words: list[str], said: str, tmp_path: Path, capsys) -> None:
    assert main(["challenge", "make", str(tmp_path / "new"), *words]) == 2
    text = capsys.readouterr().err
    assert said in text
    assert text.count("\n") == 1
    assert not (tmp_path / "new").exists()
