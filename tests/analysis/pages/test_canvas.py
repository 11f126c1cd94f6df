import re
from typing import cast

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from analysis.pages.canvas import COLOURS, MARKS, MAX_POINTS, Canvas, thinned


def test_what_is_drawn_is_what_stands_in_the_numbers():
    canvas = Canvas("T", "C", columns=2)
    canvas.panel(0, "left", "x (s)", "y (m)")
    canvas.line(0, "curve", [0.0, 1.0, 2.0], [3.0, 4.0, 5.0])
    canvas.points(1, "dots", [7.0], [8.0])
    canvas.bars(1, "bars", [1.0, 2.0], [5.0, 6.0], 0.5)
    numbers = canvas.numbers()
    drawn = canvas.axes[0].lines[0]
    of_curve = numbers[numbers.series == "curve"]
    np.testing.assert_array_equal(drawn.get_xdata(), of_curve.x)
    np.testing.assert_array_equal(drawn.get_ydata(), of_curve.y)
    assert of_curve.panel.tolist() == ["left"] * 3
    assert of_curve.x_quantity.iloc[0] == "x (s)"
    heights = [cast(Rectangle, p).get_height() for p in canvas.axes[1].patches]
    assert numbers[numbers.series == "bars"].y.tolist() == heights
    assert numbers.panel.iloc[3] == "panel 2"


def test_long_curves_keep_their_extremes_and_their_order():
    x = np.arange(100_000.0)
    y = np.sin(x / 500.0)
    y[[31_234, 77_777]] = 5.0, -5.0
    xs, ys = thinned(x, y)
    assert xs.size <= MAX_POINTS + 2
    assert np.all(np.diff(xs) > 0)
    assert (ys.max(), ys.min()) == (5.0, -5.0)
    assert np.all(np.isin(xs, x))
    np.testing.assert_array_equal(ys, y[xs.astype(int)])
    short = np.arange(10.0)
    assert thinned(short, short)[0] is short


def figure():
    canvas = Canvas("T", "C")
    canvas.panel(0, "p", "x", "y")
    rng = np.random.default_rng(1)
    canvas.points(0, "dots", rng.normal(size=200), rng.normal(size=200))
    canvas.circle(0, 1.0, "limit")
    canvas.band(0, -1.0, 1.0, "band")
    canvas.legend(0)
    return canvas


def test_identical_data_gives_identical_bytes():
    first, second = figure().svg("runs a"), figure().svg("runs a")
    assert first == second
    assert "runs a" in first
    assert "<dc:date>" not in first


def test_the_stamp_and_the_data_change_the_bytes():
    assert figure().svg("runs a") != figure().svg("runs b")


def test_a_name_that_looks_like_mathematics_is_only_a_name():
    assert r"bench $\frac{$ _x^" in figure().svg(r"bench $\frac{$ _x^")


def test_a_figure_is_laid_out_once():
    canvas = figure()
    canvas.svg()
    with pytest.raises(ValueError, match="laid out once"):
        canvas.svg()


@pytest.mark.parametrize("i", [1, 5])
def test_a_panel_that_is_not_there_is_an_error(i):
    with pytest.raises(IndexError):
        figure().line(i, "s", [0.0], [0.0])


def test_no_two_of_seven_curves_have_the_same_colour_or_dash_and_no_two_of_seven_points_the_same_mark():
    canvas = Canvas("T", "C", columns=2)
    for k in range(7):
        canvas.line(0, f"curve {k}", [0.0, 1.0], [0.0, k])
        canvas.points(1, f"dots {k}", [0.0, 1.0], [0.0, k], color=COLOURS[k])
    assert len({line.get_marker() for line in canvas.axes[1].lines}) == 7
    svg = canvas.svg()
    # the curves alone are in a colour and not filled
    styles = [style for style in re.findall(r'style="(fill: none;[^"]*)"', svg) if re.search("|".join(COLOURS), style)]
    assert len(styles) == 7
    assert len({re.sub(r".*stroke-dasharray: ([^;]*);.*|.*", r"\1", style) for style in styles}) == 7


def test_curves_and_points_of_one_colour_differ_in_dash_and_mark():
    canvas = Canvas("T", "C", columns=2)
    for k in range(9):  # the eighth and the ninth have a colour again
        canvas.line(0, f"curve {k}", [0.0, 1.0], [0.0, k])
    for name in ("lowest", "highest"):
        canvas.points(1, name, [0.0, 1.0], [0.0, 1.0], color=COLOURS[5])
    low, high = canvas.axes[1].lines
    assert (low.get_marker(), high.get_marker()) == (MARKS[5], MARKS[6])
    svg = canvas.svg()
    styles = [style for style in re.findall(r'style="(fill: none;[^"]*)"', svg) if re.search("|".join(COLOURS), style)]
    assert len(styles) == len(set(styles)) == 9


