"""What an import interpolates is a fact of the log: how many samples, by which method, and how wrong they are."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.facts import Fact, all_facts_of, facts_of, remarks_on
from campaigns.facts.resampled import NAME, resampling
from campaigns.log import read_run
from mccdcli.main import main

RATE_HZ = 1000.0


def kept(folder) -> list[Fact]:
    """Return the facts on resampling that the log holds: identification, diagnosis and `log check` get the same."""
    with read_run(folder / "out.h5") as run:
        found, every = ([fact for fact in of(run) if fact.name == NAME] for of in (facts_of, all_facts_of))
        assert found == every
        told = remarks_on([run])
    assert [f"out.h5: {fact.told}" in told for fact in found] == [fact.remark for fact in found]
    return found


def test_samples_drawn_over_gaps_are_counted_and_their_error_is_kept(tmp_path, run_map, plain):
    full_s = np.arange(400) / RATE_HZ
    at_s = np.delete(full_s, [40, 41, 42, 170])
    np.savez(tmp_path / "a.npz", t=at_s, tx=np.sin(80.0 * at_s), ax=np.cos(80.0 * at_s))
    made = run_map(plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"\nresample = "linear"'))
    torque, angle = kept(tmp_path)
    assert (torque.channel, angle.channel) == ("torque", "angle")
    counts = {"readings": 396, "samples": 400, "drawn": 4, "longest": 3}
    assert {name: angle.numbers[name] for name in counts} == counts
    assert "(linear)" in angle.finding and angle.remark
    with read_run(tmp_path / "out.h5") as run:
        apart = run.read("angle") - 1e-3 * np.cos(80.0 * full_s)
    # what is claimed is of stretches as long as the longest gap everywhere: more than four samples cause in all
    assert np.sqrt(np.mean(apart**2)) / (1e-3 / np.sqrt(2.0)) < angle.numbers["error"] < 0.05
    assert angle.told in made.remarks


def test_an_even_clock_that_is_hardly_moved_is_kept_without_a_remark(tmp_path, run_map, plain):
    rng = np.random.default_rng(1)
    at_s = (np.arange(500) + rng.uniform(-0.2, 0.2, 500)) / RATE_HZ
    np.savez(tmp_path / "a.npz", t=at_s, tx=np.sin(40 * at_s), ax=np.cos(40 * at_s))
    made = run_map(plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"\nresample = "cubic"'))
    for fact in kept(tmp_path):
        assert fact.numbers["drawn"] == 0 and fact.numbers["error"] < 0.01 and not fact.remark
        assert fact.told in made.remarks  # an import says it in any case


def test_a_slower_channel_says_how_many_samples_have_no_reading(tmp_path, run_map, plain):
    fast_s, slow_s = np.arange(1000) / RATE_HZ, np.arange(101) * 1e-2
    np.savez(tmp_path / "a.npz", tx=np.sin(9 * fast_s), ax=np.cos(9 * slow_s), ts=slow_s)
    own = plain("a.npz").replace("sample_rate_hz = 10000.0", 'sample_rate_hz = 1000.0\nresample = "cubic"')
    run_map(own.replace('role = "output"', 'role = "output"\ntime = "ts"'))
    (fact,) = kept(tmp_path)
    counts = {"readings": 101, "samples": 1000, "drawn": 900, "longest": 9}
    assert fact.channel == "angle" and {name: fact.numbers[name] for name in counts} == counts


def test_each_part_has_its_own(tmp_path, run_map, plain):
    for k, lost in enumerate(([5], [7, 8])):
        at_s = np.delete(np.arange(300) / RATE_HZ, lost)
        np.savez(tmp_path / f"{k}.npz", t=at_s, tx=np.sin(80.0 * at_s), ax=np.cos(80.0 * at_s))
    text = plain("0.npz").replace("sample_rate_hz = 10000.0", 'time = "t"\nresample = "cubic"')
    parts = "".join(f'[[parts]]\nlabel = "p{k}"\nsource = "{k}.npz"\n' for k in range(2))
    run_map(text + parts)
    found = [(fact.segment, fact.channel, fact.numbers["drawn"]) for fact in kept(tmp_path)]
    assert found == [("p0", "torque", 1), ("p0", "angle", 1), ("p1", "torque", 2), ("p1", "angle", 2)]


@pytest.mark.parametrize("method", ["hold", "linear"])
def test_an_archive_keeps_it_for_every_name(tmp_path, run_map, plain, method):
    rng = np.random.default_rng(4)
    rows = [(t, "tx", np.sin(t)) for t in np.sort(rng.uniform(0.0, 30.0, 800))]
    rows += [(t, "ax", np.cos(t)) for t in np.arange(0.0, 30.0, 0.5)]
    text = "".join(
        f"{t!r},{name},{value!r}\n" for t, name, value in sorted((float(t), n, float(v)) for t, n, v in rows)
    )
    (tmp_path / "a.csv").write_text("stamp,pv,val\n" + text)
    archive = 'archive = { time = "stamp", name = "pv", value = "val" }'
    run_map(
        plain("a.csv").replace("sample_rate_hz = 10000.0", f'sample_rate_hz = 10.0\nresample = "{method}"\n{archive}')
    )
    torque, angle = kept(tmp_path)
    assert torque.numbers["readings"] == 800 and angle.numbers["readings"] == 60
    assert angle.numbers["longest"] == 4  # ten samples a second, two readings
    assert angle.numbers["drawn"] == pytest.approx(0.8 * angle.numbers["samples"], rel=0.01)
    assert f"({method})" in angle.finding and "error" in angle.numbers


def test_a_record_too_short_to_tell_says_that_its_error_is_unknown(tmp_path, run_map, plain):
    np.savez(tmp_path / "a.npz", t=[0.0, 0.1, 0.2, 0.4], tx=[0.0, 1.0, 0.0, 1.0], ax=[1.0, 2.0, 1.0, 3.0])
    run_map(plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"\nresample = "hold"'))
    for fact in kept(tmp_path):
        assert "error is unknown" in fact.finding and "error" not in fact.numbers and fact.remark


@pytest.mark.parametrize("seed", range(20))
def test_counts_are_those_of_every_sample_looked_at_by_itself(seed):
    rng = np.random.default_rng([7, seed])
    grid_s = np.asarray(3.0 + 0.01 * np.arange(int(rng.integers(2, 300))), dtype=np.float64)
    time_s = np.unique(rng.uniform(2.9, 3.1 + grid_s[-1] - grid_s[0], int(rng.integers(2, 200))))
    alone = np.abs(grid_s[:, None] - time_s).min(axis=1) > 0.005
    found = resampling(time_s, grid_s, "linear", 0.0)
    longest = max((len(run) for run in "".join("x" if one else " " for one in alone).split()), default=0)
    assert (found.drawn, found.longest) == (alone.sum(), longest)


def test_log_check_shows_it(tmp_path, run_map, plain, capsys):
    at_s = np.delete(np.arange(400) / RATE_HZ, [40, 41])
    np.savez(tmp_path / "a.npz", t=at_s, tx=np.sin(80.0 * at_s), ax=np.cos(80.0 * at_s))
    run_map(plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"\nresample = "cubic"'))
    assert main(["log", "check", str(tmp_path / "out.h5")]) == 0
    row = next(
        line for line in capsys.readouterr().out.splitlines() if line.startswith("resampled") and "angle" in line
    )
    assert "398 readings were resampled to 400 samples (cubic); 2 have no reading nearby, at most 2 in a row" in row
