"""How much the settling of θx under repetitive control depends on the seed of the noise: a study of the bundled bench.

Too slow for a report: each seed takes a run of its own. `settling_seeds.toml` holds the outcome, which is in groups, by
the swing that is the last to leave the band.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from importlib import resources

import msgspec
import numpy as np
from numpy.typing import NDArray

from sim_backend.documents import toml_of

WORDS = "analysis/paper/settling_seeds.toml"


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    source: str
    learning_s: float
    count_by_ms: dict[str, int]


@dataclass(frozen=True)
class Seeds:
    """Settling times (n,) of as many seeds in s, rising, after so long a learning; `source` is the result's file."""

    settling_s: NDArray[np.float64]
    learning_s: float
    source: str

    def quantile_ms(self, share: float) -> float:
        """Return the settling time that this share of the seeds does not exceed, in ms."""
        return 1e3 * float(np.quantile(self.settling_s, share, method="inverted_cdf"))

    def said(self) -> str:
        """Return the range, with what it rests on."""
        low, middle, high = (self.quantile_ms(share) for share in (0.05, 0.5, 0.95))
        of = f"{self.settling_s.size} seeds of the bundled bench after {self.learning_s:g} s of learning"
        return (
            f"depends on the seed: 5–95 % of {of} {low:.1f}–{high:.1f} ms, median {middle:.1f} (Fig. A3, {self.source})"
        )


@functools.cache
def settling_seeds() -> Seeds:
    """Return the bundled result."""
    resource = resources.files("analysis.paper") / "settling_seeds.toml"
    read = msgspec.convert(toml_of(resource.read_text(encoding="utf-8"), WORDS), _File)
    times_ms = np.array(list(read.count_by_ms), dtype=float)
    times_s = np.repeat(1e-3 * times_ms, list(read.count_by_ms.values()))
    return Seeds(np.sort(times_s), read.learning_s, read.source)
