"""Two recorded sweeps of one axis at two temperatures, compared with each other."""

from __future__ import annotations

from analysis.measurements.thermal import SweepDifference, compare_sweeps
from analysis.recorded.sweep import sweep_of
from campaigns.log import Run
from sim_backend.errors import DataError


def compared_sweeps(first: Run, second: Run) -> SweepDifference:
    """Return the difference of the magnitudes, second over first; Fig. 6.17.

    Raises DataError when they are not sweeps of the same axis at the same frequencies.
    """
    one, two = sweep_of(first), sweep_of(second)
    if one.axis != two.axis or one.frequency_hz.tolist() != two.frequency_hz.tolist():
        raise DataError(
            f"{first.path} and {second.path} are sweeps of {one.axis} and {two.axis} at {one.frequency_hz.size} and "
            f"{two.frequency_hz.size} frequencies; give the same axis and frequencies"
        )
    return compare_sweeps(one.frequency_hz, one.response, two.response, one.relative_std, two.relative_std)
