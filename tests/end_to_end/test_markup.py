"""Markup, formulas and paths in names, labels and identities come out as the text that they are, wherever shown."""

from __future__ import annotations

import hashlib
import json
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.diagnosis.nominal.responses import simulate
from campaigns.log import Channel, LogWriter
from mccdcli.main import main
from sim_backend.linear import played
from sim_backend.model import Mode, Model, Port, dump_model
from tests.small_bench import NOISE, bench_model

IMAGE = """<img src=x onerror=alert(1)> "' $\\frac{a$ {{7*7}} & %s"""
SCRIPT = "</script></style></title><script>alert(2)</script>"
COMMENT = "--><svg onload=alert(3)>"
MAY_STAND = {"application/json"}
RATE_HZ = 1000.0


class Page(HTMLParser):
    """Whatever a browser would make of a page: elements with their attributes, scripts, and all text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[str, str]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] == "script":
            self.scripts.append((self.elements[-1][1].get("type") or "", data))
        self.text += data


def assert_harmless(page: Page) -> None:
    """Nothing on the page runs or loads but what the page itself brings."""
    for tag, attributes in page.elements:
        assert tag not in {"img", "iframe", "object", "embed", "base", "form", "link", "meta"} or tag == "meta"
        assert not [name for name in attributes if name.startswith("on")]
        for name in ("href", "src", "xlink:href"):
            assert not (attributes.get(name) or "").lower().startswith(("javascript:", "data:", "http:", "//"))
    for kind, script in page.scripts:
        assert kind in MAY_STAND or "alert(" not in script


def test_the_check_can_fail() -> None:
    for evil in (IMAGE, SCRIPT, COMMENT):
        with pytest.raises(AssertionError):
            assert_harmless(Page(f"<p>{evil}</p>"))


def assert_drawings_harmless(folder: Path) -> None:
    drawings = list(folder.rglob("*.svg"))
    assert drawings
    for path in drawings:
        for element in ET.fromstring(path.read_text(encoding="utf-8")).iter():
            assert element.tag.rpartition("}")[2] not in {"script", "image", "foreignObject", "a"}
            assert not [name for name in element.attrib if name.startswith("on")]


def files_of(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return folder


def evil_model(dof: str) -> Model:
    """One oscillator, every text of whose file is hostile."""
    u, y = f"u {IMAGE}", f"y {IMAGE}"
    mode = Mode(label=SCRIPT + IMAGE, frequency_hz=30.0, decay_rate_1_s=10.0, input={u: 1.0}, output={y: 1.0})
    return Model(
        name=SCRIPT + IMAGE,
        title=COMMENT + SCRIPT,
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name=u, unit="N m", dof=dof)],
        outputs=[Port(name=y, unit="rad", dof=dof)],
        modes=[mode],
    )


def evil_log(path: Path, dof: str) -> None:
    """An oscillator 10 % stiffer than the model's, under steps, with noise of 1e-3 of its motion."""
    rng = np.random.default_rng(0)
    force = np.repeat(rng.normal(size=1500), 4)
    linear = evil_model(dof).linear()
    stiffer = linear.with_(omega_rad_s=1.1**0.5 * linear.omega_rad_s)
    motion = simulate(played(stiffer, RATE_HZ), force[:, None])[:, 0]
    motion += 1e-3 * np.std(motion) * rng.normal(size=motion.size)
    channels = [
        Channel(f"u {IMAGE}", "N m", "input", dof, RATE_HZ),
        Channel(f"y {IMAGE}", "rad", "output", dof, RATE_HZ),
    ]
    bench = {"kind": SCRIPT, "name": COMMENT, "<b>": IMAGE}
    with LogWriter.create(
        path,
        channels,
        test=IMAGE,
        bench=bench,
        configuration=SCRIPT,
        run_uid=IMAGE,
        tool_version=SCRIPT,
        tool_commit=COMMENT,
    ) as log:
        for label, rows in ((SCRIPT, slice(0, 4500)), (f"held-out {COMMENT}", slice(4500, 6000))):
            with log.segment(label, {SCRIPT: IMAGE}):
                log.append({channels[0].name: force[rows], channels[1].name: motion[rows]})


