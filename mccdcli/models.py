"""Writing model files: never over an existing one by accident, and in one step."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sim_backend.errors import ConfigError
from sim_backend.safe_write import write_text

if TYPE_CHECKING:
    from sim_backend.model import Model


def refuse_existing(path: Path, *, force: bool) -> None:
    """Raise ConfigError when `path` exists and `force` is not given: asked before the work, not after it."""
    if path.exists() and not force:
        raise ConfigError(f"{path} exists and would be overwritten; choose another --out or give --force")


def save_model(model: Model, path: Path, *, force: bool) -> None:
    """Write the TOML of `model` to `path`; raises ConfigError as `refuse_existing`."""
    from sim_backend.model import dump_model

    refuse_existing(path, force=force)
    write_text(path, dump_model(model))
