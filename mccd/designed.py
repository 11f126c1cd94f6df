"""Controllers from an identified model and the noise of a bench."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import analysis.design.api as core
import sim_backend.model
from analysis.design.output import AXIS_HEADS, axis_rows
from analysis.design.uncertainty import Tolerance
from campaigns.benches import open_bench
from campaigns.strategies.controller import dump_controller
from mccd.models import Model, core_model
from mccd.runs import Run, opened
from mccd.showing import as_html, xarray
from sim_backend.errors import ConfigError
from sim_backend.safe_write import write_text

if TYPE_CHECKING:
    import control
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


class Controller:
    """A designed controller; `found` has everything that speaks for it (`analysis.design.api.Designed`)."""

    def __init__(self, found: core.Designed) -> None:
        self.found = found

    @property
    def axes(self) -> tuple[str, ...]:
        """Degrees of freedom that it controls."""
        return tuple(one.dof for one in self.found.axes)

    def to_frame(self) -> pd.DataFrame:
        """Return what is expected of every axis beside its limit, as text with units."""
        import pandas as pd

        return pd.DataFrame(axis_rows(self.found), columns=list(AXIS_HEADS))

    def to_xarray(self) -> dict[str, xr.Dataset]:
        """Return the move of each axis over `time` (n,) in s: `reference` in rad and `torque` in N m, fed forward.

        Raises ConfigError without xarray.
        """
        xr = xarray()
        return {
            one.dof: xr.Dataset(
                {
                    "reference": ("time", one.price.motion_rad, {"units": "rad"}),
                    "torque": ("time", one.price.drive_nm, {"units": "N m"}),
                },
                {"time": ("time", one.time_s, {"units": "s"})},
            )
            for one in self.found.axes
        }

    def to_control(self) -> dict[str, control.StateSpace]:
        """Return the feedback of each axis as a sampled `control.StateSpace`, from error (rad) to torque (N m)."""
        import control

        filters = {one.dof: one.feedback.controller for one in self.found.axes}
        return {dof: control.ss(*made.state_space(), 1.0 / made.rate_hz) for dof, made in filters.items()}

    def plot(self) -> Figure:
        """Return the sensitivity S of each axis in dB over frequency, with the band of the uncertain plants."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        from analysis.design.figures import design_figures

        figure = design_figures(self.found)["sensitivity"].figure
        FigureCanvasAgg(figure)
        return figure

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the controller file that designed strategies play; raises ConfigError for an existing file."""
        target = Path(path)
        if target.exists() and not force:
            raise ConfigError(f"{target} exists and would be overwritten; choose another path or give force=True")
        return write_text(target, dump_controller(self.found.controller))

    def __repr__(self) -> str:
        return f"<Controller {self.found.controller.name}: {', '.join(self.axes)}>"

    def _repr_html_(self) -> str:
        return as_html(self.found.controller.name, [], self.to_frame())


def design(
    model: Model | sim_backend.model.Model | str | Path,
    runs: Run | str | Path | Iterable[Run | str | Path],
    *,
    bench: str = "sim",
    reach_rad: float = 8.5e-3,
    settling_s: float | None = None,
    max_power_w: float | None = None,
    tolerance: float = 0.01,
    seed: int = 0,
    unswept: bool = False,
) -> Controller:
    """Return feedback, learning and feed-forward for the tilt axes of a bench, as `mccd design` does.

    `runs` must hold the noise at rest (plan `rest`) and, unless `unswept` trusts the model, a sweep of every tilt axis
    of bench and model (plan `sinesweep`); hysteresis loops may be among them. The `bench`, which is the one that they
    were recorded on, is asked for its axes and limits; nothing is played. `reach_rad` is the stroke of a move,
    `settling_s` the time that it may take (5 ms unless given, 0.1 s at most); with `max_power_w` instead, it is the
    fastest move whose 5 Hz chop dissipates at most that. `tolerance` is how far the frequency of every mode may be off,
    relatively and either way, in addition to the standard deviation that the model states.

    Raises ConfigError for an axis that must be swept, for runs of several benches or of another one, and for a design
    that would be unstable, break a limit or miss a requirement, DataError when no run holds the noise.
    """
    if settling_s is not None and max_power_w is not None:
        raise ConfigError("settling_s and max_power_w both choose the move; give one of them")
    usual = core.Options()
    options = core.Options(
        reach_rad,
        usual.settling_s if settling_s is None else settling_s,
        max_power_w,
        tolerance=Tolerance(tolerance),
        seed=seed,
    )
    with closing(open_bench(bench, seed)) as face:
        limits, axes, identity = face.limits, face.axes, face.identity
    logs = [run.log for run in opened(runs)]
    core.require_of_bench(logs, asdict(identity))
    if not unswept:
        core.require_swept(logs, core.require_strokes(core_model(model), limits, axes, options))
    return Controller(core.design_controller(core_model(model), logs, limits, axes, options))
