"""The names of axes as a page prints them."""

from __future__ import annotations

import pytest

from sim_backend.axis_names import axes_in, with_axes


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("coulomb-friction at theta_x (probability 99 %)", "coulomb-friction at θx (probability 99 %)"),
        ("cross-coupling at theta_x->theta_y.", "cross-coupling at θx→θy."),
        ("it was theta_y, theta_z and theta_w", "it was θy, θz and theta_w"),
        ("runs/a->b.h5 by mccd chop --axis theta_x", "runs/a->b.h5 by mccd chop --axis theta_x"),
        (
            "in sweep-theta_x.h5, theta_x_slow and runs/theta_y/a.h5",
            "in sweep-theta_x.h5, theta_x_slow and runs/theta_y/a.h5",
        ),
    ],
)
def test_axes_are_printed_in_greek_but_not_in_names_of_files(text: str, printed: str) -> None:
    assert with_axes(text) == printed


def test_what_a_script_prints_has_them_too_and_keys_stay() -> None:
    told = {"theta_x": ["friction at theta_x", ("theta_y (mrad)", 1.0, None)], "note": "in run-theta_x.h5"}
    assert axes_in(told) == {"theta_x": ["friction at θx", ["θy (mrad)", 1.0, None]], "note": "in run-theta_x.h5"}
