"""A figure that keeps what it draws: each call draws a curve on the axes and puts it into the numbers beside them.

matplotlib and pandas are imported when the first figure is made: most of what imports this module draws none, or
draws long after it could have refused its options.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.pages.formats import printed, readable

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

INK = "#1b1b1f"
QUIET = "#6b7280"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7b4fb0")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (6, 2)),
    (0, (1.5, 1.5)),
    (0, (7, 2, 1.5, 2)),
    (0, (3, 1.5)),
    (0, (7, 2, 1.5, 2, 1.5, 2)),
    (0, (12, 3)),
)
MARKS = ("o", "s", "^", "D", "v", "P", "X")
"""Each colour has a dash and a mark of its own: curves are distinct in print and for readers who see few colours."""

PAPER = "#d55e00"
"""Whatever comes from the paper has this colour in every figure."""

OURS = "#0072b2"
LEGIBLE_IN = 5.0
"""Widest figure, in inches, whose letters are read when it is as wide as a telephone; those of a wider one grow."""

_OF_CELL, _LETTER_EM = 0.8, 0.62
"""Part of its cell in the grid that is left to a panel's axes; mean width of a letter in units of its size."""

LEAST_PT = 7.6
"""Smallest letters of a figure of LEGIBLE_IN: 7.5 pixels on a telephone, which are 2 mm."""

_STAMP_IN = 5.6
"""As LEGIBLE_IN for the letters at the foot of a figure, which only a desk shows, at least 57 pixels to the inch."""

_HANDLE_EM = 4.2
"""Room that a legend's entry takes beside its letters, in units of their size."""

_ENTRY_EM, _GAP_EM = 3.8, 1.0
"""Handle, pad and gap of each column of a legend above a panel, of which the gap is not beside the last."""

MOST_LAYOUTS = 8
"""How often a figure is laid out at most; axes of a fixed shape take three times."""

_KEPT = "\N{NO-BREAK SPACE}"
_LETTERS = ("font.size", "axes.titlesize", "xtick.labelsize", "ytick.labelsize", "legend.fontsize")

MAX_POINTS = 4000
"""Longest curve that is drawn in full; longer ones show the smallest and largest sample of every stretch."""


