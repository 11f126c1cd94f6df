import re
from xml.etree import ElementTree

from analysis.pages.canvas import COLOURS, INK, Canvas
from analysis.pages.svg import inlined


def made(prefix="f1"):
    canvas = Canvas("T", "C")
    canvas.panel(0, "panel", "x", "y")
    canvas.points(0, "dots", [0.0, 1.0], [1.0, 2.0], color=COLOURS[0])
    return inlined(canvas.svg("runs <a> & b"), prefix, "Figure 1: T")


def test_it_is_one_element_without_prolog_or_fixed_size():
    svg = made()
    root = ElementTree.fromstring(svg)
    assert root.tag.endswith("svg")
    assert root.get("aria-label") == "Figure 1: T"
    assert root.get("width") is None and root.get("viewBox")
    assert "<!DOCTYPE" not in svg and "<metadata>" not in svg


def test_names_are_its_own_and_every_reference_finds_one():
    svg = made("f6-5")
    names = re.findall(r'\bid="([^"]+)"', svg)
    assert len(names) == len(set(names))
    assert all(name.startswith("f6-5-") for name in names)
    wanted = re.findall(r'href="#([^"]+)"', svg) + re.findall(r"url\(#([^)]+)\)", svg)
    assert wanted and set(wanted) <= set(names)


def test_colours_are_those_of_the_page():
    svg = made()
    assert INK not in svg and COLOURS[0] not in svg
    assert "currentColor" in svg and "var(--curve-1)" in svg


def test_the_stamp_is_escaped():
    assert "runs &lt;a&gt; &amp; b" in made()
