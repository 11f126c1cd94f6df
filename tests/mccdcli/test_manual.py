"""Every command explains itself: examples that parse, a page for man, the reference of the documents."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from analysis.challenge.experiment import SHAPES
from analysis.challenge.score import LEAST_NULLS, LEAST_PER_FAMILY
from analysis.design.api import MOST_SETTLING_S
from analysis.design.uncertainty import Tolerance
from analysis.recorded.requirements import (
    ACCURACY_RAD,
    FULL_ANGLE_RAD,
    PARASITIC_Z_M,
    PEAK_CURRENT_A,
    POWER_W,
    SETTLING_S,
    STABILITY_RAD,
    THERMAL_STABILITY_RAD,
)
from campaigns.benches import BENCHES, DEFAULT_MODEL
from campaigns.playing.thermal_campaign import COLD
from campaigns.serial.transport import USUAL_BAUD
from mccdcli.main import cli, main
from mccdcli.manual import Page, man_page, markdown, pages
from mccdcli.registry import COMMANDS
from tests.command_lines import calls_in, check

PAGES = {page.name.removeprefix("mccd "): page for page in pages(cli)}


def test_the_manual_has_every_command() -> None:
    assert set(PAGES) == set(COMMANDS)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_command_has_examples_and_the_line_of_help_that_the_list_shows(name: str) -> None:
    page = PAGES[name]
    assert any(example.partition("mccd ")[2].startswith(name) for example in page.examples)
    assert page.paragraphs[0] == COMMANDS[name].help
    assert all(help for _, help in page.options)


@pytest.mark.parametrize(("page", "example"), [(p, e) for p in PAGES.values() for e in p.examples])
def test_an_example_is_a_call_that_parses(page: Page, example: str) -> None:
    called = calls_in(example)
    assert called
    for words in called:
        check(words)


NUMBERS = {
    "bench list": (BENCHES["serial"].help, [f"{USUAL_BAUD} baud"]),
    "thermal": (None, [f"{COLD[0]:g} K and {COLD[1]:g} K", f"{1e6 * THERMAL_STABILITY_RAD:.3g} µrad"]),
    "chop": (
        None,
        [
            f"MODEL is {DEFAULT_MODEL} and BAUD {USUAL_BAUD} unless given",
            f"stability (3σ) and repeatability of {1e6 * STABILITY_RAD:.3g} µrad",
            f"accuracy of {1e6 * ACCURACY_RAD:.3g} µrad",
        ],
    ),
    "settle": (
        None,
        [
            f"{1e3 * SETTLING_S:.3g} ms to settle, stability (3σ) of {1e6 * STABILITY_RAD:.3g} µrad",
            f"power of {POWER_W:g} W, peak current of {PEAK_CURRENT_A:g} A",
            f"parasitic z of {1e6 * PARASITIC_Z_M:.3g} µm",
        ],
    ),
    "theodolite": (None, [f"more than {1e6 * ACCURACY_RAD:.3g} µrad at {1e3 * FULL_ANGLE_RAD:.3g} mrad"]),
    "design": (
        None,
        [
            f"at most {1e3 * MOST_SETTLING_S:.3g}.",
            f"Damping may always be off by {1e2 * Tolerance().damping:g} %",
            f"participation in the motion by {1e2 * Tolerance().participation:g} %",
            f"the lowest frequency by another {1e2 * Tolerance().suspension:g} %",
        ],
    ),
    "challenge make": (
        None,
        [f"{', '.join(f'{1e2 * part:g}' for part in [*SHAPES.values()][:2])} and {1e2 * SHAPES['short']:g} %"],
    ),
    "challenge score": (None, [f"{LEAST_NULLS} cases with nothing hidden, and {LEAST_PER_FAMILY} of every family"]),
}
"""What a help says in numbers that the code has, by command; another text than that of the help where it is given."""


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_in_a_help_are_those_of_the_code(name: str) -> None:
    text, numbers = NUMBERS[name]
    page = PAGES[name]
    said = " ".join([*page.paragraphs, *(help for _, help in page.options)] if text is None else [text])
    assert [number for number in numbers if number not in " ".join(said.split())] == []


def test_markdown_holds_every_option_once_per_command() -> None:
    text = markdown(cli)
    for name, page in PAGES.items():
        part = text.partition(f"## mccd {name}\n")[2].partition("\n## ")[0]
        for names, _ in page.options:
            cell = " ".join(names.split()).replace("|", "\\|")
            assert part.count(f"| `{cell}` |") == 1, (name, names)


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not installed")
def test_man_formats_the_page_without_a_warning() -> None:
    page = man_page(cli, "1.2.3")
    done = subprocess.run(
        ["groff", "-man", "-Tutf8", "-ww", "-rLL=100n", "-K", "utf8", "-P-c"],
        input=page,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert done.stderr == ""
    shown = re.sub(r".\x08", "", done.stdout)
    for name in COMMANDS:
        assert f"mccd {name}" in shown
    assert "mccd 1.2.3" in shown and "--cycles INTEGER" in shown


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["manual"]) == 0
    assert capsys.readouterr().out.startswith(".TH MCCD 1 ")
    assert main(["manual", "--format", "markdown"]) == 0
    assert capsys.readouterr().out == markdown(cli)


@pytest.mark.parametrize("width", ["40", "80", "200"])
def test_help_fits_its_width(width: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("COLUMNS", width)
    assert main(["chop", "--help"]) == 0
    out = capsys.readouterr().out
    # lines that are kept as they are (examples) may be longer; a word longer than its column cannot be helped
    wrapped = [line for line in out.splitlines() if not line.lstrip().startswith(("mccd ", "Usage"))]
    assert max(map(len, wrapped)) <= min(max(int(width), 50), 100)
    assert "\x1b" not in out
