"""The documents stay short, and the index of results lists each result once."""

from __future__ import annotations

import re
from collections import Counter

from tests.docs.test_pages import PAGES, ROOT
from tests.reading import DOCS

WORDS = 25_000
"""Most words of all pages in docs/ together with README.md and CONTRIBUTING.md.

Counted as `wc -w` counts, tables and code included. Not counted: docs/decisions (the record of choices), pages made by
`make docs`, and CHANGELOG.md.
"""


def test_the_documents_have_at_most_25000_words() -> None:
    pages = [DOCS / page for page in PAGES if not page.startswith("decisions/")]
    assert len(pages) > 20
    words = {path.name: len(path.read_text(encoding="utf-8").split()) for path in (*pages, ROOT / "README.md")}
    words["CONTRIBUTING.md"] = len((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split())
    assert sum(words.values()) <= WORDS, words


def test_the_index_lists_every_result_once_with_commit_command_and_machine() -> None:
    results = ROOT / "benchmarks" / "results"
    rows = [
        line.strip("|").split("|")
        for line in (results / "README.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    assert [cell.strip() for cell in rows[0]] == ["question", "file", "commit", "command", "machine"]
    assert all(len(row) == 5 and all(cell.strip() for cell in row) for row in rows)
    listed = Counter(name for row in rows[1:] for name in re.findall(r"`([^`]+)`", row[1]))
    assert listed == Counter({path.stem for path in results.iterdir() if path.name != "README.md"})
