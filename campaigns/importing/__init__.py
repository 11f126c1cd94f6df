"""Import of data from any other bench: a map says which variable of which file is which channel."""

from campaigns.importing.engine import ImportReport, import_run
from campaigns.importing.mapping import ImportMap, read_map

__all__ = ["ImportMap", "ImportReport", "import_run", "read_map"]
