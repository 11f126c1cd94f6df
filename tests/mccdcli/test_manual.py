"""Every command explains itself: examples that parse, a page for man, the reference of the documents."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

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
