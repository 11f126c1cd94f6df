"""A log as a picture: every channel over time, drawn from the smallest and largest value of each column of dots."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from campaigns.log.read import Run
from sim_backend.axis_names import with_axes
from sim_backend.errors import ConfigError, DataError
from sim_backend.safe_write import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

FORMS = (".png", ".svg", ".pdf")
COLUMNS = 1200
"""Columns of dots; more are no wider than a line."""

BLOCKS = " ▁▂▃▄▅▆▇█"


def envelope(values: Array, columns: int) -> tuple[Array, Array]:
    """Return the smallest and the largest value (columns,) in equal pieces of a channel (n,)."""
    if values.size == 0:
        raise DataError("the log holds no samples: there is nothing to draw")
    edges = np.linspace(0, values.size, min(columns, values.size) + 1).astype(np.intp)[:-1]
    return np.fmin.reduceat(values, edges), np.fmax.reduceat(values, edges)  # numbers that are none leave gaps


def picture(run: Run) -> Figure:
    """Return a figure with a panel per channel over time, segments shaded, those held out in another shade."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = list(run.channels)
    figure = Figure(figsize=(9.0, 1.0 + 1.3 * len(names)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for ax, name in zip(axes, names, strict=True):
        values = run.read(name)
        low, high = envelope(np.where(np.isfinite(values), values, np.nan), COLUMNS)
        time_s = run.time_s(name)[np.linspace(0, run.rows - 1, low.size).astype(np.intp)]
        ax.fill_between(time_s, low, high, step="mid", linewidth=0.6, edgecolor="C0", facecolor="C0")
        ax.set_ylabel(f"{with_axes(name)}\n({run.channels[name].unit})", fontsize=8)
        ax.margins(x=0.0)
        ax.ticklabel_format(axis="y", useOffset=False, useMathText=True)
        for segment in run.segments:
            start, stop = (
                segment.start / run.sample_rate_hz + time_s[0],
                segment.stop / run.sample_rate_hz + time_s[0],
            )
            ax.axvspan(start, stop, color="C1" if segment.held_out else "C7", alpha=0.12, linewidth=0.0)
    for segment in run.segments if len(run.segments) <= 12 else ():
        axes[0].annotate(
            with_axes(segment.label),
            (segment.start / run.sample_rate_hz + run.time_s(names[0], 0, 1)[0], 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2, 2),
            textcoords="offset points",
            fontsize=7,
        )
    axes[-1].set_xlabel("time (s)")
    return figure


def require_picture(path: Path, *, force: bool | None = None) -> None:
    """Raise ConfigError for another ending than FORMS, and for a file that exists unless `force` replaces it.

    None is of a command that has no such option.
    """
    if path.suffix.lower() not in FORMS:
        raise ConfigError(f"{path}: '{path.suffix}' is not a picture format; there are {', '.join(FORMS)}")
    if path.exists() and not force:
        way = "" if force is None else ", or --force"
        raise ConfigError(f"{path} exists and is not overwritten; choose another path{way}")


def save_picture(run: Run, path: Path) -> None:
    """Write the picture of a log; raises ConfigError as `require_picture`."""
    require_picture(path)
    write_picture(picture(run), path)


def write_picture(figure: Figure, path: Path) -> None:
    """Write a figure in the format that the ending of `path` names, whole or not at all."""
    with whole_file(path) as stream:
        figure.savefig(stream, dpi=150, format=path.suffix.lower().removeprefix("."))


def drawn(run: Run, width: int = 60) -> list[tuple[str, str, str]]:
    """Return name, a line of blocks as high as the largest values, and range of every channel, `width` signs wide."""
    rows = []
    for name, channel in run.channels.items():
        values = run.read(name)
        low, high = envelope(np.where(np.isfinite(values), values, np.nan), width)
        if np.isnan(high).all():
            rows.append((name, " " * high.size, "no number"))
            continue
        least, most = float(np.nanmin(low)), float(np.nanmax(high))
        span = (most - least) or 1.0
        heights = np.rint((high - least) / span * (len(BLOCKS) - 2)) + 1.0
        line = "".join(BLOCKS[int(height)] if np.isfinite(height) else BLOCKS[0] for height in heights)
        rows.append((name, line, f"{least:.4g} to {most:.4g} {channel.unit}"))
    return rows
