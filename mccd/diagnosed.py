"""What a model gets wrong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

import analysis.diagnosis.result as core
import sim_backend.model
from analysis.diagnosis.answer.output import extended_model, prepare_folder, write_files
from analysis.diagnosis.api import diagnose as diagnose_arrays
from analysis.diagnosis.experiment.reference_sensor import load_logs
from analysis.diagnosis.pipeline import Options
from analysis.diagnosis.pipeline import diagnose as judge
from analysis.diagnosis.records.loading import Source
from mccd.models import Model, core_model
from mccd.runs import Run
from mccd.showing import as_html, xarray

if TYPE_CHECKING:
    import control
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arrays:
    """Records in memory, in the order and units of a model's ports.

    `inputs` and `outputs` are one record each, (n, n_inputs) and (n, n_outputs) or (n,) for one channel, or lists of
    records, each of which starts in an unknown state. `rate_hz` is their sample rate. `held_out` numbers the records
    that no fit may see, from 0; by default the last ones whose inputs differ in amplitude or waveform from all before
    them, else the last fifth of each record. `period` is that of the excitation in samples, 0 when it does not repeat.
    `temperature_k` has one (n,) per record.
    """

    inputs: ArrayLike | Sequence[ArrayLike]
    outputs: ArrayLike | Sequence[ArrayLike]
    rate_hz: float
    held_out: Sequence[int] = ()
    period: int = 0
    temperature_k: Sequence[ArrayLike] | None = None


class Diagnosis:
    """What a model gets wrong about records, and why.

    `found` has everything (`analysis.diagnosis.result.Diagnosis`): evidence, gain, next experiment, sensitivity.
    """

    def __init__(self, found: core.Diagnosis, nominal: sim_backend.model.Model, sources: Sequence[Source]) -> None:
        self.found = found
        self.nominal = Model(nominal)
        self.extended = Model(extended_model(nominal, found, sources))
        self._sources = tuple(sources)

    @property
    def verdict(self) -> core.Verdict:
        """The answer in one word.

        consistent: what the model misses is noise. named: it is wrong, and `causes` lists why. ambiguous: it is wrong,
        and these data do not show which cause of `ambiguous` it is. unknown: it is wrong, and no effect in the library
        explains how.
        """
        return self.found.verdict

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        return self.found.sentence

    @property
    def causes(self) -> tuple[core.Cause, ...]:
        """Every named cause: effect, location, probability, parameters (SI)."""
        return self.found.causes

    @property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """Causes that these data cannot tell apart, one tuple for each tie."""
        return self.found.ambiguous

    @property
    def gain(self) -> core.Gain | None:
        """What correcting gains on held-out samples, relative to the outputs (rms ÷ rms); None without any."""
        return self.found.gain

    def to_frame(self) -> pd.DataFrame:
        """Return a row per parameter of a named cause: effect, location, probability, value (SI), its std, unit."""
        import pandas as pd

        rows = [
            (cause.effect, cause.where, cause.probability, name, p.value, p.std, p.unit)
            for cause in self.causes
            for name, p in cause.parameters.items()
        ]
        return pd.DataFrame(rows, columns=["effect", "where", "probability", "parameter", "value", "std", "unit"])

    def to_xarray(self, record: int = 0) -> xr.Dataset:
        """Return one record over `time` (n,) in s: `input`, `output`, and the residuals `before` and `after`.

        These are measured minus simulated, (n, n_outputs) in the unit of the output, by the adjusted nominal and by the
        extended model. Raises ConfigError without xarray.
        """
        data = self.found.data.records[record]
        over = ("time", "output_channel")
        return xarray().Dataset(
            {
                "input": (("time", "input_channel"), data.u),
                "output": (over, data.y),
                "before": (over, self.found.before[record]),
                "after": (over, self.found.after[record]),
            },
            {
                "time": ("time", np.arange(data.n) / self.found.data.rate_hz, {"units": "s"}),
                "input_channel": list(self.nominal.inputs),
                "output_channel": list(self.nominal.outputs),
            },
            {"record": data.name, "verdict": self.verdict},
        )

    def to_control(self) -> control.StateSpace:
        """Return the linear part of the extended model, as `Model.to_control`."""
        return self.extended.to_control()

    def plot(self) -> Figure:
        """Return the residual of every output over time, before and after, where it was largest before."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        ports = self.nominal.core.outputs
        figure = Figure(figsize=(8.0, 0.8 + 2.2 * len(ports)), layout="constrained")
        FigureCanvasAgg(figure)
        grid = figure.subplots(len(ports), 1, squeeze=False)[:, 0]
        for k, (axes, port) in enumerate(zip(grid, ports, strict=True)):
            time_s, before, after, label = self._largest(k)
            axes.plot(time_s, before, linewidth=0.8, label="nominal model")
            axes.plot(time_s, after, linewidth=0.8, linestyle="--", label="extended model")
            axes.set_title(f"{port.name}, {label}", fontsize=9, parse_math=False)
            axes.set_ylabel(f"measured − simulated ({port.unit})", fontsize=8, parse_math=False)
        grid[-1].set_xlabel("time in the segment (s)")
        grid[0].legend(fontsize=8)
        return figure

    def write(self, folder: str | Path) -> dict[str, Path]:
        """Write diagnosis.json, extended.toml, index.html and figures, as `mccd diagnose` does; return paths by name.

        Raises ConfigError for a folder that cannot be made.
        """
        from analysis.diagnosis.answer.page import write_page

        home, nominal = prepare_folder(Path(folder)), self.nominal.core
        files = write_page(self.found, nominal, self._sources, home)
        return files | write_files(self.found, nominal, self._sources, home)

    def __repr__(self) -> str:
        return f"<Diagnosis of {self.nominal.name}: {self.verdict}>"

    def _repr_html_(self) -> str:
        tied = [f"tied: {' or '.join(names)}" for names in self.ambiguous]
        return as_html(f"Diagnosis: {self.verdict}", [self.sentence, *tied, *self.found.notes], self.to_frame())

    def _largest(self, output: int) -> tuple[Array, Array, Array, str]:
        """Return time, both residuals and label of the segment that the nominal model misses most in an output."""
        found = self.found
        i, window = max(
            ((i, window) for i, record in enumerate(found.data.records) for window in record.windows),
            key=lambda place: float(np.mean(found.before[place[0]][place[1].start : place[1].stop, output] ** 2)),
        )
        before, after = (x[i][window.start : window.stop, output] for x in (found.before, found.after))
        return np.arange(before.size) / found.data.rate_hz, before, after, window.label


