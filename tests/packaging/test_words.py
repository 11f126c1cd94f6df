"""Messages, pages and docstrings use the field's terms: no private words, nothing that has to be read twice."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache

import pytest

from tests.packaging.spoken import docstrings, prose, said, strings, template_text, written

BANNED = {
    r"\bis no (?!(?:longer|better|worse|more|less|larger|smaller)\b|\w+ (?:to|of what)\b)": "is not a",
    r"\b(?:general way|stranger|stand-in|testimony|leeway|freshness)": "basis function; unlisted alternative; …",
    r"\b(?:imitat|objection|doubted|barely|knob|re-tuned)": "resembles; failed check; adjusted",
    r"\b(?:what is left(?! out)|left ?over|brought into line|lined up|shaking)\b": "residual; estimated; disturbance",
    r"\bpass(?:es|ed|ing)? for\b|\btakes? for its own\b": "is absorbed by; is taken as",
    r"(?<!what it was )\btold\b(?! to\b)|\btells? \w+ from\b|\btells? [^.:;]* apart\b": "distinguished; known; shown",
    r"(?<!pendulum that )\bhangs? on\b": "depends on",
    r"\biron\b": "magnetic hysteresis",
    r"\b(?:house|witness|gross|main cause)\b": "package; reference sensor; large-discrepancy fit",
    r"\bcomes? to nothing\b|\bother than designed\b|\bunlike\b": "fails; differs from the design",
    r"\bheld-out rows\b": "held-out samples",
}
"""What is not written (a pattern), and what is written instead."""

ALLOWED = {
    "there is no ": "plain English for what does not exist",
    "suspension without iron": "what the suspension is made of, in a bundled model",
    "back iron": "a part of the actuators, in a bundled model",
    "iron of the actuators": "the source of a number in model files that exist",
}
"""Texts that hold a pattern and are right."""


@cache
def texts_of(read: Callable[[], Iterator[tuple[str, str]]]) -> list[tuple[str, str]]:
    return list(read())


def offences(text: str) -> list[str]:
    for phrase in ALLOWED:
        text = text.replace(phrase, "")
    return [f"'{m[0]}' ({instead})" for pattern, instead in BANNED.items() for m in re.finditer(pattern, text)]


def test_what_the_product_says_holds_no_private_words() -> None:
    texts = texts_of(said)
    assert len(texts) > 2000
    assert [f"{where}: {found}" for where, text in texts for found in offences(text)] == []


def test_pages_and_docstrings_hold_no_private_words() -> None:
    texts = texts_of(written)
    assert len(texts) > 5000
    assert [f"{where}: {found}" for where, text in texts for found in offences(text)] == []


@pytest.mark.parametrize("phrase", sorted(ALLOWED))
def test_every_exception_is_needed(phrase: str) -> None:
    assert any(phrase in text for _, text in (*texts_of(said), *texts_of(written)))


def test_strings_are_read_without_docstrings_and_code() -> None:
    source = (
        '"""A file is no file."""\n\n\ndef f(a):\n    """It is no file."""\n    raise ValueError(f"{a} is no file")\n'
    )
    assert [text for _, text in strings(source)] == ["… is no file"]
    assert offences("a.csv is no file") and not offences("there is no file") and offences("it cannot be told")
    assert template_text("{# told #}<p title='told'>a {{ told }}</p><script>told</script>").split() == ["a"]


def test_docstrings_are_read_without_names_of_the_code() -> None:
    source = '"""Of a module."""\n\n\nclass A:\n    """It holds\n    `told` values."""\n\n    n = "text of a value"\n'
    assert list(docstrings(source)) == [(1, "Of a module."), (5, "It holds … values.")]


def test_pages_are_read_paragraph_by_paragraph_without_code() -> None:
    page = "# Head\n\nOne\nsentence, `told`.\n\n```sh\nmccd told\n```\n- [link](told.md) <!-- told -->\n"
    assert [text for _, text in prose(page) if text] == ["# Head", "One sentence, ….", "- [link]"]


@pytest.mark.parametrize(
    "plain",
    [
        "what is no longer there",
        "a sum that is no larger than its parts",
        "the process was told to end",
        "it did not do what it was told",
        "the columns that are what is left out",
        "a pendulum that hangs on the moving part",
    ],
)
def test_plain_english_is_no_offence(plain: str) -> None:
    assert offences(plain) == []


@pytest.mark.parametrize(
    "private",
    ["a file that is no log", "nothing is told", "it tells the two apart", "the noise hangs on the speed", "the knobs"],
)
def test_private_words_are_found(private: str) -> None:
    assert len(offences(private)) == 1
