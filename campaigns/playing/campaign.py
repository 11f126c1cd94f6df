"""A whole campaign: a list of runs in a TOML file, played into one folder, resumable after anything.

The logs in the folder say what has been done: a run whose log is complete and was recorded under the same
configuration is never played again. What a bench remembers (learned input, hysteresis, heat) does not outlast its
safe state, so a run that did not complete is played anew from rest; what was recorded of it is set aside, not
overwritten. Each run has its own seed from the campaign's seed and its name, so that a resumed campaign's logs equal
an uninterrupted one's.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from campaigns.names import check_file_name
from campaigns.plans import Plan, make_plan
from campaigns.sizes import MOST_RUNS
from sim_backend.documents import read_text, toml_of
from sim_backend.errors import ConfigError, did_you_mean


class RunEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One run: its name, which is its log's too, its plan and the settings that differ from the plan's defaults.

    `disturbance` is its level on a simulated bench during this run.
    """

    name: str
    plan: str
    settings: dict[str, Any] = {}
    disturbance: float = 1.0


class Campaign(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A campaign file; `folder` is where its relative paths start."""

    name: str
    runs: tuple[RunEntry, ...]
    title: str = ""
    schema: Literal["mccd-campaign/1"] = "mccd-campaign/1"
    folder: str = ""

    def plans(self) -> dict[str, Plan]:
        """Return the plan of every run by its name; raises ConfigError for one that cannot be."""
        return {entry.name: self._plan(entry) for entry in self.runs}

    def levels(self) -> dict[str, float]:
        """Return the level of the disturbance of every run by its name."""
        return {entry.name: entry.disturbance for entry in self.runs}

    def _plan(self, entry: RunEntry) -> Plan:
        settings, model = dict(entry.settings), entry.settings.get("model")
        if self.folder and isinstance(model, str) and (beside := Path(self.folder) / model).is_file():
            settings["model"] = str(beside)
        with in_run(self, entry.name):
            return make_plan(entry.plan, settings)


@contextmanager
def in_run(campaign: Campaign, run_name: str) -> Iterator[None]:
    """Let a ConfigError inside the block say which run of which campaign it is about."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"campaign '{campaign.name}', run '{run_name}': {error}") from None


def run_seed(seed: int, run_name: str) -> int:
    """Return the seed of a run: 63 bits from the campaign's seed and the run's name, independent between runs."""
    state = np.random.SeedSequence([seed, *run_name.encode()]).generate_state(1, np.uint64)
    return int(state[0] >> np.uint64(1))


_BUNDLED = Path(__file__).parent.parent


def bundled_campaigns() -> list[str]:
    """Return the names of the campaigns that come with the package."""
    return sorted(file.stem for file in _BUNDLED.glob("*.toml"))


def load_campaign(name_or_path: str | Path) -> Campaign:
    """Return a bundled campaign by name, or the campaign in a TOML file.

    Raises ConfigError when there is neither, for broken TOML, unknown fields, a name that cannot be a file's or is
    used twice, and plans or settings that do not exist.
    """
    path = Path(name_or_path)
    if str(name_or_path) in bundled_campaigns():
        text = (_BUNDLED / f"{name_or_path}.toml").read_text(encoding="utf-8")
        return parse_campaign(text, f"campaign {name_or_path}")
    near = did_you_mean(str(name_or_path), bundled_campaigns())
    fix = f"nor is it a bundled campaign; {near}bundled: {', '.join(bundled_campaigns())}"
    return parse_campaign(read_text(path, "campaign", fix=fix), str(path), str(path.parent))


def parse_campaign(text: str, where: str, folder: str = "") -> Campaign:
    """Return the campaign written in `text`; `where` names it in errors, relative paths start at `folder`.

    Raises ConfigError as `load_campaign`.
    """
    try:
        campaign = msgspec.structs.replace(msgspec.convert(toml_of(text, where), Campaign), folder=folder)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}; a campaign has name, title and runs of name, plan and settings") from None
    names = [entry.name for entry in campaign.runs]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"{where}: runs {', '.join(names[:20]) or 'none'}; name each run once, and give one at least")
    if len(names) > MOST_RUNS:
        raise ConfigError(f"{where}: {len(names)} runs; a campaign has {MOST_RUNS} at most, make several of it")
    check_file_name(campaign.name, f"{where}: campaign")  # that of its folder, where none is given
    for name in names:
        check_file_name(name, f"{where}: run")
    campaign.plans()
    return campaign