def test_a_series_looks_the_same_in_every_panel():
    canvas = Canvas("T", "C", columns=2)
    for i, names in ((0, ("first", "second")), (1, ("second", "third", "second"))):
        for name in names:
            canvas.points(i, name, [0.0], [0.0], color=COLOURS[0])
    marks = [[line.get_marker() for line in axes.lines] for axes in canvas.axes]
    assert marks == [[MARKS[0], MARKS[1]], [MARKS[1], MARKS[0], MARKS[1]]]


def test_a_dash_or_mark_that_is_asked_for_stays():
    canvas = Canvas("T", "C")
    canvas.line(0, "curve", [0.0, 1.0], [0.0, 1.0], color=COLOURS[1], linestyle=":")
    canvas.points(0, "dots", [0.0, 1.0], [0.0, 1.0], color=COLOURS[1], marker=".")
    assert [canvas.axes[0].lines[0].get_linestyle(), canvas.axes[0].lines[1].get_marker()] == [":", "."]


def test_a_name_longer_than_its_axes_is_broken_and_stays_whole_in_the_numbers():
    name, quantity = "position 1: 0.0 mrad, 98.31 % of all samples inside", "theodolite − sensor (µrad)"
    canvas = Canvas("T", "C", rows=2, columns=2, size=(7.2, 4.0))
    canvas.panel(0, name, "x", quantity)
    canvas.panel(1, "short", "x", "y")
    canvas.line(0, "curve", [0.0, 1.0], [0.0, 1.0])
    title, label = canvas.axes[0].get_title(loc="left"), canvas.axes[0].get_ylabel()
    assert "\n" in title and title.replace("\n", " ") == name and "\n" in label
    assert (canvas.numbers().panel == name).all() and (canvas.numbers().y_quantity == quantity).all()
    assert canvas.axes[1].get_title(loc="left") == "short"
    # by the letters as they are drawn: none is outside of its half of the figure
    canvas.svg()
    assert canvas.axes[0].title.get_window_extent().width == 0.0  # the centre title is not used
    width = canvas.axes[0].get_window_extent().width
    left_title = next(t for t in canvas.axes[0].get_children() if getattr(t, "get_text", str)() == title)
    assert left_title.get_window_extent().width < 1.1 * width


def test_numbers_along_a_logarithmic_axis_are_text_of_one_size():
    canvas = Canvas("T", "C")
    canvas.line(0, "curve", [1.0, 1e4], [1e-7, 1.0])
    canvas.axes[0].set_xscale("log")
    canvas.axes[0].set_yscale("log")
    svg = canvas.svg()
    for text in ("10⁻⁵", "0.001", "1,000"):
        assert f">{text}</text>" in svg
    assert "<tspan" not in svg


def test_letters_of_a_wide_figure_are_read_at_the_width_of_a_telephone():
    for width in (4.4, 7.2, 10.0):
        canvas = Canvas("T", "C", size=(width, 4.0))
        canvas.panel(0, "p", "x", "y")
        canvas.line(0, "curve", [0.0, 1.0], [0.0, 1.0])
        canvas.legend(0, fontsize=4)
        # past the methods of the canvas, as well
        canvas.axes[0].annotate("a note", (0.5, 0.5), fontsize=4)
        canvas.axes[0].text(0.2, 0.5, "a text", fontsize=4)
        canvas.note(0, "theta_x", 0.5, 1.0, (3.0, -8.0))
        canvas.figure.text(0.5, 0.5, "in the middle", fontsize=4)
        text = canvas.svg()
        assert all(f">{word}</text>" in text for word in ("a note", "a text", "θx", "in the middle"))
        sizes = [float(size) for size in re.findall(r"font-size: ([\d.]+)px", text)]
        # 358 CSS pixels of 390; the view box is in points
        assert len(sizes) > 9 and min(sizes) * 358.0 / (72.0 * width) >= 7.5