@pytest.mark.parametrize("dof", [IMAGE, SCRIPT, "x/../../../outside", "/absolute"], ids=range(4))
def test_a_diagnosis_shows_markup_as_text_and_stays_in_its_folder(
    here: Path, dof: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log = f"{IMAGE}.h5"
    evil_log(here / log, dof)
    (here / "model.toml").write_text(dump_model(evil_model(dof)), encoding="utf-8")
    before = files_of(here.parent)
    assert main(["diagnose", log, "--model", "model.toml", "-o", "out", "--json"]) in (0, 1)
    assert all(name.startswith("here/out") for name in files_of(here.parent) - before)
    page = Page((here / "out" / "index.html").read_text(encoding="utf-8"))
    assert_harmless(page)
    assert SCRIPT in page.text and IMAGE in page.text  # shown, and {{7*7}} not evaluated
    assert_drawings_harmless(here / "out")
    assert json.loads(capsys.readouterr().out)["schema"] == "mccd-diagnosis/1"


CAMPAIGN = """schema = "mccd-campaign/1"
name = "{name}"
title = '''{title}'''
[[runs]]
name = '''{run}'''
plan = "chop"
settings = {{ cycles = 2 }}
"""


def test_a_report_shows_markup_as_text(here: Path) -> None:
    bench, run = "<img src=x onerror=alert(1)> $\\frac{a$", "<img src=y onerror=alert(4)> {{7*7}}"
    (here / f"{bench}.toml").write_text(dump_model(bench_model(NOISE)), encoding="utf-8")
    text = CAMPAIGN.format(name="evil", title=SCRIPT + IMAGE.replace("'", ""), run=run)
    (here / "evil.toml").write_text(text, encoding="utf-8")
    command = ["report", "--campaign", "evil.toml", "--bench", f"sim:{bench}.toml", "--out", "out"]
    assert main(command) == 0
    # whoever hands over a folder of logs can also write their checksums
    log = here / "out" / "campaign" / f"{run}.h5"
    with h5py.File(log, "r+") as file:
        file.attrs["tool_version"], file.attrs["tool_commit"], file.attrs["run_uid"] = SCRIPT, COMMENT, IMAGE
    digest = hashlib.sha256(log.read_bytes()).hexdigest()
    log.with_name(f"{log.name}.sha256").write_text(f"{digest}  {log.name}\n")
    # and who can write into the folder of results can put links there
    victim = here / "victim"
    victim.write_text("precious")
    linked = [
        path
        for path in (here / "out").rglob("*")
        if path.is_file() and path.suffix in (".html", ".json", ".csv", ".svg", ".tex")
    ]
    linked = [path for path in linked if path.parent.name != "campaign"]
    assert {"index.html", "report.json", "explore.json", "table-6.6.csv"} <= {path.name for path in linked}
    for path in linked:
        path.unlink()
        path.symlink_to(victim)
    assert main(command) == 0
    assert victim.read_text() == "precious"
    assert [path for path in linked if path.is_symlink()] == []
    page = Page((here / "out" / "index.html").read_text(encoding="utf-8"))
    assert_harmless(page)
    # identifiers are cut to eight characters, and whole in what is shown beside the pointer
    for shown in (bench, f"{run}.h5", f"mccd {SCRIPT}", COMMENT[:8], IMAGE[:8]):
        assert shown in page.text
    assert {COMMENT, IMAGE} <= {attributes.get("title") for _, attributes in page.elements}
    assert_drawings_harmless(here / "out")
    for table in (here / "out" / "tables").glob("*.html"):
        assert_harmless(Page(table.read_text(encoding="utf-8")))
