"""A free axis beside a torque that is always there: both fitted in time, from the balance of torques.

Gravity, a cable or an offset of the drive accelerates what nothing holds, so no offset of a reading stands for it. As
an input that is always one it is a number of the linear model like any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.identification.identified import deviations
from analysis.identification.inverse_dynamics import Balance
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records
from sim_backend.linear import Array


def pushed(balance: Balance, inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> Balance:
    """Return a balance without friction, its numbers fitted to the records in simulation; shapes are `balance_of`'s.

    A balance smooths what it takes apart, and is wrong by a percent for it; over a record such an axis adds that up.
    """
    with_one = [np.hstack([u, np.ones((u.shape[0], 1))]) for u in inputs]
    b = np.hstack([balance.linear.b, balance.linear.b[:, :1] * balance.constant])
    start = balance.linear.with_(
        omega_rad_s=np.zeros(1), b=b, b_direct=np.zeros_like(b), d=np.zeros_like(b), delay_s=np.zeros(b.shape[1])
    )
    fit: TimeFit | None = None
    for form in ("mechanical", "general"):  # a reading may be taken a little later than the command is given
        structure = Structure(form, feedthrough=False, offset=False)
        more = fit_records(with_one, outputs, rate_hz, 1, structure=structure, rigid_bodies=None, start=start)
        fit = more if fit is None or more.criterion < fit.criterion else fit
        start = fit.model
    assert fit is not None
    std = deviations(fit)
    drives = range(fit.model.n_inputs - 1)
    drive, one = fit.model.b[0, [0, -1]]
    one += 2.0 * fit.model.sigma_1_s[0] * fit.model.b_direct[0, -1]  # what is added to the rate for ever is torque too
    return replace(
        balance,
        linear=fit.model.driven_by(drives),
        std=std.driven_by(drives),
        constant=float(one / drive),
        constant_std=float(std.b[0, -1] / abs(drive)),
    )
