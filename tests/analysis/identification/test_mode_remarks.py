"""No mode is given up without a word, none kept with undetermined numbers; two in one place are merged or told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.identification import identify
from analysis.identification.determined import SIGNIFICANT, same_place, without_undetermined
from analysis.identification.from_table import identify_table
from analysis.identification.identified import Identification, deviations
from analysis.identification.mode_remarks import remarks_on_modes
from analysis.identification.timefit import TimeFit, fit_records
from campaigns.log import read_run
from sim_backend.linear import ModalModel
from tests.analysis.identification.test_from_table import F, response, written
from tests.analysis.identification.two_mode_bench import play, write
from tests.end_to_end.linear_bench import oscillator, played

FIT, ALL = 8000, 12_000
HARD = 1e9


def identified(path: Path, **options: Any) -> Identification:
    with read_run(path) as run:
        return identify.identify_runs([run], **options)


def beside(frequencies_hz: list[float], decays: list[float], b: list[list[float]], c: list[list[float]]) -> ModalModel:
    omega, into, out = 2.0 * np.pi * np.array(frequencies_hz), np.array(b), np.array(c).T
    none = np.zeros((out.shape[0], into.shape[1]))
    return ModalModel(omega, np.array(decays), into, 0.0 * into, out, 0.0 * out, none, np.zeros(into.shape[1]))


def test_two_modes_on_one_hardening_spring_become_one(tmp_path, monkeypatch):
    """The fit by the criterion has two at 10 Hz; the held-out segment needs one."""
    u, y = play(HARD, 2, ALL)
    path = write(tmp_path / "run.h5", u, y, [("fit", 0, FIT), ("held-out", FIT, ALL)])
    found = identified(path)
    monkeypatch.setattr(identify, "with_pairs_merged", lambda fit, *_: fit)
    unmerged = identified(path)
    assert len(unmerged.modes) == 3 and len(found.modes) == 2
    assert found.held_out[0].total <= unmerged.held_out[0].total
    assert any("closer to another one than their widths" in remark for remark in found.remarks)
    assert any(
        "closer than their widths" in remark and "one mode that is not linear" in remark for remark in unmerged.remarks
    )


def test_two_real_modes_in_one_place_are_both_kept(tmp_path):
    """Linear, 0.2 Hz apart and 0.6 Hz wide: one alone would miss the held-out segment far beyond its noise."""
    u, y = play(0.0, 3, ALL, np.array([10.41, 10.61]))
    path = write(tmp_path / "run.h5", u, y, [("fit", 0, FIT), ("held-out", FIT, ALL)])
    found = identified(path)
    assert len(found.modes) == 2
    assert sum("closer than their widths" in remark for remark in found.remarks) == 1


def test_modes_of_two_axes_may_have_one_frequency():
    one = beside([10.0, 10.1], [2.0, 2.0], [[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.05], [-0.05, 1.0]])
    assert same_place(one) == []
    other = beside([10.0, 10.1], [2.0, 2.0], [[1.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [-0.4, 0.1]])
    assert same_place(other) == [(0, 1)]
    assert same_place(beside([10.0, 20.0], [2.0, 2.0], [[1.0], [1.0]], [[1.0], [1.0]])) == []


def test_a_number_of_modes_that_is_asked_for_is_fitted_but_what_is_unknown_is_told(tmp_path):
    u, y = play(0.0, 1, ALL)
    path = write(tmp_path / "run.h5", u, y, [("fit", 0, FIT), ("held-out", FIT, ALL)])
    right, more = identified(path, modes=2), identified(path, modes=3)
    assert right.remarks == ()
    assert len(more.modes) == 3
    doubtful = [
        mode
        for mode in more.modes
        if mode["frequency_hz"] < SIGNIFICANT * mode["frequency_std_hz"]
        or mode["decay_rate_1_s"] < SIGNIFICANT * mode["decay_rate_std_1_s"]
    ]
    assert doubtful
    assert sum("is not determined by the data" in remark for remark in more.remarks) == len(doubtful)


def test_what_was_given_up_is_told_with_its_numbers():
    """A record of one mode fitted by two: the second explains next to nothing."""
    u = np.random.default_rng(2).standard_normal((3000, 1))
    y = played(oscillator(8.0, 0.05), np.array([[0.0], [2500.0]]), np.eye(1, 2), u, 100.0)
    y += 5e-3 * y.std() * np.random.default_rng(7).standard_normal(y.shape)

    def again(n: int, start: ModalModel | None) -> TimeFit:
        return fit_records([u], [y], 100.0, n, start=start)

    fit = without_undetermined(again(2, None), (1, 2), again)
    assert fit.model.n_blocks == 1
    (dropped,) = fit.dropped
    assert dropped.explained is not None and dropped.explained < 0.05
    (told,) = remarks_on_modes(fit.model, deviations(fit), fit.dropped)
    assert told.startswith(f"1 mode was given up, undetermined by the data: {dropped.frequency_hz:.4g} ±")
    assert told.endswith("% of the squared residual)")


@pytest.mark.parametrize("modes", [2, 4])
def test_a_table_tells_of_modes_that_it_does_not_determine(tmp_path, modes):
    h = response(F) * (1.0 + 1e-3 * np.random.default_rng(1).standard_normal(F.size))
    path = written(tmp_path / "h.csv", ["f (Hz)", "Re", "Im"], [F, h.real, h.imag])
    told = [remark for remark in identify_table(path, modes=modes).remarks if "not determined" in remark]
    assert bool(told) == (modes > 2)


def test_an_exact_model_has_no_remark():
    model = beside([10.0, 20.0], [2.0, 2.0], [[1.0], [1.0]], [[1.0], [1.0]])
    std = model.with_(omega_rad_s=1e-3 * model.omega_rad_s, sigma_1_s=0.3 * model.sigma_1_s)
    assert remarks_on_modes(model, std) == ()
    (told,) = remarks_on_modes(model, std.with_(sigma_1_s=np.array([0.4, 0.3]) * model.sigma_1_s))
    assert "mode 1 (10 Hz)" in told and "decay rate 2 ± 0.8" in told
