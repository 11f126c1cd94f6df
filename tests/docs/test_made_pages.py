"""Pages that are made from the code, without the program that makes a site of them."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from mccdcli.schema import schema_of, values_of
from tests.docs.test_pages import MADE
from tests.reading import DOCS


@pytest.fixture(scope="module")
def conf() -> ModuleType:
    found = importlib.util.spec_from_file_location("conf_of_the_documents", DOCS / "conf.py")
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def test_the_tests_of_pages_know_which_are_made(conf: ModuleType) -> None:
    assert set(conf.PAGES) == MADE


def test_the_page_of_a_diagnosis_has_every_part_in_its_order_and_every_value(conf: ModuleType) -> None:
    page = conf.diagnosis_page()
    parts = re.findall(r"^## (.*)$", page, flags=re.MULTILINE)
    assert parts[:-1] == list(schema_of("diagnose")["properties"])
    for part, text in zip(parts, re.split(r"^## .*$", page, flags=re.MULTILINE)[1:], strict=True):
        told = re.findall(r"^\| `([^`]+)` \|", text, flags=re.MULTILINE)
        assert told == [place for place, _, _ in values_of("diagnose") if re.split(r"\W", place)[0] == part], part


@pytest.mark.parametrize("change", ["without", "beside"])
def test_words_for_other_parts_than_there_are_make_no_page(
    change: str, conf: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (DOCS / "reference" / "diagnosis-json.toml").read_text(encoding="utf-8")
    wrong = words.replace("segments =", "pieces =") if change == "without" else f'{words}\nmore = "and more"\n'
    (tmp_path / "reference").mkdir()
    (tmp_path / "reference" / "diagnosis-json.toml").write_text(wrong, encoding="utf-8")
    monkeypatch.setattr(conf, "HERE", tmp_path)
    with pytest.raises(ValueError, match="pieces|more"):
        conf.diagnosis_page()


def test_links_of_the_page_of_a_diagnosis_lead_somewhere(conf: ModuleType) -> None:
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", conf.diagnosis_page()):
        assert (DOCS / "reference" / target).resolve().exists(), target
