"""What a challenge shows of itself: nothing that tells what is hidden."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.challenge.experiment import Stretch
from analysis.challenge.make import Counts, make_challenge, plans_of
from analysis.challenge.truth import reveal
from campaigns.log import read_run, verify
from sim_backend.errors import ConfigError
from sim_backend.model import load_model, number

FAMILIES = ("coulomb-friction", "delay", "dropped-samples", "vibration-line", "apex-noise", "hysteresis")


@pytest.fixture(scope="module")
def challenge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("challenge")
    make_challenge(folder, Counts(one=2, faint=1, none=3), seed=5, families=FAMILIES, shape="short")
    return folder


def face(path: Path) -> dict[str, object]:
    """Return all that a file shows besides the numbers measured and the numbers drawn to tell runs apart."""
    with h5py.File(path) as file:
        drawn = {"run_uid", "seed", "bench"}
        attributes = {k: str(v) for k, v in file.attrs.items() if k not in drawn}
        channels = {
            name: (d.shape, d.chunks, d.dtype.str, {k: str(v) for k, v in d.attrs.items()})
            for name, d in file["channels"].items()
        }
        segments = [
            (bytes(s["label"]), int(s["start"]), int(s["stop"]), bytes(s["settings"])) for s in file["segments"]
        ]
        return {
            "name": path.name,
            "bytes": path.stat().st_size,
            "mtime": path.stat().st_mtime,
            "attributes": attributes,
            "uid": len(str(file.attrs["run_uid"])),
            "channels": channels,
            "segments": segments,
        }


def test_every_case_with_as_many_axes_has_the_same_face(challenge: Path) -> None:
    truth = reveal(challenge).cases
    faces: dict[int, list[list[dict[str, object]]]] = {}
    for name, case in truth.items():
        files = sorted((challenge / "cases" / name).iterdir())
        assert [f.name for f in files] == ["nominal.toml", "run-1.h5", "run-1.h5.sha256"]
        faces.setdefault(case.axes, []).append([face(f) for f in files if f.suffix == ".h5"])
    assert sum(len(f) for f in faces.values()) == len(truth) == 3 * len(FAMILIES) + 3
    for same in faces.values():
        assert len(same) > 1
        assert all(f == same[0] for f in same)


def test_times_of_files_are_all_the_same(challenge: Path) -> None:
    assert len({f.stat().st_mtime for f in challenge.glob("cases/*/*")}) == 1


def test_public_files_hold_no_seed_and_no_name(challenge: Path) -> None:
    public = json.loads((challenge / "challenge.json").read_text())
    assert set(public) == {"schema", "cases", "seal"}
    texts = [f.read_text() for f in challenge.glob("cases/*/nominal.toml")]
    assert not any(family in text for family in FAMILIES for text in texts)
    assert len({text.count("\n") for text in texts}) <= 2  # one length for one axis, one for two


def test_logs_are_whole(challenge: Path) -> None:
    for name in ("0001", "0010", "0021"):  # each check is a process of its own
        assert verify(challenge / "cases" / name / "run-1.h5").ok


def test_log_holds_out_segments_of_another_size_and_form(challenge: Path) -> None:
    with read_run(challenge / "cases" / "0001" / "run-1.h5") as run:
        held_out = [s for s in run.segments if s.held_out]
        assert len(held_out) == 2
        assert {s.settings["amplitude"] for s in held_out}.isdisjoint(
            s.settings["amplitude"] for s in run.segments if not s.held_out
        )


def test_nominal_numbers_are_wrong_by_up_to_three_per_cent(challenge: Path) -> None:
    gains = []
    for path in challenge.glob("cases/*/nominal.toml"):
        model = load_model(path)
        # the output participation of an axis in its own suspension is 1 in truth
        gains += [number(model.modes[i].output[p.name]) - 1.0 for i, p in enumerate(model.outputs)]
    assert max(np.abs(gains)) <= 0.03
    # of 21 numbers or more, uniform within ±3 %, at least one lies beyond 2 % but for a chance of (2/3)^21 = 2e-4
    assert max(np.abs(gains)) > 0.02


def test_same_seed_makes_the_same_data_in_any_number_of_processes(tmp_path: Path) -> None:
    counts = Counts(one=1, none=1)
    for name, jobs in (("a", 1), ("b", 2)):
        make_challenge(tmp_path / name, counts, seed=8, families=("delay",), shape="short", jobs=jobs)
    for case in ("0001", "0002"):
        first, second = (tmp_path / n / "cases" / case / "run-1.h5" for n in ("a", "b"))
        assert first.read_bytes() == second.read_bytes()
    assert (tmp_path / "a" / "seal.txt").read_text() == (tmp_path / "b" / "seal.txt").read_text()


def test_counts_make_strata_in_random_order() -> None:
    plans = plans_of(Counts(one=2, faint=1, two=3, none=4, outside=1), FAMILIES, np.random.default_rng(0))
    strata = [p.stratum for p in plans]
    assert {s: strata.count(s) for s in set(strata)} == {"one": 12, "faint": 6, "two": 3, "none": 4, "outside": 6}
    assert strata != sorted(strata)
    assert all(len(set(p.slugs)) == 2 for p in plans if p.stratum == "two")


def test_families_with_a_twin_are_neither_left_out_nor_paired() -> None:
    families = ("actuator-gain", "sensor-gain", "coulomb-friction", "delay")
    plans = plans_of(Counts(one=1, none=0, two=2, outside=1), families, np.random.default_rng(0))
    hidden = {slug for p in plans if p.stratum in ("two", "outside") for slug in p.slugs}
    assert hidden == {"coulomb-friction", "delay"}
    assert {p.slugs[0] for p in plans if p.stratum == "one"} == set(families)


def test_unknown_family_and_full_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no family 'gremlin'"):
        make_challenge(tmp_path, Counts(), seed=1, families=("gremlin",))
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="not empty"):
        make_challenge(tmp_path, Counts(), seed=1)


def test_held_out_is_told_by_the_label() -> None:
    assert Stretch("held-out steps", 1, {}).held_out
    assert not Stretch("steps", 1, {}).held_out