def diagnose(
    runs: Run | str | Path | Iterable[Run | str | Path] | Arrays,
    model: Model | sim_backend.model.Model | str | Path,
    *,
    without: Sequence[str] = (),
    nominal_tolerance: float = 0.03,
    rows: int = 250_000,
    seed: int = 0,
) -> Diagnosis:
    """Return what a model gets wrong about logs or arrays, why, and what correcting it gains, as `mccd diagnose` does.

    `without` leaves effects out of the search; `nominal_tolerance` is how far the model's own numbers are trusted,
    relative (1σ); at most `rows` samples of all logs together are used, of arrays all. Raises ConfigError when
    model and records do not match, DataError for records that decide nothing.
    """
    nominal = core_model(model)
    options = Options(tolerance=nominal_tolerance, without=tuple(without), seed=seed)
    if isinstance(runs, Arrays):
        found = diagnose_arrays(
            runs.inputs,
            runs.outputs,
            runs.rate_hz,
            nominal,
            held_out=runs.held_out,
            period=runs.period,
            temperature_k=runs.temperature_k,
            options=options,
        )
        return Diagnosis(found, nominal, ())
    several: Iterable[Run | str | Path] = [runs] if isinstance(runs, Run | str | Path) else runs
    loaded, references = load_logs(
        [run.path if isinstance(run, Run) else run for run in several], nominal, max_rows=rows
    )
    found = judge(loaded.data, nominal, options, references=references)
    return Diagnosis(replace(found, notes=(*loaded.notes, *found.notes)), nominal, loaded.sources)
