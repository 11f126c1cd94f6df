"""Each channel of a log in a few numbers, in one pass over it: memory is that of a block however long the run."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from campaigns.log.read import Run
from campaigns.progress import Report, unheard
from sim_backend.errors import DataError


@dataclass(frozen=True)
class ChannelSummary:
    """Smallest and largest value, mean and standard deviation of `rows` values of the channel `name`, in `unit`."""

    name: str
    unit: str
    rows: int
    smallest: float
    largest: float
    mean: float
    std: float


@np.errstate(over="ignore", invalid="ignore")  # what is not finite goes into the numbers, and is seen there
def summarise(run: Run, names: Iterable[str] | None = None, report: Report = unheard) -> tuple[ChannelSummary, ...]:
    """Return the summary of the committed samples of each channel, or of those named.

    Deviations are summed about the mean of their own block and the blocks joined (Chan, Golub & LeVeque 1983), so that
    a large offset costs no digits. Values that are not finite go into every number. Raises DataError for a log without
    samples, and as `Run.read`.
    """
    chosen = tuple(run.channels if names is None else names)
    if run.rows == 0:
        raise DataError(f"{run.path} holds no samples: there is nothing to summarise")
    rows = 0
    low, high = np.full(len(chosen), np.inf), np.full(len(chosen), -np.inf)
    mean, squares = np.zeros(len(chosen)), np.zeros(len(chosen))
    with np.errstate(invalid="ignore"):  # of numbers that are none
        for start, block in run.blocks(chosen):
            report(start, run.rows, f"reading {run.path.name}")
            values = np.stack(list(block.values()))
            n, own = values.shape[1], values.mean(axis=1)
            low, high = np.minimum(low, values.min(axis=1)), np.maximum(high, values.max(axis=1))
            apart = own - mean
            squares += np.sum((values - own[:, None]) ** 2, axis=1) + apart**2 * (rows * n / (rows + n))
            mean += apart * (n / (rows + n))
            rows += n
    numbers = (low.tolist(), high.tolist(), mean.tolist(), np.sqrt(squares / rows).tolist())
    return tuple(
        ChannelSummary(name, run.channels[name].unit, rows, *each) for name, *each in zip(chosen, *numbers, strict=True)
    )
