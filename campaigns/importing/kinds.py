"""Which files are read by what, by their suffixes."""

from __future__ import annotations

from pathlib import Path

from sim_backend.plugins import plugin_names

TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc")
APART = (".npy", ".npz", ".mat", ".h5", ".hdf5", ".nc", ".tdms", ".parquet")
"""What is parsed in a process of its own, see `isolated`."""

SUFFIXES = (*TEXT, *APART)
"""What is read without another package."""


def packaged() -> tuple[str, ...]:
    """Return the suffixes that importers of other packages read; raises ConfigError for one that is read already."""
    return tuple(f".{name}" for name in plugin_names("importers", [own[1:] for own in SUFFIXES]))


def is_packaged(path: Path) -> bool:
    """Tell whether an importer of another package reads the file at `path`; raises as `packaged`."""
    kind = path.suffix.lower()
    return kind not in SUFFIXES and kind in packaged()
