"""A page runs its own scripts alone, says so to the browser, and the browser holds to it."""

from __future__ import annotations

import base64
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from analysis.pages.canvas import Canvas
from analysis.pages.environment import page_environment
from analysis.pages.svg import inlined
from analysis.report.page import FigurePart, render_page
from tests import headless

OUTSIDE = "https://192.0.2.1/x"
INJECTED = {
    "a script": '<script>document.title = "taken"</script>',
    "a handler": "<img src=x onerror=\"document.title = 'taken'\">",
    "a link": "<a id=link href=\"javascript:void(document.title = 'taken')\">x</a>",
    "a file": f'<script src="{OUTSIDE}"></script>',
    "a frame": f'<iframe src="{OUTSIDE}"></iframe>',
    "a style": "<style>body { display: none }</style>",
    "an attribute": '<p id=styled style="color: rgb(1, 2, 3)">x</p>',
    "a picture": f'<img src="{OUTSIDE}">',
}


class Elements(HTMLParser):
    """The scripts and styles of a page, by the digest that a browser takes of them, and all style attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.digests: list[str] = []
        self.policy = self.before = ""
        self.styled: list[str] = []
        self._open: str | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.styled += [tag] if "style" in found else []
        if found.get("http-equiv") == "Content-Security-Policy":
            self.policy, self.before = found["content"] or "", ",".join(self.digests)
        self._open = tag if tag in ("script", "style") and found.get("type") != "application/json" else None

    def handle_data(self, data: str) -> None:
        if self._open:
            digest = base64.b64encode(hashlib.sha256(data.encode()).digest()).decode()
            self.digests.append(f"{self._open}-src 'sha256-{digest}'")

    def handle_endtag(self, _tag: str) -> None:
        self._open = None


def figure(folder: Path) -> FigurePart:
    canvas = Canvas("Title", "caption")
    canvas.panel(0, 'a style="fill: red" b', "x", "y")
    canvas.line(0, "curve", np.arange(10.0), np.arange(10.0) ** 2)
    return FigurePart("6.5", "Title", "caption", canvas.svg("stamp"), folder / "f.svg", (), canvas.numbers())


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("page")
    return render_page([], {}, {"6.5": figure(folder)}, [])


def test_all_that_a_page_has_is_in_the_policy_that_comes_first(page):
    found = Elements(page)
    rules = dict(rule.split(" ", 1) for rule in found.policy.split("; "))
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert rules["img-src"] == "data:"
    assert "unsafe" not in found.policy and "*" not in found.policy
    assert found.before == ""
    allowed = {f"{kind} {digest}" for kind, digests in rules.items() for digest in digests.split()}
    assert len(found.digests) == 2 and set(found.digests) <= allowed
    assert found.styled == []


@pytest.mark.parametrize(
    "package", ["analysis.design", "analysis.live", "analysis.report", "analysis.diagnosis.answer"]
)
def test_no_page_brings_scripts_or_styles_but_files_of_the_package(package):
    environment = page_environment(package)
    assert environment.loader is not None
    for name in environment.list_templates(extensions=["j2"]):
        source = environment.loader.get_source(environment, name)[0]
        assert not re.search(r"<style|<script(?! type=\"application/json\")|\bstyle=|\son\w+=", source), name
        if "<head>" in source:
            own = set(re.findall(r'element\("(.*?)"\)', source))
            (policy,) = re.findall(r"policy\((.*?)\)", source)
            assert own == set(re.findall(r'"(.*?)"', policy))


def test_a_figure_on_a_page_has_attributes_for_its_styles_and_keeps_its_texts(tmp_path):
    drawn = figure(tmp_path).svg
    shown = inlined(drawn, "f", "Title")
    assert 'a style="fill: red" b' in shown
    assert not re.search(r"<[^>]*\sstyle=|<style", shown)
    assert shown.count('stroke-linecap="square"') == drawn.count("stroke-linecap: square") > 0


needs_browser = pytest.mark.skipif(
    headless.installed() is None, reason="no Chromium is installed; MCCD_BROWSER may name one"
)


@pytest.fixture(scope="module")
def browser():
    with headless.browser() as tab:
        yield tab


@needs_browser
def test_the_page_itself_meets_its_policy(browser, page, tmp_path):
    (tmp_path / "page.html").write_text(page, encoding="utf-8")
    browser.open(tmp_path / "page.html")
    assert browser.complaints() == []
    # a line of an axis ends as Matplotlib has it, and a page's own styles are applied
    assert browser.run(
        "[...document.querySelectorAll('svg path')].some(p => getComputedStyle(p).strokeLinecap == 'square')"
    )
    assert browser.run("getComputedStyle(document.querySelector('figure svg')).display") == "block"


@needs_browser
@pytest.mark.parametrize("what", INJECTED)
def test_what_finds_its_way_into_a_page_does_nothing(browser, page, tmp_path, what):
    path = tmp_path / "page.html"
    path.write_text(page.replace("</body>", f"{INJECTED[what]}</body>"), encoding="utf-8")
    browser.open(path)
    title = browser.run(
        "document.querySelector('#link')?.click(); new Promise(r => setTimeout(() => r(document.title), 50))"
    )
    assert title.startswith("Test campaign")
    assert browser.run("getComputedStyle(document.body).display") == "block"
    assert browser.run("getComputedStyle(document.querySelector('#styled') ?? document.body).color") != "rgb(1, 2, 3)"
    # what was asked for is told, sent or not
    told = [e["params"] for e in browser.events if e.get("method", "").startswith("Network.")]
    asked = {p["requestId"] for p in told if p.get("request", {}).get("url") == OUTSIDE}
    assert asked <= {p["requestId"] for p in told if p.get("blockedReason") == "csp"}
    assert any("Content Security Policy" in text for text in browser.complaints()), browser.complaints()
