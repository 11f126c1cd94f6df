"""Every table of the report. TABLES is the only list: a table is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from analysis.paper.measured import Measured
from analysis.paper.numbers import paper_tables
from analysis.paper.rows import Ours, Table, build_table
from analysis.paper.table_6_1 import table_6_1
from analysis.paper.table_6_2 import table_6_2, table_6_2_coefficients
from analysis.paper.table_6_3 import table_6_3
from analysis.paper.table_6_4 import table_6_4
from analysis.paper.table_6_5 import table_6_5
from analysis.paper.table_6_6 import PROJECT, table_6_6
from analysis.paper.table_6_7 import table_6_7
from analysis.paper.table_text import table_text

TABLES: dict[str, Callable[[Measured], Mapping[str, Ours]]] = {
    "6.1": table_6_1,
    "6.2": table_6_2,
    "6.2-coefficients": table_6_2_coefficients,
    "6.3": table_6_3,
    "6.4": table_6_4,
    "6.5": table_6_5,
    "6.6": table_6_6,
    "6.7": table_6_7,
    "text": table_text,
}


OWN: dict[str, Callable[[Measured], Mapping[str, Ours]]] = {
    "6.6": lambda measured: table_6_6(measured, PROJECT),
    "6.7": lambda measured: table_6_7(measured, "designed"),
}
"""Tables that also show what this project's own design achieves."""


def make_table(key: str, measured: Measured) -> Table:
    """Return one table; rows that the campaign did not measure stay visible as such."""
    with measured.tracing() as uids:
        ours = TABLES[key](measured)
        own = OWN[key](measured) if key in OWN else {}
    return build_table(key, paper_tables()[key], ours, tuple(sorted(uids)), own)