def look(k: int) -> dict[str, Any]:
    """Return colour, dash and mark of curve `k`; the eighth has the first colour again, with another dash and mark."""
    other = (k + k // len(COLOURS)) % len(DASHES)
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": DASHES[other], "marker": MARKS[other]}


@dataclass
class Canvas:
    """Axes in a grid and the numbers that were drawn on them, one row per point."""

    title: str
    caption: str
    rows: int = 1
    columns: int = 1
    size: tuple[float, float] = (7.2, 4.2)
    share_x: bool = False
    share_y: bool = False
    run_uids: tuple[str, ...] = ()
    figure: Figure = field(init=False)
    axes: list[Axes] = field(init=False)
    _parts: list[pd.DataFrame] = field(init=False, default_factory=list)
    _style: Any = field(init=False)
    _finished: bool = field(init=False, default=False)
    _titles: dict[int, str] = field(init=False, default_factory=dict)
    _looks: dict[tuple[Any, ...], dict[str, int]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.title = printed(self.title)
        import matplotlib as mpl
        from matplotlib.figure import Figure

        path = resources.files("analysis.pages") / "mccd.mplstyle"
        with resources.as_file(path) as file:
            self._style = mpl.rc_params_from_file(str(file), use_default_template=False)
        for name in _LETTERS:
            self._style[name] = float(self._style[name]) * max(1.0, self.size[0] / LEGIBLE_IN)
        with self._styled():
            self.figure = Figure(figsize=self.size)
            grid = self.figure.subplots(
                self.rows, self.columns, sharex=self.share_x, sharey=self.share_y, squeeze=False
            )
        self.axes = list(grid.reshape(-1))

    def panel(self, i: int, title: str, x_label: str, y_label: str) -> Axes:
        """Name the axes of panel `i`, counted row by row, and return them; names are text, never formulas.

        One that is longer than its axes is broken into lines. Degrees of freedom read as people write them: θx.
        """
        title, x_label, y_label = map(printed, (title, x_label, y_label))
        axes, (width_in, height_in) = self.axes[i], self.size
        self._titles[i] = title
        with self._styled():
            axes.set_title(self._broken(title, width_in / self.columns, "axes.titlesize"), parse_math=False)
            axes.set_xlabel(self._broken(x_label, width_in / self.columns, "font.size"), parse_math=False)
            axes.set_ylabel(self._broken(y_label, height_in / self.rows, "font.size"), parse_math=False)
        return axes

    def _broken(self, text: str, beside_in: float, letters: str) -> str:
        """Return a text in lines that are no longer than axes which take `_OF_CELL` of their cell in the grid."""
        most = int(_OF_CELL * beside_in * 72.0 / (_LETTER_EM * float(self._style[letters])))
        whole = re.sub(r"\(.*?\)", lambda unit: unit[0].replace(" ", _KEPT), text)  # no unit is broken
        lines = textwrap.wrap(whole, max(most, 8), break_long_words=False)
        return "\n".join(lines).replace(_KEPT, " ") or text

    def line(self, i: int, series: str, x: ArrayLike, y: ArrayLike, **style: Any) -> None:
        """Draw a curve (n,) on panel `i`, thinned where it is long, in a dash of its own, and keep what was drawn."""
        xs, ys = thinned(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        self._keep(i, series, xs, ys)
        with self._styled():
            (drawn,) = self.axes[i].plot(xs, ys, label=printed(series), **style)
        if "linestyle" not in style:
            drawn.set_linestyle(self._own(i, series, DASHES, drawn.get_color()))

    def points(self, i: int, series: str, x: ArrayLike, y: ArrayLike, **style: Any) -> None:
        """Draw single points (n,) on panel `i`, all of them, with a mark of their own, and keep them."""
        xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        self._keep(i, series, xs, ys)
        with self._styled():
            look = {"linestyle": "none", "marker": "o", "label": printed(series), **style}
            (drawn,) = self.axes[i].plot(xs, ys, **look)
        if "marker" not in style:
            drawn.set_marker(self._own(i, series, MARKS, drawn.get_color()))

    def bars(self, i: int, series: str, centre: ArrayLike, height: ArrayLike, width: float, **style: Any) -> None:
        """Draw bars (n,) on panel `i` and keep them."""
        xs, ys = np.asarray(centre, dtype=float), np.asarray(height, dtype=float)
        self._keep(i, series, xs, ys)
        with self._styled():
            self.axes[i].bar(xs, ys, width=width, label=printed(series), linewidth=0, **style)

    def band(self, i: int, low: float, high: float, label: str, color: str = COLOURS[2]) -> None:
        """Shade the allowed band of panel `i`, or another in a colour of its own."""
        self.axes[i].axhspan(
            low, high, color=color, alpha=0.13 if color == COLOURS[2] else 0.25, linewidth=0, label=label
        )

    def circle(self, i: int, radius: float, label: str) -> None:
        """Draw a limit circle about zero on panel `i`."""
        from matplotlib.patches import Circle

        self.axes[i].add_patch(Circle((0.0, 0.0), radius, fill=False, color=PAPER, linewidth=1.4, label=label))

    def second_scale(self, i: int, label: str, factor: float) -> None:
        """Label the top of panel `i` with its abscissa times `factor`."""
        with self._styled():
            top = self.axes[i].secondary_xaxis(
                "top", functions=(lambda x: np.asarray(x) * factor, lambda x: np.asarray(x) / factor)
            )
            top.set_xlabel(label, parse_math=False)

    def note(self, i: int, text: str, x: float, y: float, offset_pt: tuple[float, float], **style: Any) -> None:
        """Write a text beside a point of panel `i`: `x` in its units, `y` as a part of the height of its axes."""
        place: dict[str, Any] = {
            "xycoords": ("data", "axes fraction"),
            "textcoords": "offset points",
            "parse_math": False,
        }
        with self._styled():
            place["fontsize"] = self._style["legend.fontsize"]
            self.axes[i].annotate(printed(text), (x, y), offset_pt, **place, **style)

    def legend(self, i: int, **where: Any) -> None:
        """Show the legend of panel `i`, its letters no smaller than those of others."""
        if "fontsize" in where:
            where["fontsize"] = max(float(where["fontsize"]), self._style["legend.fontsize"])
        with self._styled():
            for text in self.axes[i].legend(**where).get_texts():
                text.set_parse_math(False)

    def legend_above(self, i: int, columns: int = 3) -> None:
        """Show the legend of panel `i` above its axes, beside the title, where it covers no curve.

        It has at most so many columns, fewer where it would cover the title.
        """
        labels, title = self.axes[i].get_legend_handles_labels()[1], self._titles.get(i, "")
        if title:
            whole_pt = _OF_CELL * 72.0 * self.size[0] / self.columns
            beside_pt = whole_pt - _width_pt(title, float(self._style["axes.titlesize"]))
            letter_pt = float(self._style["legend.fontsize"])
            columns = next((n for n in range(columns, 1, -1) if _legend_pt(labels, n, letter_pt) < beside_pt), 1)
        self.legend(i, loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=columns, borderpad=0.0, columnspacing=1.0)

    def legend_outside(self, columns: int = 4) -> None:
        """Show one legend of all panels above them, each name once: it covers no curve, whatever is drawn."""
        named: dict[str, Any] = {}
        for axes in self.axes:
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
                named.setdefault(label, handle)
        letter_pt = float(self._style["legend.fontsize"])
        widest_pt = letter_pt * (_LETTER_EM * max(map(len, named), default=0) + _HANDLE_EM)
        columns = max(min(columns, int(72.0 * self.size[0] / widest_pt)), 1)
        with self._styled():
            legend = self.figure.legend(
                named.values(), named.keys(), loc="outside upper left", ncols=columns, columnspacing=1.4
            )
            for text in legend.get_texts():
                text.set_parse_math(False)

    def numbers(self) -> pd.DataFrame:
        """Return every drawn point: panel, series, x with its label, y with its label."""
        import pandas as pd

        return pd.concat(self._parts, ignore_index=True)

    def svg(self, stamp: str = "") -> str:
        """Return the figure as SVG text with `stamp` below it; identical data gives identical text.

        Raises ValueError when called twice: laying out a figure again moves it by parts of a pixel.
        """
        if self._finished:
            raise ValueError("a canvas is laid out once; keep the text of its first svg()")
        self._finished = True
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        buffer = io.BytesIO()
        with self._styled():
            for axes in self.axes:
                _plain_ticks(axes)
            self._legible()
            if stamp:
                letters_pt = LEAST_PT * max(1.0, self.size[0] / _STAMP_IN)
                most = int(72.0 * self.size[0] / (_LETTER_EM * letters_pt))
                stamp = "\n".join(textwrap.wrap(stamp, most, break_long_words=False))
                at_foot = {"x": 0.005, "ha": "left", "fontsize": letters_pt, "color": QUIET}
                self.figure.supxlabel(stamp, parse_math=False, gid="stamp", **at_foot)
            drawn = FigureCanvasSVG(self.figure)
            if any(axes.get_aspect() != "auto" for axes in self.axes):
                self._settle()
            # `savefig` gives the same text, but draws a figure twice that is laid out by its contents
            drawn.print_svg(buffer, metadata={"Date": None, "Creator": "mccd"})
        return buffer.getvalue().decode("utf-8")

    def _legible(self) -> None:
        """Enlarge what was written past the methods of a canvas in letters that are too small on a telephone."""
        from matplotlib.text import Text

        least_pt = LEAST_PT * max(1.0, self.size[0] / LEGIBLE_IN)
        for text in self.figure.findobj(Text):
            text.set_fontsize(max(text.get_fontsize(), least_pt))

    def _settle(self) -> None:
        """Lay out axes of a fixed shape until they agree with their cells: else labels lie over what is below them."""
        engine, before = self.figure.get_layout_engine(), None
        assert engine is not None
        for _ in range(MOST_LAYOUTS):
            engine.execute(self.figure)
            places = [axes.get_position().bounds for axes in self.axes]
            if before is not None and np.allclose(places, before, atol=1e-3):
                return
            before = places

    def _styled(self) -> Any:
        import matplotlib as mpl

        return mpl.rc_context(self._style)

    def _own(self, i: int, series: str, looks: tuple[Any, ...], colour: Any) -> Any:
        """Return the look that goes with a colour, or the next one that no other series of that colour has on a panel.

        A series that another panel has is drawn as there, if that is free.
        """
        before = self._looks.setdefault((looks, colour), {})
        here = self._looks.setdefault((looks, colour, i), {})
        if series not in here:
            first = before.get(series, COLOURS.index(colour) if colour in COLOURS else 0)
            order = [(first + further) % len(looks) for further in range(len(looks))]
            here[series] = next((k for k in order if k not in here.values()), first)
            before.setdefault(series, here[series])
        return looks[here[series]]

    def _keep(self, i: int, series: str, x: Array, y: Array) -> None:
        import pandas as pd

        axes = self.axes[i]
        name = self._titles.get(i) or axes.get_title(loc="left") or f"panel {i + 1}"
        self._parts.append(
            pd.DataFrame(
                {
                    "panel": name,
                    "series": series,
                    "x": x,
                    "y": y,
                    "x_quantity": axes.get_xlabel().replace("\n", " "),
                    "y_quantity": axes.get_ylabel().replace("\n", " "),
                }
            )
        )


def _width_pt(text: str, letter_pt: float) -> float:
    """Return the width of a text in the letters of figures."""
    from matplotlib.font_manager import FontProperties  # see `Canvas`
    from matplotlib.textpath import text_to_path

    return float(text_to_path.get_text_width_height_descent(text, FontProperties(size=letter_pt), False)[0])


def _legend_pt(labels: Sequence[str], columns: int, letter_pt: float) -> float:
    """Return the width of a legend of some columns, each as wide as its longest label and what stands before it."""
    rows = max(-(-len(labels) // columns), 1)
    parts = [labels[k : k + rows] for k in range(0, len(labels), rows)]
    widest_pt = [max(_width_pt(label, letter_pt) for label in part) for part in parts]
    return sum(widest_pt) + letter_pt * (_ENTRY_EM * len(parts) - _GAP_EM)


def _plain_ticks(axes: Axes) -> None:
    """Let the numbers along axes be whole, and text of one size: superscripts of formulas are too small to read."""
    from matplotlib.ticker import FuncFormatter, LogFormatter, NullFormatter, ScalarFormatter

    for axis in (axes.xaxis, axes.yaxis):
        formatter = axis.get_major_formatter()
        if isinstance(formatter, ScalarFormatter):
            formatter.format_ticks(axis.get_majorticklocs().tolist())
            if formatter.get_offset():  # a power of ten or a number beside the axis, to be added to each along it
                axis.set_major_formatter(FuncFormatter(_whole(axis.get_majorticklocs())))
            continue
        if axis.get_scale() != "log" or not isinstance(axis.get_major_formatter(), LogFormatter):
            continue
        low, high = axis.get_view_interval()
        axis.set_major_formatter(FuncFormatter(_power_of_ten))
        axis.set_minor_formatter(NullFormatter() if high >= 10.0 * low else FuncFormatter(_power_of_ten))


def _whole(ticks: Array) -> Callable[[float, Any], str]:
    """Return what writes each of the `ticks` (n,) in full, with the digits that distinguish it from the next."""
    apart = np.diff(np.unique(ticks))
    last = int(np.floor(np.log10(apart.min()))) - 1 if apart.size else -4

    def written(value: float, _at: Any = None) -> str:
        size = int(np.floor(np.log10(abs(value)))) if value else last
        return readable(round(value, -last), max(size - last + 1, 1))

    return written


def _power_of_ten(value: float, _at: int | None = None) -> str:
    return re.sub(r"^1·(?=10)", "", readable(value, 2))


def thinned(x: Array, y: Array, most: int = MAX_POINTS) -> tuple[Array, Array]:
    """Return at most `most` points of a curve (n,) that look the same: every stretch keeps its extremes in order.

    A stretch with a gap (NaN) keeps one row of it beside its extremes.
    """
    if x.size <= most:
        return x, y
    stretch = -(-2 * x.size // most)
    whole = x.size // stretch * stretch
    parts = y[:whole].reshape(-1, stretch)
    first = np.arange(parts.shape[0]) * stretch
    gaps = np.isnan(parts)
    lowest, highest = np.where(gaps, np.inf, parts).argmin(axis=1), np.where(gaps, -np.inf, parts).argmax(axis=1)
    gap = (first + gaps.argmax(axis=1))[gaps.any(axis=1)]
    keep = np.unique(np.concatenate([first + lowest, first + highest, gap, np.arange(whole, x.size)]))
    return x[keep], y[keep]