def test_the_stamp_is_read_on_a_desk_wherever_a_figure_stands():
    # figures of a diagnosis are three beside each other, 325 pixels each; the opening one of a report stands in 413
    for width, shown_px in ((4.4, 325.0), (7.2, 413.0)):
        canvas = Canvas("T", "C", size=(width, 4.0))
        canvas.line(0, "curve", [0.0, 1.0], [0.0, 1.0])
        canvas.svg("runs 16a2feb9 · seed 1 · bench sim")
        (foot,) = (text for text in canvas.figure.findobj(Text) if text.get_gid() == "stamp")
        assert isinstance(foot, Text) and float(foot.get_fontsize()) * shown_px / (72.0 * width) >= 7.5


def test_axes_have_whole_numbers_and_the_signs_of_their_degrees_of_freedom():
    canvas = Canvas("torque_x → theta_x", "")
    canvas.panel(0, "theta_x", "time (s)", "temperature (K)")
    canvas.line(0, "theta_x", np.arange(5.0), 1e-5 * np.arange(5.0))
    canvas.legend(0)
    labels = re.findall(r">([^<]+)</text>", canvas.svg())
    assert canvas.title == "torque_x → θx"
    assert "θx" in labels and "theta_x" not in labels
    assert "2·10⁻⁵" in labels and not any(re.search(r"\de[-+−]?\d", label) for label in labels)


def test_a_legend_outside_covers_no_panel_and_a_long_stamp_stays_within_the_figure():
    canvas = Canvas("t", "", columns=2, size=(7.2, 3.4))
    for i in range(2):
        canvas.panel(i, f"panel {i}", "x", "y")
        for name in ("bench, 0.71 %", "a curve with a name that is long", f"only here {i}"):
            canvas.line(i, name, np.arange(5.0), np.arange(5.0))
    canvas.legend_outside()
    stamp = "runs " + ", ".join(["16a2feb9"] * 14) + " · seed 1 · bench sim"
    text = canvas.svg(stamp)
    (legend,) = canvas.figure.legends
    names = [one.get_text() for one in legend.get_texts()]
    assert names == ["bench, 0.71 %", "a curve with a name that is long", "only here 0", "only here 1"]
    renderer = FigureCanvasAgg(canvas.figure).get_renderer()
    box, page = legend.get_window_extent(renderer), canvas.figure.bbox
    assert not any(box.overlaps(axes.get_window_extent(renderer)) for axes in canvas.axes)
    assert page.x0 <= box.x0 and box.x1 <= page.x1
    (foot,) = canvas.figure.findobj(lambda one: one.get_gid() == "stamp")
    assert foot.get_window_extent(renderer).x1 <= page.x1 and text.count("16a2feb9") >= 14


@pytest.mark.parametrize("size", [(7.2, 3.6), (7.2, 4.4), (7.2, 6.0), (4.0, 4.0)])
@pytest.mark.parametrize("aspect", ["equal", "auto"])
def test_the_stamp_lies_below_all_labels(size, aspect):
    canvas = Canvas("T", "C", columns=2, size=size, share_x=True, share_y=True)
    for i in range(2):
        axes = canvas.panel(i, f"position {i + 1}: 8.5 mrad, 99.12 % inside", "θx offset (µrad)", "θy offset (µrad)")
        canvas.points(i, "samples", [-1.0, 1.0], [1.0, -1.0])
        axes.set_aspect(aspect)
    canvas.legend_outside()
    canvas.svg("runs 16a2feb9 · seed 1 · bench sim")
    (foot,) = canvas.figure.findobj(lambda one: one.get_gid() == "stamp")
    top_px = foot.get_window_extent().y1
    # three points (72 to an inch) are matplotlib's own distance between neighbours
    assert all(axes.xaxis.label.get_window_extent().y0 > top_px + 3.0 for axes in canvas.axes)


@pytest.mark.parametrize("title", ("θx", "point_3", "a long name of axis"))
def test_a_legend_above_a_panel_leaves_the_title_free(title: str) -> None:
    canvas = Canvas("legend", "", rows=2, size=(4.8, 3.9))
    axes = canvas.panel(0, title, "", "position (µm)")
    for name in ("measured", "as given", "adjusted", "extended"):
        canvas.line(0, name, np.arange(5.0), np.arange(5.0))
    canvas.legend_above(0, 4)
    canvas.svg()  # small letters are enlarged there
    FigureCanvasAgg(canvas.figure).draw()
    legend = axes.get_legend()
    (name_of_panel,) = (text for text in axes.get_children() if isinstance(text, Text) and text.get_text() == title)
    assert legend is not None
    assert not legend.get_window_extent().overlaps(name_of_panel.get_window_extent())
