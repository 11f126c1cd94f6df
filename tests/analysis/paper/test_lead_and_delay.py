"""The lead that a delay asks for, against a delay in the plant itself and the lag of the learning filter."""

import numpy as np
import pytest

from analysis.paper.figure_a2 import FREQUENCY_HZ, contraction
from analysis.paper.lead_and_delay import Leads, lead_and_delay
from analysis.paper.measured import RATE_HZ
from campaigns.strategies.design import Design
from sim_backend.control.repetitive import TABLE_6_5, convergence
from sim_backend.linear import discretise

AXES = tuple(TABLE_6_5)


@pytest.mark.parametrize("axis", AXES)
def test_without_a_delay_the_factor_is_that_of_figure_a2(axis):
    leads = Leads(axis)
    expected = np.max(contraction(Design.load("design", RATE_HZ), axis))
    assert leads.factor(leads.printed, 0.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("axis", AXES)
def test_a_delay_of_whole_samples_is_one_of_the_plant(axis):
    design = Design.load("design", RATE_HZ)
    late = design.axis(axis).with_(delay_s=np.array([2.0 / RATE_HZ]))
    plant = discretise(late, RATE_HZ).frequency_response(FREQUENCY_HZ)[:, 0, 0]
    learning = design.learning(axis, 2000, 1).filter
    factor = convergence(FREQUENCY_HZ, plant, learning, TABLE_6_5[axis].gain, TABLE_6_5[axis].lead_samples)
    assert Leads(axis).factor(TABLE_6_5[axis].lead_samples, 2.0) == pytest.approx(np.max(factor), rel=1e-9)


@pytest.mark.parametrize("axis", AXES)
def test_leads_follow_the_delay_sample_by_sample(axis):
    leads = Leads(axis)
    # a Butterworth filter of 4th order at 500 Hz lags by 2.613 / (2 pi 500 Hz) = 8.3 samples and the hold by 0.5
    assert abs(leads.best(0.0) - 8.8) < 1.0
    assert [leads.best(n) for n in (1.0, 2.0, 3.0)] == [leads.best(0.0) + n for n in (1, 2, 3)]
    least, most = leads.delays()
    assert most - least == pytest.approx(1.0, abs=1e-9)
    inside, beyond = 0.5 * (least + most), most + 0.01
    assert leads.best(inside) == leads.printed
    assert leads.best(beyond) == leads.printed + 1


def test_the_printed_leads_leave_no_room_for_a_sample():
    found = lead_and_delay()
    assert found.rows[0] == ("paper", "8", "9")
    by_delay = {row[0]: row[1:] for row in found.rows[1:]}
    assert by_delay["1 sample"] == ("9 ✗", "9")
    assert all("✗" not in cell for cell in (by_delay["0 samples"][0], by_delay["1 sample"][1]))
