"""`mccd compare`: numbers against those that were put in, refusals, and the page in a real browser."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from analysis.comparison.table import Row
from campaigns.log import Channel, LogWriter
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from mccdcli.main import main
from sim_backend.model import EffectEntry, Mode, Quantity, dump_model
from sim_backend.simbench import SimBench
from tests import headless
from tests.small_bench import NOISE, bench_model

MULTISINE = {
    "axes": ["theta_x"],
    "realisations": 1,
    "period_s": 0.2,
    "transient_periods": 10,  # before that a mode still rings, and how large its response is is not known
    "start_hz": 10.0,
    "stop_hz": 200.0,
}


def compared(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, dict[str, dict[str, Any]]]:
    """Run the command with --json and return the rows by part and name."""
    assert main(["compare", *map(str, words), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    return {part["title"]: {row["what"]: row for row in part["rows"]} for part in found["parts"]}


def models(folder: Path) -> tuple[Path, Path]:
    """Two models that differ in known numbers: a stiffer first mode, one more mode, a delay and an effect."""
    first = bench_model(hardware=False)
    x, *others = first.modes
    harder = msgspec.structs.replace(
        x, frequency_hz=Quantity(value=30.6, std=0.3), decay_rate_1_s=Quantity(value=9.4, std=0.1)
    )
    more = Mode(
        label="high", frequency_hz=900.0, decay_rate_1_s=20.0, input={"torque_x": 10.0}, output={"theta_x": 1.0}
    )
    friction = EffectEntry(effect="coulomb-friction", where="theta_x", parameters={"torque": 1e-3})
    second = msgspec.structs.replace(
        first, name="other", modes=[*others, more, harder], delay_s={"torque_x": 2e-4}, effects=[friction]
    )
    first = msgspec.structs.replace(
        first, modes=[msgspec.structs.replace(x, frequency_hz=Quantity(value=29.6, std=0.4)), *others]
    )
    paths = folder / "a.toml", folder / "b.toml"
    for path, model in zip(paths, (first, second), strict=True):
        path.write_text(dump_model(model), encoding="utf-8")
    return paths


def test_models_show_what_was_changed_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = compared(capsys, *models(tmp_path))
    rows = {name: row for part in found.values() for name, row in part.items()}
    frequency = rows["mode 3 (theta_x), frequency"]
    assert (frequency["first"], frequency["second"]) == (29.6, 30.6)
    assert frequency["sigmas"] == pytest.approx(1.0 / math.hypot(0.4, 0.3))
    damping = rows["mode 3 (theta_x), damping ratio ζ"]
    assert damping["first"] == pytest.approx(4.7 / (2 * math.pi * 29.6))
    assert damping["second"] == pytest.approx(9.4 / (2 * math.pi * 30.6))
    assert (rows["mode 4 (high), frequency"]["first"], rows["mode 4 (high), frequency"]["second"]) == (None, 900.0)
    # the static gain of a mode is participation over ω²
    gain = found["Static gains"]["torque_x → theta_x"]
    assert gain["first"] == pytest.approx((1 / 3.23e-4) / (2 * math.pi * 29.6) ** 2, rel=0.01)
    assert gain["unit"] == "rad per N m"
    assert found["Static gains"]["torque_y → theta_y"]["difference"] == 0.0
    assert "torque_y → theta_x" not in found["Static gains"]  # zero in both
    assert rows["torque_x"]["second"] == pytest.approx(2e-4)
    assert rows["coulomb-friction at theta_x: torque"]["second"] == 1e-3
    assert {name for name, row in found["Modes"].items() if row["difference"]} == {
        "mode 3 (theta_x), frequency",
        "mode 3 (theta_x), damping ratio ζ",
    }


def test_two_names_of_bundled_models_and_one_file_with_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "Modes" in compared(capsys, "design", "design-4th-order")
    path = models(tmp_path)[0]
    rows = [row for part in compared(capsys, path, path).values() for row in part.values()]
    assert rows and all(row["first"] == row["second"] for row in rows)


def runs(folder: Path) -> tuple[Path, Path]:
    """The same excitation on two benches, one with twice the compliance in θx."""
    soft = bench_model(hardware=False)
    x, *others = soft.modes
    hz = 29.6 / math.sqrt(2.0)
    softer = msgspec.structs.replace(soft, modes=[msgspec.structs.replace(x, frequency_hz=hz), *others])
    paths = folder / "stiff.h5", folder / "soft.h5"
    for path, model, note in zip(paths, (soft, softer), ("", "second spring"), strict=True):
        run_plan(make_plan("multisine", MULTISINE), SimBench(model, 5), path, seed=5, note=note)
    return paths


def test_runs_show_headers_statistics_and_responses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stiff, soft = runs(tmp_path)
    found = compared(capsys, stiff, soft)
    assert found["Header"]["note"]["second"] == "second spring"
    assert found["Header"]["test"]["first"] == found["Header"]["test"]["second"] == "multisine"
    assert "Settings that differ" not in found
    std = found["Channels"]["theta_x, std"]
    assert std["unit"] == "rad" and std["second"] != std["first"]
    peaks = next(row for name, row in found["Frequency response"].items() if "largest at" in name)
    # lines of 0.2 s stand 5 Hz apart
    assert peaks["first"] == pytest.approx(29.6, abs=5.0)
    assert peaks["second"] == pytest.approx(29.6 / math.sqrt(2.0), abs=5.0)
    assert peaks["second"] < peaks["first"]


def driven(
    folder: Path, plan: str, settings: dict[str, Any], seeds: tuple[int, int], stiffer: float = 1.0
) -> list[Path]:
    """Two records of one bench with sensor noise, the same excitation; θx of the second is `stiffer`."""
    paths = []
    for seed, factor in zip(seeds, (1.0, stiffer), strict=True):
        bench = bench_model(NOISE)
        x, *others = bench.modes
        x = msgspec.structs.replace(x, frequency_hz=29.6 * math.sqrt(factor))
        paths.append(folder / f"seed-{seed}.h5")
        model = msgspec.structs.replace(bench, modes=[x, *others])
        run_plan(make_plan(plan, settings), SimBench(model, seed), paths[-1], seed=seed)
    return paths


RANDOM = {"axes": ["theta_x"], "steps_s": 1, "noise_s": 4, "held_out_s": 0.5}


def test_two_records_of_one_bench_agree_within_noise_and_what_nothing_drives_is_no_response(tmp_path, capsys):
    both = driven(tmp_path, "freerun", RANDOM, (0, 1))
    page = tmp_path / "page.html"
    assert main(["compare", *map(str, both), "--json", "--out", str(page)]) == 0
    parts = {part["title"]: part for part in json.loads(capsys.readouterr().out)["parts"]}
    (mean,) = (row for row in parts["Frequency response"]["rows"] if "mean magnitude" in row["what"])
    assert abs(mean["difference"]) < 0.01 * mean["first"] and mean["sigmas"] < 3.0
    remark = parts["Frequency response"]["remark"]
    assert "theta_x: A and B agree within noise at" in remark and "known less well" in remark
    assert "Left out" in remark and "theta_y" in remark and "→ z" in remark
    assert all("→ theta_x" in row["what"] or "largest" in row["what"] for row in parts["Frequency response"]["rows"])
    drawn = re.findall(r"<figcaption><b>(.*?)</b>", page.read_text(encoding="utf-8"))
    assert drawn == ["Response command θx → θx."]


def test_a_bench_that_has_changed_differs_by_more_than_noise(tmp_path, capsys):
    both = driven(tmp_path, "freerun", RANDOM, (0, 1), stiffer=1.1)
    assert main(["compare", *map(str, both)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    # a tenth more stiffness is a tenth less motion below the resonance
    assert "θx: A and B differ by more than noise" in said and "agree within noise" not in said


def test_responses_of_two_periods_agree_for_every_seed(tmp_path, capsys):
    # one degree of freedom in each variance: of 160 lines some are far too small by chance
    settings = {"realisations": 1, "period_s": 0.4, "start_hz": 10.0, "stop_hz": 400.0}
    for seed in range(0, 10, 2):
        assert main(["compare", *map(str, driven(tmp_path, "multisine", settings, (seed, seed + 1)))]) == 0
        said = capsys.readouterr().out
        assert said.count("agree within noise") >= 3 and "more than noise" not in said, seed


def test_the_terminal_prints_axes_as_the_page_does(tmp_path, capsys):
    assert main(["compare", *map(str, models(tmp_path))]) == 0
    said = capsys.readouterr().out
    assert "mode 3 (θx), frequency" in said and "Coulomb friction at θx: torque" in said
    assert "theta_" not in said
    assert main(["compare", *map(str, runs(tmp_path))]) == 0
    said = capsys.readouterr().out
    assert "command θx, std" in said and "command θx → θx, " in said and "theta_" not in said


def test_runs_without_excitation_say_why_there_is_no_response(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    channels = [Channel("u", "N m", "input", "x", 1e3), Channel("y", "rad", "output", "x", 1e3)]
    for name, mean in (("a.h5", 1.0), ("b.h5", 3.0)):
        with LogWriter.create(tmp_path / name, channels, test="rest", bench={"kind": "sim"}) as log, log.segment("all"):
            log.append({"u": np.zeros(2000), "y": mean + np.resize([-1.0, 1.0], 2000)})
    assert main(["compare", str(tmp_path / "a.h5"), str(tmp_path / "b.h5"), "--json"]) == 0
    parts = {part["title"]: part for part in json.loads(capsys.readouterr().out)["parts"]}
    assert parts["Frequency response"]["rows"] == [] and parts["Frequency response"]["remark"].startswith(
        "None is compared"
    )
    rows = {row["what"]: row for row in parts["Channels"]["rows"]}
    assert (rows["y, mean"]["first"], rows["y, mean"]["second"]) == (1.0, 3.0)
    assert rows["y, std"]["first"] == rows["y, std"]["second"] == 1.0


def diagnosis(folder: Path, verdict: str, **changed: object) -> Path:
    """Write the part of a diagnosis that is compared; the rest of its file is not looked at."""
    cause = {
        "effect": "coulomb-friction",
        "where": "theta_x",
        "probability": 0.95,
        "parameters": {"torque": {"value": 1e-3, "std": 3e-5, "unit": "N m"}},
    }
    content = {
        "schema": "mccd-diagnosis/1",
        "verdict": verdict,
        "sentence": f"It is {verdict}.",
        "causes": [cause] if verdict == "named" else [],
        "ambiguous": [],
        "gain": {"rms_before": 0.1, "rms_after": 0.02, "noise_floor": 0.01, "reduction": 0.8},
        "inputs": [{"file": "night.h5"}],
        "evidence": {
            "frequency": {
                "curves": [{"record": "r", "output": "θx", "unit": "Hz", "axis": [1.0, 10.0], "level": [1.0, 9.0]}]
            },
            "time": {},
        },
    } | changed
    folder.mkdir(exist_ok=True)
    (folder / "diagnosis.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


def test_diagnoses_show_verdict_cause_parameters_and_gain(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, second = diagnosis(tmp_path / "a", "consistent"), diagnosis(tmp_path / "b", "named", gain=None)
    found = compared(capsys, first, second / "diagnosis.json")
    assert (found["Answer"]["verdict"]["first"], found["Answer"]["verdict"]["second"]) == ("consistent", "named")
    assert found["Answer"]["causes"]["second"] == "coulomb-friction at theta_x"
    torque = found["Causes"]["coulomb-friction at theta_x: torque"]
    assert (torque["first"], torque["second"], torque["unit"]) == (None, 1e-3, "N m")
    (gains,) = (part for title, part in found.items() if title.startswith("Error on held-out"))
    assert gains["before"]["first"] == pytest.approx(10.0) and gains["before"]["second"] is None


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("a.toml", "a.h5"), 2, "a.toml is a model and a.h5 a run; give two of one kind"),
        (("nothing", "a.toml"), 2, "nothing does not exist, nor is it a bundled model"),
        (("text.txt", "a.toml"), 2, "text.txt is none of these"),
        (("broken.toml", "a.toml"), 2, "not valid TOML"),
        (("other.json", "old"), 2, "other.json"),
        (("cut.json", "a.toml"), 2, "in double quotes: line 1 column 28 (char 27); correct it there"),
        (("cut/diagnosis.json", "old"), 4, "cut/diagnosis.json: not valid JSON"),
        (("old", "old"), 4, "is not a diagnosis of the format mccd-diagnosis/1"),
        (("short", "short"), 4, "short/diagnosis.json: Object missing required field"),
        (("foreign.h5", "foreign.h5"), 4, "foreign.h5"),
    ],
)
def test_what_cannot_be_compared_is_told_in_one_line(
    words: tuple[str, ...], code: int, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    models(tmp_path)
    with LogWriter.create("a.h5", [Channel("u", "N m", "input", "x", 1e3)], test="t", bench={}) as log:
        log.append({"u": [0.0]})
    Path("text.txt").write_text("text")
    Path("broken.toml").write_text("[[[")
    Path("other.json").write_text('{"some": "thing"}')
    diagnosis(tmp_path / "old", "named", schema="mccd-diagnosis/0")
    Path("cut.json").write_text('{"schema": "mccd-model/1", ')
    Path("cut").mkdir()
    Path("cut/diagnosis.json").write_text('{"schema": "mccd-diag')
    Path("short").mkdir()
    Path("short/diagnosis.json").write_text('{"schema": "mccd-diagnosis/1"}')
    import h5py

    with h5py.File("foreign.h5", "w") as file:
        file["data"] = [1.0]
    assert main(["compare", *words]) == code
    out, err = capsys.readouterr()
    assert says in err and err.count("\n") == 1 and out == ""


@pytest.mark.parametrize("out", ["a.toml", "b.toml", "link.toml", "report.html", "old/diagnosis.json", "text.txt"])
def test_a_page_takes_the_place_of_no_other_file(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    models(tmp_path)
    Path("link.toml").symlink_to("a.toml")
    Path("report.html").write_text("<!doctype html>\n<html><p>mine</p></html>\n")
    Path("text.txt").write_text("text")
    diagnosis(tmp_path / "old", "named")
    before = Path(out).read_bytes()
    assert main(["compare", "a.toml", "b.toml", "--out", out]) == 2
    assert f"{out} exists and is not a page of `mccd compare`; give another name" in capsys.readouterr().err
    assert Path(out).read_bytes() == before and Path("link.toml").is_symlink()


def test_a_page_replaces_an_earlier_one_and_its_folder_is_asked_for_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    models(tmp_path)
    assert main(["compare", "a.toml", "b.toml", "--out", "page.html"]) == 0
    assert main(["compare", "a.toml", "a.toml", "--out", "page.html"]) == 0
    assert "<h1>a.toml and a.toml</h1>" in Path("page.html").read_text(encoding="utf-8")
    capsys.readouterr()
    # neither of the two is looked at where the page has no place
    assert main(["compare", "no.toml", "none.toml", "--out", "nowhere/page.html"]) == 4
    assert "nowhere/page.html: No such file or directory" in capsys.readouterr().err


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("first", "second", "differs", "texts"),
    [
        (NAN, 1.0, True, ("NaN", "1.000")),
        (1.0, INF, True, ("1.000", "∞")),
        (-INF, INF, True, ("-∞", "∞")),
        (INF, NAN, True, ("∞", "NaN")),
        (NAN, None, True, ("NaN", "—")),
        (NAN, NAN, False, ("NaN", "NaN")),
        (INF, INF, False, ("∞", "∞")),
        (1, INF, True, ("1", "∞")),
        (1.0, 1.0 + 1e-12, False, ("1.000", "1.000")),
    ],
)
def test_what_is_no_finite_number_differs_from_one(
    first: float | None, second: float | None, differs: bool, texts: tuple[str, str]
) -> None:
    row = Row("value", first, second)
    assert row.differs is differs
    assert row.texts()[1:4] == (*texts, "")


@pytest.fixture(scope="module")
def browser() -> Iterator[headless.Tab]:
    with headless.browser() as tab:
        yield tab


PAGES = {"model": models, "run": runs}


@pytest.mark.parametrize("kind", ["model", "run", "diagnosis"])
def test_the_page_shows_the_rows_of_the_json_and_asks_for_nothing(kind: str, tmp_path: Path, capsys, browser) -> None:
    if kind == "diagnosis":
        both = diagnosis(tmp_path / "a", "named"), diagnosis(tmp_path / "b", "<b>odd</b>")
    else:
        both = PAGES[kind](tmp_path)
    page = tmp_path / "page.html"
    assert main(["compare", *map(str, both), "--out", str(page), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=\"(?!#|data:)", text)
    assert "<b>odd</b>" not in text
    rows = [row for part in found["parts"] for row in part["rows"]]
    for width, scheme in ((1400, "light"), (390, "dark")):
        browser.open(page, width=width, prefers_color_scheme=scheme)
        assert browser.complaints() == []
        assert browser.requests() == [page.resolve().as_uri()]
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert browser.run("document.querySelectorAll('tbody tr').length") == len(rows)
        assert browser.run("document.querySelectorAll('figure svg path').length") >= 2
        assert headless.nameless(browser) == 0
        assert headless.least_contrast(browser) >= 4.5


def test_runs_without_a_response_are_drawn_over_time_and_units_are_printed(tmp_path, capsys):
    paths = []
    for name, size in (("a", 1e-3), ("b", 2e-3)):
        path = tmp_path / f"{name}.h5"
        channel = Channel("theta_x", "rad", "output", "theta_x", 1000.0)
        with LogWriter.create(path, [channel], test="chop", bench={}) as writer, writer.segment("up", {}):
            writer.append({"theta_x": np.full(3000, size)})
        paths.append(path)
    page = tmp_path / "page.html"
    assert main(["compare", *map(str, paths), "--out", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "θx over time" in text and "<svg" in text and "A: solid; B: dashed" in text
    assert not re.search(
        r"\de[-+]\d\d", capsys.readouterr().out + re.sub(r"<(svg|script|style).*?</\1>", "", text, flags=re.S)
    )
    assert Row("stiffness", 1e-9, 2.5e4, "N m/rad^3").texts()[3:] == ("25000 (+2.5·10¹⁵ %)", "N m/rad³")
