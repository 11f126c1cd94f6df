"""How much the settling of θx under repetitive control depends on the seed of the noise: a study of the bundled bench.

Too slow for a report: each seed takes a run of its own. `settling_seeds.toml` holds the outcome, which is in groups, by
the swing that is the last to leave the band.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from campaigns.benches import DEFAULT_MODEL
from sim_backend.bench import SIMULATED
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

    def covers(self, bench: Mapping[str, str], settings: Mapping[str, Any]) -> bool:
        """Tell whether a run is one that the study repeated: the bundled bench, simulated, after the same learning."""
        bundled = bench.get("kind") in SIMULATED and bench.get("name") == DEFAULT_MODEL
        return bundled and settings.get("tuning", {}).get("learning_s") == self.learning_s

    def share_within(self, value_s: float, tolerance_s: float) -> float:
        """Return the share of the seeds whose settling time lies so near to a value."""
        return float(np.mean(np.abs(self.settling_s - value_s) <= tolerance_s * (1.0 + 1e-9)))

    def said(self, share: float) -> str:
        """Return what `share` of the seeds agree with the paper, and the range of all."""
        low, middle, high = (self.quantile_ms(part) for part in (0.05, 0.5, 0.95))
        return (
            f"depends on the noise: {100.0 * share:.0f} % of {self.settling_s.size} seeds agree with the paper, the "
            f"median settles in {middle:.1f} ms, 5–95 % in {low:.1f}–{high:.1f} ms (Fig. A3)"
        )


@functools.cache
def settling_seeds() -> Seeds:
    """Return the bundled result."""
    resource = resources.files("analysis.paper") / "settling_seeds.toml"
    read = msgspec.convert(toml_of(resource.read_text(encoding="utf-8"), WORDS), _File)
    times_ms = np.array(list(read.count_by_ms), dtype=float)
    times_s = np.repeat(1e-3 * times_ms, list(read.count_by_ms.values()))
    return Seeds(np.sort(times_s), read.learning_s, read.source)
