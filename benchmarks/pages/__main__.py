"""Make the tables of docs/ again, each from the results files that its BEGIN mark names.

    python -m benchmarks.pages

For other results, change the names in the mark first.
"""

from __future__ import annotations

import sys

from benchmarks.pages import TABLES
from benchmarks.pages.marks import files_of, with_table


def main() -> int:
    """Write every page that has a made table; return 0."""
    for table in TABLES:
        page = table.page.read_text(encoding="utf-8")
        table.page.write_text(with_table(page, table, files_of(page, table)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
