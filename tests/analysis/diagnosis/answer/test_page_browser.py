"""The page of a diagnosis in a real browser: it asks for nothing, answers, and shows the numbers of the JSON."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from analysis.diagnosis.answer.output import document
from analysis.diagnosis.answer.page import write_page
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.records.loading import Source
from analysis.diagnosis.result import Cause, Diagnosis, Domain, Estimate, Gain, NextExperiment, Visible
from sim_backend.effects import make_effect
from sim_backend.model import Mode, Model, Port
from tests import headless

needs_browser = pytest.mark.skipif(
    headless.installed() is None, reason="no Chromium is installed; MCCD_BROWSER may name one"
)

EVIL = '</script><script>document.title="taken"</script><img src="http://192.0.2.1/x" onerror="document.title=1">|'
FILE = EVIL.replace("/", "")
RATE_HZ = 1000.0
ROWS = 8000
VERDICTS = ("named", "ambiguous", "consistent", "unknown")
SHIFT = 8


def two_axes() -> Model:
    """Two axes, the second with a hostile name; 20 Hz each, DC gain 1 rad/N m."""
    square = (2.0 * np.pi * 20.0) ** 2
    return Model(
        name=EVIL,
        title=EVIL,
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="u1", unit="N m", dof="x"), Port(name="u2", unit="N m", dof=EVIL)],
        outputs=[Port(name="y1", unit="rad", dof="x"), Port(name="y2", unit="rad", dof=EVIL)],
        modes=[
            Mode(label=EVIL, frequency_hz=20.0, decay_rate_1_s=6.0, input={"u1": square}, output={"y1": 1.0}),
            Mode(label="2", frequency_hz=20.0, decay_rate_1_s=6.0, input={"u2": square}, output={"y2": 1.0}),
        ],
    )


def found(verdict: str) -> Diagnosis:
    """A made-up diagnosis of two runs, whose second misses most: 50 Hz at 5 µrad on the axis with the hostile name."""
    rng = np.random.default_rng(0)
    records, before, after = [], [], []
    for i in range(2):
        noise = 1e-6 * rng.standard_normal((ROWS, 2))
        tone = 5e-6 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 50.0 * np.arange(ROWS) / RATE_HZ)
        tone[6000:] *= 0.5
        windows = (Window("steps", 0, 6000), Window(f"held-out {EVIL}", 6000, ROWS, held_out=True))
        records.append(Record(f"uid-{i}", rng.standard_normal((ROWS, 2)), rng.standard_normal((ROWS, 2)), windows))
        before.append(noise + np.stack([0.0 * tone, i * tone], axis=1))
        after.append(noise)
    axis = np.array([1e-3, 2e-3, 3e-3])
    weak = Domain("uid-0", "x", axis, "rad", np.array([1.0, 1.1, 0.9]), np.ones(3), 0.4, "x nowhere")
    strong = Domain("uid-1", EVIL, axis, "rad", np.array([1.0, 5.125, 2.0]), np.ones(3), 1e-9, f"{EVIL}: 5.2e+03 times")
    way = Domain("uid-1", EVIL, np.array([-1.0, 1.0]), "sign", np.array([2.0, 3.0]), np.ones(2), 1e-3, "up")
    linear = two_axes().linear()
    named = verdict == "named"
    return Diagnosis(
        verdict=verdict,  # type: ignore[arg-type]
        sentence=f"A sentence with {EVIL}.",
        causes=(Cause("cubic-stiffness", EVIL, 0.97, {"stiffness": Estimate(2.5, 0.125, "N m/rad^3")}, EVIL),)
        if named
        else (),
        ambiguous=(("delay", "amplifier-lag"),) if verdict == "ambiguous" else (),
        evidence={"position": (weak, strong), "direction": (way,), "cross-axis": ()},
        gain=Gain(("uid-1#held-out",), 0.5, 0.1, 0.09, 0.8, (0.78, 0.82)),
        next_experiment=NextExperiment("freerun", {"x": EVIL}, ("delay", "amplifier-lag"), 6.5)
        if verdict == "ambiguous"
        else None,
        data=Dataset(RATE_HZ, tuple(records)),
        nominal=linear,
        linear=linear.with_(omega_rad_s=linear.omega_rad_s * 1.02),
        effects=(make_effect("cubic-stiffness", "x", {"stiffness": 2.5}),) if named else (),
        before=tuple(before),
        after=tuple(after),
        notes=(EVIL, "a number like 3.3e+04"),
        sensitivity=(
            Visible("backlash", "x", "torque", 3.3e4, "N m"),
            Visible("backlash", EVIL, "torque", 2e-5, "N m"),
        ),
        considered=(("backlash", -12.5),),
    )


SOURCES = tuple(Source(f"{name}.h5", "ab" * 32, f"uid-{i}", ROWS) for i, name in enumerate(("quiet", FILE)))


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folders = {verdict: tmp_path_factory.mktemp(verdict) for verdict in VERDICTS}
    return {v: write_page(found(v), two_axes(), SOURCES, folder)["index.html"] for v, folder in folders.items()}


@pytest.fixture(scope="module")
def browser():
    with headless.browser() as tab:
        yield tab


@pytest.fixture(params=[(1400, "light"), (390, "dark")], ids=["desk", "phone"])
def tab(browser, pages, request):
    width, scheme = request.param
    browser.open(pages["named"], width=width, prefers_color_scheme=scheme)
    return browser


def choose(tab, plot: str, name: str, option: str) -> None:
    tab.choose(f"#explore-{plot} select[name={name}]", option)


def facts(tab, plot: str) -> list[list[str]]:
    rows = f"[...document.querySelectorAll('#explore-{plot} .facts tbody tr')]"
    return tab.run(rows + ".map(r => [r.cells[0].textContent, ...[...r.querySelectorAll('data')].map(d => d.value)])")


def seen_x(tab, plot: str) -> list[float]:
    tab.run(f"document.querySelector('#explore-{plot} details').open = true")
    cells = f"[...document.querySelectorAll('#explore-{plot} .values tbody tr')].map(r => r.cells[2].textContent)"
    return [float(t.replace("−", "-")) for t in tab.run(f"new Promise(r => setTimeout(() => r({cells}), 50))")]


@needs_browser
@pytest.mark.parametrize("verdict", VERDICTS)
@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (1400, "dark"), (390, "light"), (390, "dark")])
def test_it_loads_without_errors_and_asks_for_nothing_but_itself(browser, pages, verdict, width, scheme):
    page = pages[verdict]
    browser.open(page, width=width, prefers_color_scheme=scheme)
    assert browser.complaints() == []
    assert browser.requests() == [page.resolve().as_uri()]
    assert browser.run("document.querySelector('.verdict').textContent") == verdict
    for folded in (True, False):
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert headless.cut_off(browser) == []
        if folded:
            browser.run("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    assert browser.run("[...document.querySelectorAll('.canvas')].every(c => c.querySelector('path, rect'))")
    # small print beside a text of 16 pixels
    assert headless.small_print(browser) >= 10.0


def test_links_in_the_folder_are_not_followed(pages, tmp_path):
    victim, folder = tmp_path / "victim", tmp_path / "out"
    victim.write_text("precious")
    (folder / "figures").mkdir(parents=True)
    names = [path.relative_to(pages["named"].parent) for path in pages["named"].parent.rglob("*.*")]
    assert len(names) > 3
    for name in names:
        (folder / name).symlink_to(victim)
        (folder / name).with_name(f".{name.name}.tmp").symlink_to(victim)
    write_page(found("named"), two_axes(), SOURCES, folder)
    assert victim.read_text() == "precious"
    assert not any((folder / name).is_symlink() for name in names)


@needs_browser
def test_text_from_data_stays_text(tab):
    assert tab.run("document.title").startswith("Diagnosis of")
    assert tab.run("document.querySelectorAll('img, script[src]').length") == 0
    for where in (
        ".lead",
        "#explore-residual option",
        "#explore-evidence .note",
        ".cause h3",
        ".surety li",
        "#sensitivity td",
        "th",
    ):
        assert EVIL in tab.run(f"[...document.querySelectorAll('{where}')].map(e => e.textContent).join(' ')"), where


@needs_browser
def test_what_matters_most_is_shown_first_and_its_numbers_are_those_of_the_data(tab):
    chosen = tab.run("[...document.querySelectorAll('#explore-residual select')].map(s => s.value)")
    assert chosen == [f"{FILE}.h5: steps", EVIL, "time"]
    rows = facts(tab, "residual")
    assert [row[0] for row in rows] == ["adjusted", "extended", "noise floor"]
    # 5 µrad of tone and 1 of noise; 6000 rows tell a size to 1 / sqrt(2 · 6000) = 0.9 %, four times that
    assert float(rows[0][1]) == pytest.approx(np.sqrt(26.0), rel=0.037)
    assert float(rows[1][1]) == pytest.approx(1.0, rel=0.037)
    choose(tab, "residual", "segment", "quiet.h5: steps")
    rows = facts(tab, "residual")
    assert float(rows[0][1]) == pytest.approx(float(rows[1][1]))


@needs_browser
def test_the_evidence_is_that_of_the_json(tab):
    curve = document(found("named"), two_axes(), SOURCES)["evidence"]["position"]["curves"][1]
    assert facts(tab, "evidence")[0] == ["adjusted", "5.125", "1e-9"]
    tab.run("document.querySelector('#explore-evidence details').open = true")
    rows = "[...document.querySelectorAll('#explore-evidence .values tbody tr')]"
    cells = f"{rows}.map(r => [...r.cells].map(c => c.textContent))"
    listed = tab.run(f"new Promise(r => setTimeout(() => r({cells}), 50))")
    nominal = [(float(x), float(y)) for _, name, x, y in listed if name == "adjusted"]
    assert nominal == [(1e3 * x, y) for x, y in zip(curve["axis"], curve["level"], strict=True)]
    choose(tab, "evidence", "domain", "by direction")
    assert tab.run("document.querySelectorAll('#explore-evidence .panel g rect').length") >= 2
    axis = tab.run("[...document.querySelectorAll('#explore-evidence .panel text')].map(t => t.textContent)")
    assert {"down", "up"} <= set(axis)


@needs_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_opens_with_measured_and_simulated_and_how_sure_the_answer_is(browser, pages, scheme):
    place = "(() => {{ const r = document.querySelector('{}').getBoundingClientRect(); return [r.top, r.bottom] }})()"
    browser.open(pages["named"], width=1400, height=900, prefers_color_scheme=scheme)
    figure, lead, surety = (
        browser.run(place.format(one)) for one in ("#measured-and-simulated svg", ".lead", ".surety")
    )
    assert figure[1] < 900 and lead[1] < 900 and surety[0] < 900
    assert lead[0] < figure[1]  # beside each other
    # reasons are with the answer, not at the foot
    reasons = browser.run("[...document.querySelectorAll('.surety li')].map(e => e.textContent)")
    assert any("backlash" in one for one in reasons) and any(EVIL in one for one in reasons)
    browser.open(pages["named"], width=390, height=844, prefers_color_scheme=scheme)
    assert browser.run(place.format("#measured-and-simulated svg"))[1] < 844


@needs_browser
@pytest.mark.parametrize("verdict", VERDICTS)
def test_no_number_has_an_exponent_no_chance_is_zero_and_names_of_runs_are_short(browser, pages, verdict):
    browser.open(pages[verdict])
    browser.run("document.querySelectorAll('details').forEach(d => { d.open = true; })")
    for domain in ("by position", "by direction"):
        choose(browser, "evidence", "domain", domain)
        # digests of versions and runs are no numbers, 7e123456 for one
        text = re.sub(r"\b[0-9a-f]{7,12}\b", "", browser.run("document.body.innerText"))
        assert re.findall(r"\d(?:\.\d+)?[eE][+-]?\d+", text) == []
        assert "33,000 N m" in text and "20 µN m" in text
        assert not re.search(r"p = 0(?![.\d])", text)
    assert facts(browser, "evidence")[0][2] != "0"
    runs = browser.run("[...document.querySelectorAll('#inputs td:nth-child(2)')].map(e => e.textContent)")
    assert runs and all(len(one) <= 8 for one in runs)


@needs_browser
def test_the_tiles_are_those_of_the_json_and_do_not_contradict_each_other(tab):
    gain = document(found("named"), two_axes(), SOURCES)["gain"]
    tiles = tab.run("[...document.querySelectorAll('.tiles data')].map(e => [Number(e.value), e.textContent])")
    assert tiles == [[gain["rms_before"], "50.0 %"], [gain["rms_after"], "90.0 %"]]
    words = tab.run("[...document.querySelectorAll('.tiles li')].map(e => e.textContent)")
    # an error of 10 % beside a noise of 9 %: within what counts as noise
    assert words[-1].startswith("noise not known")
    parameters = tab.run("[...document.querySelectorAll('#causes .cause data')].map(e => Number(e.value))")
    assert parameters == [2.5]
    assert "2.50 ± 0.12" in tab.run("document.querySelector('#causes td.ours').textContent")
    rivals = tab.run("[...document.querySelectorAll('#causes details tbody :is(th, td)')].map(e => e.textContent)")
    assert rivals[:2] == ["backlash", "268,000"] and rivals[2].startswith("the residual ")  # exp(12.5)
    sizes = tab.run("[...document.querySelectorAll('#sensitivity data')].map(e => Number(e.value))")
    assert sizes == [one["size"] for one in document(found("named"), two_axes(), SOURCES)["sensitivity"]]


@needs_browser
def test_a_choice_without_data_says_so(tab):
    choose(tab, "evidence", "run", "quiet.h5")
    assert tab.run("document.querySelector('#explore-evidence output').textContent").startswith("Nothing was recorded")
    assert tab.complaints() == []


@needs_browser
def test_zooming_by_drag_and_keyboard_in_time_and_frequency(tab):
    assert max(seen_x(tab, "residual")) == pytest.approx(6.0, abs=0.1)
    area = tab.run(
        "{const e = document.querySelector('#explore-residual .panel');"
        "e.scrollIntoView({behavior: 'instant', block: 'center'});"
        "const a = e.getBoundingClientRect(), f = e.querySelector('.frame');"
        "[a.left + +f.getAttribute('x'), a.top + +f.getAttribute('y'), +f.getAttribute('width')]}"
    )
    left, top, width = area
    tab.drag((left + width / 3, top + 30), (left + 2 * width / 3, top + 32))
    x = seen_x(tab, "residual")
    # a pixel of some thousand is 6 ms
    assert min(x) == pytest.approx(2.0, abs=0.05) and max(x) == pytest.approx(4.0, abs=0.05)
    choose(tab, "residual", "over", "frequency")
    tab.run("document.querySelector('#explore-residual .canvas').focus()")
    tab.key("+", 187)
    x = seen_x(tab, "residual")
    # one stretch of 6000 samples: lines every 1/6 Hz to 500 Hz, the middle half of whose decades is seen
    first = (500.0 * (1.0 / 6.0) ** 3) ** 0.25
    assert 0.98 * first <= min(x) <= first + 1.0 / 6.0
    tab.key("ArrowRight", 39, SHIFT)
    assert "residual (µrad/√Hz): adjusted" in tab.run("document.querySelector('#explore-residual output').textContent")
    tab.key("0", 48)
    assert max(seen_x(tab, "residual")) > 400.0


@needs_browser
def test_the_colours_follow_the_system_until_the_reader_says_otherwise(browser, pages):
    dark = "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number).reduce((a, b) => a + b) < 384"

    def switch(to: str) -> None:
        browser.choose(".colours select", to)

    browser.open(pages["named"], prefers_color_scheme="dark")
    assert browser.run(dark)
    switch("light")
    assert not browser.run(dark)
    browser.open(pages["named"], prefers_color_scheme="dark")
    assert not browser.run(dark) and browser.run("document.querySelector('.colours select').value") == "light"
    switch("dark")
    browser.open(pages["named"], prefers_color_scheme="light")
    assert browser.run(dark)
    switch("system")
    browser.open(pages["named"], prefers_color_scheme="light")
    assert not browser.run(dark)


@needs_browser
def test_the_switch_works_where_nothing_may_be_kept(browser, pages):
    forbidden = (
        "Object.defineProperty(window, 'localStorage', {get() { throw new DOMException('no', 'SecurityError'); }})"
    )
    script = browser.call("Page.addScriptToEvaluateOnNewDocument", source=forbidden)["identifier"]
    try:
        browser.open(pages["named"], prefers_color_scheme="light")
        browser.choose(".colours select", "dark")
        assert browser.run("document.documentElement.dataset.colours") == "dark"
        assert browser.complaints() == []
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=script)


@needs_browser
def test_everything_has_a_name_and_contrast(browser, pages):
    for scheme in ("light", "dark"):
        for verdict in VERDICTS:
            browser.open(pages[verdict], prefers_color_scheme=scheme)
            assert headless.nameless(browser) == 0
            # WCAG 2, level AA, for text of any size
            assert headless.least_contrast(browser) >= 4.5, (verdict, scheme)


@needs_browser
def test_on_paper_every_output_is_shown_and_no_control(browser, pages):
    browser.open(pages["named"], width=720, prefers_color_scheme="dark")
    seen = "getComputedStyle(document.querySelector('{}')).display"
    assert browser.run(seen.format("#residual .still")) == "none"
    browser.call("Emulation.setEmulatedMedia", media="print")
    assert browser.run(seen.format("#residual .still")) == "grid"
    for hidden in (".explorer", ".colours", "nav"):
        assert browser.run(seen.format(hidden)) == "none"
    assert browser.run("document.querySelectorAll('#residual .still figure').length") == 2
    assert browser.run("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert browser.pdf().startswith(b"%PDF")


def test_without_scripts_the_figures_are_there_and_the_controls_are_not(pages):
    page = pages["named"].read_text(encoding="utf-8")
    assert page.count('<section class="explorer"') == page.count(" hidden>\n<h3 id=") == 2
    assert page.count("<figure ") == 5 and '<label class="colours" hidden>' in page


def test_identical_data_give_identical_bytes(pages, tmp_path):
    again = write_page(found("named"), two_axes(), SOURCES, tmp_path)
    first = pages["named"].parent
    for name, path in again.items():
        assert path.read_bytes() == (first / name).read_bytes(), name


def test_hours_of_data_make_a_page_that_can_be_sent(tmp_path):
    rng = np.random.default_rng(1)
    rows, segments = 400_000, 50
    noise = 1e-6 * rng.standard_normal((rows, 2))
    u, y = rng.standard_normal((2, rows, 2))
    cut = np.linspace(0, rows, segments + 1).astype(int)
    windows = tuple(Window(f"part {i}", int(a), int(b)) for i, (a, b) in enumerate(zip(cut[:-1], cut[1:], strict=True)))
    long = dataclasses.replace(
        found("unknown"),
        data=Dataset(RATE_HZ, (Record("uid-0", u, y, windows),)),
        before=(noise,),
        after=(noise,),
        gain=None,
    )
    page = write_page(long, two_axes(), (), tmp_path)["index.html"]
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 3_000_000
    assert (
        "The 24 of 50 segments are listed" in text and "Of 8000 samples the smallest and the largest of every" in text
    )


def test_what_could_have_been_seen_is_told_in_words_with_units(tmp_path):
    seen = (
        Visible("hysteresis", "x", "stiffness_1", 0.0123, "N m/rad", natural=0.615),
        Visible("delay", "x", "seconds", 3.3e-5, "s"),
        Visible("actuator-gain", "x", "relative", 0.119, "1"),
    )
    page = write_page(dataclasses.replace(found("named"), sensitivity=seen), two_axes(), SOURCES, tmp_path)
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page["index.html"].read_text()))
    assert "hysteresis: stiffness of the spring that slips last x: 0.0123 N m/rad (2.00 %)" in text
    assert "delay x: 33 µs" in text
    assert "actuator gain: relative error of the gain x: 11.9 %" in text
