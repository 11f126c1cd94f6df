"""Requirements and readings: limits as the paper prints them, and CSV that is not what it should be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.measurements.chop import chop_stability
from analysis.recorded.readings import read_angles
from analysis.recorded.requirements import Check, chop_checks
from sim_backend.errors import DataError


def test_a_check_keeps_its_limit_up_to_and_including_it():
    assert Check("x", 1.0, "m", 1.0).ok and Check("x", 5.0, "m").ok
    assert not Check("x", np.nextafter(1.0, 2.0), "m", 1.0).ok
    assert not Check("x", math.nan, "m", 1.0).ok and not Check("x", math.inf, "m", 1.0).ok


def test_chop_checks_fail_exactly_where_table_6_6_is_missed():
    rng = np.random.default_rng(1)
    windows = rng.standard_normal((2, 20, 500, 2))
    # 3σ of 1.5 and 2.1 µrad: 12 % below and 24 % above 1.7 µrad, where 10⁴ samples know σ to 0.7 %
    windows *= np.array([0.5e-6, 0.7e-6])[:, None, None, None]
    windows += np.array([[0.0, 0.0], [8.5e-3, 0.0]])[:, None, None, :]
    commanded = np.array([[0.0, 0.0], [8.6e-3, 0.0]])  # 100 µrad away: beyond the 85 µrad of accuracy
    failed = {check.name for check in chop_checks(chop_stability(windows, commanded)) if not check.ok}
    assert failed == {"stability 3σ θx, position 2", "stability 3σ θy, position 2", "accuracy, position 2"}


def test_readings_are_read_by_column_name(tmp_path):
    path = tmp_path / "r.csv"
    path.write_text("note,theta_y,theta_x\na,2e-3,1e-3\nb,-4e-3,3e-3\n")
    np.testing.assert_array_equal(read_angles(path, 2), [[1e-3, 2e-3], [3e-3, -4e-3]])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("theta_x,theta_y\n1,2\n", "1 rows.*2 held points"),
        ("theta_x\n1\n2\n", "columns theta_x; give columns theta_x and theta_y"),
        ("", "columns none"),
        ("theta_x,theta_y\n1,2\n3,inf\n", "row 3, column theta_y holds 'inf'"),
        ("theta_x,theta_y\n1,2\n3\n", "row 3, column theta_y holds None"),
    ],
)
def test_readings_that_do_not_fit_are_named(tmp_path, text, says):
    path = tmp_path / "r.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=says):
        read_angles(path, 2)
