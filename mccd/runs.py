"""Recorded and simulated runs."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

import campaigns.log as log
from campaigns.benches import simulated_name
from mccd.models import Model, core_model
from mccd.showing import as_html

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    import sim_backend.model

Array = NDArray[np.float64]


class Run:
    """One recorded run: what it is, and the values of its channels; close it or use it as a context manager.

    `log` is the open file itself (`campaigns.log.Run`), with windows of segments and values in blocks.
    """

    def __init__(self, opened: log.Run, folder: tempfile.TemporaryDirectory[str] | None = None) -> None:
        self.log = opened
        self._folder = folder  # that of a simulation that nobody keeps: it goes when this object does

    @property
    def path(self) -> Path:
        """The file."""
        return self.log.path

    @property
    def run_uid(self) -> str:
        """The unique name of the run."""
        return self.log.run_uid

    @property
    def test(self) -> str:
        """What was done: the plan."""
        return self.log.header.test

    @property
    def status(self) -> str:
        """How the run ended: complete, paused, aborted, failed or crashed; running while it is written."""
        return self.log.status

    @property
    def note(self) -> str:
        """What was said of the run, empty where nothing."""
        return self.log.header.note

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the plan, in the units that their names end with; empty for imported data."""
        return self.log.header.settings

    @property
    def sample_rate_hz(self) -> float:
        """The rate in Hz that all channels share."""
        return self.log.sample_rate_hz

    @property
    def rows(self) -> int:
        """Samples of each channel."""
        return self.log.rows

    @property
    def channels(self) -> Mapping[str, log.Channel]:
        """Every channel by name, with unit, role and degree of freedom."""
        return self.log.channels

    @property
    def segments(self) -> tuple[log.LogSegment, ...]:
        """Every segment in its order: label, first sample, sample after the last, settings."""
        return self.log.segments

    def read(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Return samples `start` to `stop` (exclusive; default: all) of a channel as (n,), SI.

        Raises ConfigError for an unknown channel or sample, DataError where the file is damaged.
        """
        return self.log.read(name, start, stop)

    def time_s(self) -> Array:
        """Return the time of every sample after the start of the run, (n,), s."""
        return self.log.time_s(next(iter(self.channels)))

    def to_frame(self) -> pd.DataFrame:
        """Return all samples as a frame: a column per channel (SI), time in s as index, units in `attrs["units"]`."""
        from campaigns.log.export import to_frame

        return to_frame(self.log)

    def to_xarray(self) -> xr.Dataset:
        """Return all samples over `time` (s), with units, role and segment; raises ConfigError without xarray."""
        from campaigns.log.export import to_dataset

        return to_dataset(self.log)

    def plot(self) -> Figure:
        """Return a figure with a panel per channel over time, its segments shaded."""
        from campaigns.log.plot import picture

        return picture(self.log)

    def close(self) -> None:
        """Close the file; what describes the run stays, values do not."""
        self.log.close()
        if self._folder is not None:
            self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        length = f"{self.rows} samples at {self.sample_rate_hz:g} Hz"
        return f"<Run {self.run_uid[:8]}: {self.test}, {self.status}, {length}>"

    def _repr_html_(self) -> str:
        import pandas as pd

        rows = [(c.name, c.unit, c.role, c.dof) for c in self.channels.values()]
        frame = pd.DataFrame(rows, columns=["channel", "unit", "role", "dof"]).set_index("channel")
        length = f"{self.rows} samples at {self.sample_rate_hz:g} Hz, {self.rows / self.sample_rate_hz:.4g} s"
        lines = [f"{self.status}; {length}; {len(self.segments)} segments", *([self.note] if self.note else [])]
        return as_html(f"Run {self.run_uid[:8]}: {self.test}", lines, frame)


def read_run(path: str | Path) -> Run:
    """Open the log at `path`, even while it is written.

    Raises DataError for what is not a log, is damaged, differs from its checksum, or could do harm.
    """
    return Run(log.read_run(path))


def simulate(
    model: Model | sim_backend.model.Model | str | Path,
    plan: str = "freerun",
    settings: Mapping[str, Any] | None = None,
    *,
    seed: int = 0,
    out: str | Path | None = None,
    note: str = "",
) -> Run:
    """Play a plan on a model and return what its simulated bench measures, as `mccd simulate` does.

    `model` is a model, its file or the name of a bundled one; `settings` are those of the plan, in the units that their
    names end with (`alpha_deg`, `window_s`; `torque_nm` is in N m). The log is kept at `out`, else in a temporary
    folder until the run is closed. The bench has the name of the file, or of the model. Raises ConfigError for an
    unknown model, plan or setting, an existing `out`, and what the bench cannot be asked.
    """
    from campaigns.plans import make_plan
    from campaigns.playing.runner import run_plan
    from sim_backend.simbench import SimBench

    chosen, core = make_plan(plan, dict(settings or {})), core_model(model)
    folder = None
    if out is None:
        folder = tempfile.TemporaryDirectory(prefix="mccd-")
        out = Path(folder.name) / f"{chosen.name}.h5"
    path, name = Path(out), simulated_name(model) if isinstance(model, str | Path) else core.name
    run_plan(chosen, SimBench(core, seed, name=name), path, seed=seed, note=note)
    return Run(log.read_run(path), folder)


def opened(runs: Run | str | Path | Iterable[Run | str | Path]) -> Sequence[Run]:
    """Return runs from one or several, opening what is given as a path."""
    several: Iterable[Run | str | Path] = [runs] if isinstance(runs, Run | str | Path) else runs
    return [one if isinstance(one, Run) else read_run(one) for one in several]
