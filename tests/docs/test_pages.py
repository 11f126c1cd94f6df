"""What the documents tell a reader to type works, in the order in which they tell it."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import click
import pytest

from tests.command_lines import calls_in, check
from tests.reading import DOCS, blocks, follow, to_run

ROOT = Path(__file__).parents[2]
MADE = {
    "reference/commands.md",
    "reference/diagnosis-json.md",
    "reference/effects.md",
    "reference/json.md",
    "choices.md",
    "contradictions.md",
    "notebook.md",
}
PAGES = sorted(str(p.relative_to(DOCS)) for p in DOCS.rglob("*.md") if str(p.relative_to(DOCS)) not in MADE)

ELSEWHERE = {"log-format.md", "tutorial.md"}
"""Pages that tests of their own follow."""


def followed() -> list[object]:
    """Every page with something to type; those that take minutes only where soaks are asked for."""
    pages = [page for page in PAGES if to_run(page) and page not in ELSEWHERE]
    long = {page for page in pages if any(block.long for block in to_run(page))}
    return [pytest.param(page, marks=pytest.mark.soak) if page in long else page for page in pages]


@pytest.mark.parametrize("page", followed())
def test_what_a_page_tells_to_type_works(page: str, reader: Path) -> None:
    follow(page, reader)


def test_every_block_that_is_left_out_says_why() -> None:
    for page in PAGES:
        for block in blocks(page):
            assert not block.left_out or len(block.left_out) > 15, page


def test_every_decision_has_a_number_of_its_own() -> None:
    names = sorted(path.name for path in (DOCS / "decisions").glob("[0-9]*.md"))
    assert len(names) > 30 and all(re.match(r"\d{4}-[a-z0-9-]+\.md$", name) for name in names)
    shared = [pair for pair in pairwise(names) if pair[0][:4] == pair[1][:4]]
    assert shared == []


def spoken() -> list[tuple[str, str]]:
    """Every command that a page, the README or the changelog names within a line of text."""
    texts = [(page, (DOCS / page).read_text(encoding="utf-8")) for page in PAGES]
    texts += [
        (name, (ROOT / name).read_text(encoding="utf-8")) for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
    ]
    found = []
    for page, text in texts:
        plain = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
        found += [(page, call) for call in re.findall(r"`(mccd [^`]+)`", plain.replace("\\|", "|"))]
        shell = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
        lines = "\n".join(shell).replace("\\\n", " ").splitlines()
        found += [(page, line) for line in lines if line.startswith("mccd ")]
    return sorted(set(found))


@pytest.mark.parametrize(("page", "call"), spoken())
def test_every_command_that_is_spoken_of_exists(page: str, call: str) -> None:
    # "a | b" and "a, b" name several; "…" and CAPITALS stand for something
    if re.search(r" \| |, |…$", call) and " -" not in call:
        first, *others = re.split(r" \| |, ", call.removesuffix("…").strip())
        group = first.split()[:-1]
        calls = [first.split(), *([*group, other.strip()] for other in others)]
    else:
        calls = calls_in(call)
    assert calls, f"{page}: {call}"
    for words in calls:
        try:
            check([word for word in words if word != "…"])
        except click.BadOptionUsage as error:  # spoken of without the value that it takes
            assert "requires an argument" in error.message and words[-1].startswith("-"), f"{page}: `{call}`"
        except click.UsageError as error:
            raise AssertionError(f"{page}: `{call}`: {error.format_message()}") from None


def test_links_between_pages_lead_somewhere() -> None:
    for page in PAGES:
        text = re.sub(r"```.*?```", "", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            path = ((DOCS / page).parent / target).resolve()
            assert path.exists() or str(path.relative_to(DOCS)) in MADE, f"{page}: {target}"
