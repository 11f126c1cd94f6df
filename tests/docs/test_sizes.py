"""The documents stay short, and the index of results lists each result once."""

from __future__ import annotations

import re
from collections import Counter

from tests.docs.test_pages import PAGES, ROOT
from tests.reading import DOCS

WORDS = 25_000
"""Most words of all pages in docs/, decisions among them, together with README.md and CONTRIBUTING.md.

Counted as `wc -w` counts, tables and code included. Not counted: pages made by `make docs`, and CHANGELOG.md.
"""


def test_the_documents_have_at_most_25000_words() -> None:
    assert len(PAGES) > 60 and sum(page.startswith("decisions/") for page in PAGES) > 40
    pages = [*(DOCS / page for page in PAGES), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    words = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").split()) for path in pages}
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
