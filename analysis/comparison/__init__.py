"""Two of a kind side by side: runs, models or diagnoses, recognised by what their files hold."""

from analysis.comparison.api import compare
from analysis.comparison.table import Comparison

__all__ = ["Comparison", "compare"]
