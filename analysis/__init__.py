"""Measurements on recorded data: arrays in, one small frozen result per measurement out.

`from analysis import diagnose` judges a model by arrays. The import of this package stays cheap: what it offers is
loaded when it is first asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.diagnosis.api import diagnose

__all__ = ["diagnose"]


def __getattr__(name: str) -> Any:
    if name == "diagnose":
        from analysis.diagnosis.api import diagnose

        return diagnose
    raise AttributeError(f"module 'analysis' has no attribute {name!r}")
