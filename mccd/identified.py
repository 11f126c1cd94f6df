"""Models from logs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import analysis.identification.identified as core
from analysis.identification.bode import bode, measured_curves
from analysis.identification.identify import identify_runs
from analysis.identification.response_curves import ResponseCurve
from mccd.models import Model
from mccd.runs import Run, opened
from mccd.showing import as_html, xarray

if TYPE_CHECKING:
    import control
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


class Identification:
    """A model that was identified, and how well it does.

    `found` has everything (`analysis.identification.identified.Identification`): the method, misfit, noise, error on
    held-out segments, remarks.
    """

    def __init__(self, found: core.Identification, curves: Sequence[ResponseCurve]) -> None:
        self.found = found
        self.model = Model(found.model)
        self._curves = tuple(curves)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What of the records was left out or is uncertain."""
        return self.found.remarks

    def to_frame(self) -> pd.DataFrame:
        """Return a row per mode, as `Model.to_frame`."""
        return self.model.to_frame()

    def to_xarray(self) -> dict[tuple[str, str], xr.Dataset]:
        """Return what was measured by frequency, by (output, input).

        Each over `frequency` (n_f,) in Hz: `magnitude` in output unit per input unit, its standard deviation `std`, and
        `phase` in rad. Empty where the record holds too little. Raises ConfigError without xarray.
        """
        xr = xarray()
        return {
            (c.output, c.input): xr.Dataset(
                {
                    "magnitude": ("frequency", c.magnitude),
                    "std": ("frequency", c.std),
                    "phase": ("frequency", c.phase_rad),
                },
                {"frequency": ("frequency", c.frequency_hz, {"units": "Hz"})},
            )
            for c in self._curves
        }

    def to_control(self) -> control.StateSpace:
        """Return the linear model, as `Model.to_control`."""
        return self.model.to_control()

    def plot(self) -> Figure:
        """Return the Bode diagram: what was measured and the model."""
        return bode(self.found.model, self._curves, continuous=self.found.of_a_table)

    def __repr__(self) -> str:
        return f"<Identification of {self.model!r} by {self.found.method}>"

    def _repr_html_(self) -> str:
        errors = [f"error on held-out {one.segment}: {100.0 * one.total:.3g} %" for one in self.found.held_out]
        return as_html(f"Identified by {self.found.method}", [*errors, *self.remarks], self.to_frame())


def identify(
    runs: Run | str | Path | Iterable[Run | str | Path],
    *,
    modes: int | Sequence[int] | None = None,
    only: str = "",
    equal_weights: bool = False,
    name: str = "identified",
) -> Identification:
    """Return the linear model that explains logs best, as `mccd identify --log` does.

    `modes` is their number, or several to choose from (1 to 6 for each input unless given; of stepped sines it is the
    number of each axis). `only` fits the segments whose label contains it; segments with `held-out` in their label are
    never fitted. `equal_weights` fits periodic data for the least rms error. Raises DataError for runs that differ or
    hold nothing to fit, ConfigError for `only` or `equal_weights` with stepped sines, which are fitted whole.
    """
    logs = [run.log for run in opened(runs)]
    found = identify_runs(logs, modes=modes, only=only, equal_weights=equal_weights, name=name)
    return Identification(found, measured_curves(found, logs))
