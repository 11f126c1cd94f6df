"""The page in a real browser: it asks for nothing, its controls work, and it shows the numbers of the JSON."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.pages.canvas import Canvas
from analysis.pages.explorer import Explorer, Facts, Panel, Series, View
from analysis.paper.numbers import PaperNumber, PaperTable
from analysis.paper.rows import Ours, build_table, label_counts
from analysis.report.page import FigurePart, render_page
from tests import headless

pytestmark = pytest.mark.skipif(
    headless.installed() is None, reason="no Chromium is installed; MCCD_BROWSER may name one"
)

EVIL = '</script><script>document.title="taken"</script><img src="http://192.0.2.1/x" onerror="document.title=1">'
SHIFT = 8


def explorer() -> Explorer:
    """Two choices; a log axis; names that try to break out of the page."""
    f = np.geomspace(1.0, 1000.0, 301)
    views: dict[tuple[str, ...], View] = {}
    for axis, gain in (("θx", 1.0), ("θy", 2.0)):
        for form in ("up", EVIL):
            curve = Series.of("model & <b>", f, 20.0 * np.log10(gain / np.abs(1.0 + 1j * f / 30.0)))
            points = Series.of("sweep", f[::30], curve.y[::30] + 0.5, "points")
            panel = Panel("frequency (Hz)", "magnitude (dB)", (points, curve), log_x=True, band=(-3.0, 3.0, "±3 dB"))
            views[axis, form] = View((panel,), Facts(("mode", "frequency (Hz)"), (("1", (30.125 * gain, None)),)))
    return Explorer("bode", "Response " + EVIL, EVIL, {"axis": ("θx", "θy"), "form": ("up", EVIL)}, views, ("0" * 32,))


def table():
    shared: dict[str, Any] = {"label": "predicted", "tolerance": 0.4, "why": EVIL, "requirement": 5.0}
    rows = (
        PaperNumber(key="a", row="settling", unit="ms", value=5.6, **shared),
        PaperNumber(key="b", row=EVIL, unit="ms", value=None, **shared),
        PaperNumber(key="c", row="shown only", unit="ms", value=2.0, **{**shared, "requirement": None}),
    )
    return build_table(
        "6.6",
        PaperTable(title="Requirements, and the performance that this bench has", note=EVIL, rows=rows),
        {"a": Ours(0.1 + 0.2, note=EVIL), "c": Ours(2e-3)},
        ("0" * 32,),
    )


def coefficients(folded=True):
    shared: dict[str, Any] = {"label": "input", "unit": "", "why": "rounding"}
    rows = (
        PaperNumber(key="p1", row="p1", value=1.0, tolerance=0.1, **shared),
        PaperNumber(key="p2", row="p2", value=2.1e-9, tolerance=2.1e-10, **shared),
    )
    ours = {"p1": Ours(1.01, 0.02), "p2": Ours(2.2e-9, 3.0e-9)}
    return build_table("6.2", PaperTable(title="Coefficients", note="", rows=rows, folded=folded), ours, ("0" * 32,))


def settled() -> FigurePart:
    canvas = Canvas("Settling", "How it settles.", rows=2, size=(7.2, 5.2))
    for i in range(2):
        canvas.panel(i, "θx", "time (ms)", "error (µrad)")
        canvas.line(i, "hybrid: 5.6 ms", np.arange(60.0), np.exp(-np.arange(60.0) / 9.0))
        canvas.legend(i)
        canvas.note(i, "29.6 Hz", 30.0, 1.0, (3.0, -8.0))
    return FigurePart("6.15", "Settling", "How it settles.", canvas.svg("stamp"), Path("f.svg"), (), canvas.numbers())


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "index.html"
    tables = {"6.2": coefficients(), "6.6": table()}
    path.write_text(render_page([], tables, {"6.15": settled()}, [], [explorer()]), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser():
    with headless.browser() as tab:
        yield tab


@pytest.fixture(params=[(1400, "light"), (390, "dark")], ids=["desk", "phone"])
def tab(browser, page, request):
    width, scheme = request.param
    browser.open(page, width=width, prefers_color_scheme=scheme)
    return browser


def shown_x(tab) -> list[float]:
    """The x of every value that the table under the plot lists."""
    tab.run("document.querySelector('.explorer details').open = true")
    cells = "[...document.querySelectorAll('.values tbody tr')].map(r => r.cells[2].textContent)"
    return [float(text.replace("−", "-")) for text in tab.run(f"new Promise(r => setTimeout(() => r({cells}), 50))")]


def button(tab, name: str) -> None:
    tab.run(f"document.querySelector('button[aria-label=\"{name}\"]').click()")


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (1400, "dark"), (390, "light"), (390, "dark")])
def test_it_loads_without_errors_and_asks_for_nothing_but_itself(browser, page, width, scheme):
    browser.open(page, width=width, prefers_color_scheme=scheme)
    assert browser.complaints() == []
    assert browser.requests() == [page.resolve().as_uri()]
    for folded in (True, False):
        # the page itself never scrolls sideways; wide tables do so on their own
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert headless.cut_off(browser) == []
        if folded:
            browser.run("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    ground = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, ground[4:-1].split(","))) > 3 * 128) == (scheme == "light")


def test_text_from_data_stays_text(tab):
    assert tab.run("document.title").startswith("Test campaign")
    assert tab.run("document.querySelectorAll('img, script[src]').length") == 0
    for where in ("#explore-bode h3", "#explore-bode .remark", "option:nth-child(2)", "th small"):
        assert EVIL in tab.run(f"[...document.querySelectorAll('{where}')].map(e => e.textContent).join(' ')"), where


def test_the_numbers_on_the_page_are_those_of_the_json(tab):
    cells = tab.run("[...document.querySelectorAll('#verdict td.ours data')].map(e => e.value)")
    assert [float(c) if c else None for c in cells] == [row["ours"] for row in table().as_json()]
    assert tab.run("document.querySelector('#verdict td.ours data').textContent") == "300.0"
    data = tab.run("document.querySelector('.explorer script').textContent")
    assert json.loads(data) == json.loads(json.dumps(explorer().as_json()))
    facts = tab.run("[...document.querySelectorAll('.facts data')].map(e => e.value)")
    assert facts == ["30.125", ""]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_verdict_and_the_settling_picture_are_on_the_first_screen(browser, page, scheme):
    place = "(() => {{ const r = document.querySelector(`{}`).getBoundingClientRect(); return [r.top, r.bottom] }})()"
    browser.open(page, width=1400, height=900, prefers_color_scheme=scheme)
    assert browser.run(place.format("#verdict .lead"))[1] < 900
    assert browser.run(place.format("[id='figure-6.15'] svg"))[1] < 900
    assert browser.run("document.querySelectorAll('[id=\"figure-6.15\"]').length") == 1
    browser.open(page, width=390, height=844, prefers_color_scheme=scheme)
    assert browser.run(place.format("#verdict .lead"))[1] < 844


@pytest.mark.parametrize("width", [1400, 1000, 768, 390])
def test_every_text_of_every_figure_is_large_enough_to_be_read(browser, page, width):
    browser.open(page, width=width)
    # 7.5 CSS pixels are 2 mm on a telephone
    assert headless.small_print(browser) >= 7.5


@pytest.mark.parametrize("width", [1400, 390])
def test_whether_a_requirement_is_met_is_seen_without_scrolling(browser, page, width):
    browser.open(page, width=width)
    seen = browser.run(
        "[...document.querySelectorAll('#verdict .met')].filter(e => e.checkVisibility()).map(e => {"
        "const r = e.getBoundingClientRect(); return [e.textContent, r.left >= 0 && r.right <= innerWidth]})"
    )
    # one row was measured against a limit, one without, one not at all
    assert seen == [["missed", True], ["no requirement", True]]


def test_coefficients_are_folded_and_what_is_more_uncertain_than_itself_is_not_determined(tab):
    assert tab.run("document.querySelector('[id=\"table-6.2\"] details.folded').open") is False
    assert "2 coefficients, of which 1 agree" in tab.run("document.querySelector('details.folded summary').textContent")
    marks = tab.run("[...document.querySelectorAll('details.folded td.mark')].map(e => e.textContent)")
    assert marks == ["✓ yes", "not determined"]
    assert [row.ok for row in coefficients().rows] == [True, None]
    assert label_counts([coefficients(folded=False)])["input"] == (1, 0, 0, 1)


def test_no_two_of_eight_curves_look_alike(browser, tmp_path):
    x = np.arange(10.0)
    series = tuple(Series.of(f"curve {k}", x, x + k) for k in range(8))
    dots = tuple(Series.of(f"dots {k}", x, x + k, "points") for k in range(8, 15))
    view = View((Panel("x", "y", series + dots),), Facts(("a",), ()))
    path = tmp_path / "index.html"
    path.write_text(render_page([], {}, {}, [], [Explorer("e", "t", "r", {"c": ("one",)}, {("one",): view})]), "utf-8")
    browser.open(path)
    assert browser.complaints() == []
    looks = browser.run(
        "[...document.querySelectorAll('.panel path.curve')].map(e => [getComputedStyle(e).stroke, "
        "e.getAttribute('stroke-dasharray')].join(' '))"
    )
    assert len(looks) == len(set(looks)) == 8
    dashes = browser.run(
        "[...document.querySelectorAll('.panel path.curve')].map(e => e.getAttribute('stroke-dasharray'))"
    )
    assert len(set(dashes[:7])) == 7
    marks = browser.run("[...document.querySelectorAll('.panel path.dot')].map(e => e.getAttribute('d'))")
    assert len(set(marks)) == 6 and browser.run("document.querySelectorAll('.panel circle').length") == 10


def test_choosing_shows_the_other_view(tab):
    assert tab.run("document.querySelector('.facts data').textContent") == "30.13"
    tab.choose(".explorer select", "θy")
    assert tab.run("document.querySelector('.facts data').value") == "60.25"


def test_a_box_hides_its_curve(tab):
    count = "document.querySelectorAll('.panel circle').length"
    assert tab.run(count) == 11
    tab.run("document.querySelector('.legend input').click()")
    assert tab.run(count) == 0
    assert tab.run("document.querySelectorAll('.panel path.curve').length") == 1


def test_the_buttons_zoom_move_and_reset(tab):
    everything = shown_x(tab)
    button(tab, "Zoom in")
    middle = shown_x(tab)
    # half of three decades about their middle
    assert min(middle) == pytest.approx(10.0**0.75, rel=0.03) and max(middle) == pytest.approx(10.0**2.25, rel=0.03)
    button(tab, "Move right")
    assert max(shown_x(tab)) == pytest.approx(10.0 ** (2.25 + 0.375), rel=0.03)
    button(tab, "Zoom out")
    button(tab, "Show everything")
    assert shown_x(tab) == everything


def test_dragging_zooms_to_what_was_marked(tab):
    area = tab.run(
        "{const e = document.querySelector('.panel'); e.scrollIntoView({behavior: 'instant', block: 'center'});"
        "const a = e.getBoundingClientRect(), f = e.querySelector('.frame');"
        "[a.left + +f.getAttribute('x'), a.top + +f.getAttribute('y'), +f.getAttribute('width')]}"
    )
    left, top, width = area
    tab.drag((left + width / 3, top + 40), (left + 2 * width / 3, top + 42))
    found = shown_x(tab)
    assert min(found) == pytest.approx(10.0, rel=0.05) and max(found) == pytest.approx(100.0, rel=0.05)


def test_everything_can_be_done_by_keyboard(tab):
    tab.run("document.querySelector('.explorer select').focus()")
    places = []
    for _ in range(10):
        tab.key("Tab", 9)
        places.append(tab.run("document.activeElement.className || document.activeElement.ariaLabel || ''"))
    assert places.index("Zoom in") < places.index("canvas")
    tab.run("document.querySelector('.canvas').focus()")
    tab.key("+", 187)
    assert min(shown_x(tab)) > 5.0
    tab.run("document.querySelector('.canvas').focus()")
    tab.key("ArrowRight", 39, SHIFT)
    said = tab.run("document.querySelector('output').textContent")
    # the next point of the sweep after the middle of the axis
    assert "frequency (Hz): 63.1" in said and "model & <b> −" in said
    tab.key("0", 48)
    assert min(shown_x(tab)) == 1.0


def test_whoever_hears_the_page_is_told_what_there_is(tab):
    labels = tab.run("[...document.querySelectorAll('svg.panel')].map(e => e.getAttribute('aria-label'))")
    assert labels == ["magnitude (dB) over frequency (Hz): sweep (11 points), model & <b> (301 points)"]
    assert headless.nameless(tab) == 0
    tree = tab.call("Accessibility.getFullAXTree")["nodes"]
    roles = {node["role"]["value"] for node in tree if not node.get("ignored")}
    assert {"table", "columnheader", "rowheader", "combobox", "checkbox", "button", "main", "navigation"} <= roles


def test_text_is_readable_on_its_ground_in_both_schemes(browser, page):
    for scheme in ("light", "dark"):
        browser.open(page, prefers_color_scheme=scheme)
        # WCAG 2, level AA, for text of any size
        assert headless.least_contrast(browser) >= 4.5, scheme


def test_the_reader_may_choose_light_or_dark(browser, page):
    ground = "getComputedStyle(document.body).backgroundColor"
    browser.open(page, prefers_color_scheme="light")
    before = browser.run(ground)
    browser.run(
        "{const s = document.querySelector('.colours select'); s.value = 'dark'; s.dispatchEvent(new Event('change'))}"
    )
    assert browser.run(ground) != before
    # the browser writes its storage from another process, a moment later on a busy machine: no reader returns sooner
    end = time.monotonic() + 5.0
    browser.open(page, prefers_color_scheme="light")
    while browser.run(ground) == before and time.monotonic() < end:
        time.sleep(0.2)
        browser.open(page, prefers_color_scheme="light")
    assert browser.run(ground) != before  # remembered
    browser.run("localStorage.clear()")


def test_it_prints_without_its_controls_and_with_whole_tables(browser, page):
    tab = browser
    tab.open(page, width=720)  # a sheet of A4 less its margins
    tab.call("Emulation.setEmulatedMedia", media="print")
    assert tab.run("document.querySelector('#verdict table').offsetWidth") <= 720
    assert tab.run("getComputedStyle(document.querySelector('.controls')).display") == "none"
    assert tab.pdf().startswith(b"%PDF")
