"""Tables in text files: comma- or tab-separated, with or without a line of names."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from campaigns.log.guard import first_line
from sim_backend.errors import DataError

if TYPE_CHECKING:
    import pandas as pd

_MAX_LINE_CHARS = 2**20


@dataclass(frozen=True)
class TextSource:
    """Columns of a text table by their names; `[:, k]` selects by number. Lines after `#` are comments."""

    path: Path
    delimiter: str = ","
    decimal: str = "."

    def names(self) -> list[str]:
        """Return the names in the first line; none when that line holds numbers alone."""
        return list(self._table.columns) if self._has_names else []

    def array(self, name: str) -> NDArray[Any] | None:
        """Return a column as (n,), the whole table (n, columns) for the empty name, None without such a column.

        Raises DataError for a cell that is no number.
        """
        if name == "":
            return np.column_stack([self._numbers(index) for index in range(self._table.shape[1])])
        if not self._has_names or name not in self._table.columns:
            return None
        return self._numbers(list(self._table.columns).index(name))

    @cached_property
    def _first_line(self) -> str:
        try:
            with self.path.open(encoding="utf-8-sig", errors="strict") as stream:
                while line := stream.readline(_MAX_LINE_CHARS):
                    if content := line.split("#", 1)[0].strip():
                        return content
        except (OSError, UnicodeDecodeError) as error:
            raise DataError(f"cannot read {self.path}: {first_line(error)}; save it as UTF-8 text") from None
        raise DataError(f"{self.path} holds no line of data: check that it is the right file")

    @cached_property
    def _has_names(self) -> bool:
        for cell in self._first_line.split(self.delimiter):
            try:
                float(cell.replace(self.decimal, "."))
            except ValueError:
                if cell.strip():
                    return True
        return False

    @cached_property
    def _table(self) -> pd.DataFrame:
        import pandas as pd

        try:
            table = pd.read_csv(
                self.path,
                sep=self.delimiter,
                decimal=self.decimal,
                comment="#",
                header=0 if self._has_names else None,
                skipinitialspace=True,
                index_col=False,
                low_memory=False,
                encoding="utf-8-sig",
                on_bad_lines="error",
            )
        except (OSError, ValueError, UnicodeDecodeError, MemoryError, OverflowError, pd.errors.ParserWarning) as error:
            raise DataError(f"cannot read {self.path}: {first_line(error)}; correct the table") from None
        return table.rename(columns=lambda column: str(column).strip())

    def _numbers(self, index: int) -> NDArray[Any]:
        column = self._table.iloc[:, index]
        if column.dtype.kind in "fiu":
            return column.to_numpy()
        import pandas as pd

        numbers = pd.to_numeric(column, errors="coerce")
        bad = np.flatnonzero(numbers.isna() & column.notna())
        if bad.size:
            cell = str(column.iloc[bad[0]])[:40]
            raise DataError(
                f"{self.path}: column '{column.name}' holds {cell!r} in data row {bad[0] + 1}, which is no number "
                f"({bad.size} such cells): correct the cells or the delimiter"
            )
        return numbers.to_numpy(dtype=np.float64)
