"""An investigation: run, diagnose, choose, run on, until the model is consistent, the cause named, or nothing helps.

Every round is a folder: its log, played as a campaign of one run (so that what is complete is never repeated and what
is partial is set aside), and the diagnosis of all logs so far. The state file says which plan each round plays, and is
written before it moves anything, so that an investigation can go on after anything. Once a cause is named, the bench
plays a chop with the feed-forward of either model, outside of the budget: some seconds that show what was gained.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from analysis.diagnosis.answer.output import document, prepare_folder, write_files
from analysis.diagnosis.answer.page import write_page
from analysis.diagnosis.evidence.chop_gain import ChopGain, chops_or_why
from analysis.diagnosis.experiment.planned import BenchDescription, first_plan
from analysis.diagnosis.experiment.reference_sensor import load_logs
from analysis.diagnosis.pipeline import Options, diagnose
from campaigns.benches import bench_kind, open_bench
from campaigns.log import sha256_of
from campaigns.plans import Plan, estimate, make_plan
from campaigns.playing.campaign import Campaign, RunEntry, run_seed
from campaigns.playing.campaign_run import read_state, run_campaign
from campaigns.playing.runner import Report
from campaigns.version import tool_version
from sim_backend.errors import ConfigError, DataError
from sim_backend.model import Model, dump_model
from sim_backend.safe_write import folder_within, write_text
from sim_backend.small_files import STATE_BYTES, read_small_text

STATE_FILE = "investigation.json"
SCHEMA = "mccd-investigation/1"

ROWS = 300_000
"""Samples of all logs together that a diagnosis of a round uses: it takes about half a minute then."""

ENDS = ("consistent", "named")
"""Verdicts after which there is nothing more to find out."""


@dataclass(frozen=True)
class Quest:
    """What is investigated: the bench at `address` against `model`, in at most `rounds` and `budget_s` of bench time.

    `first` is the plan to begin with; by default a multisine as large as the bench allows. `note` is written to each
    log.
    """

    address: str
    model: Model
    seed: int = 0
    rounds: int = 4
    budget_s: float = 600.0
    first: Plan | None = None
    options: Options = field(default_factory=Options)
    note: str = ""

    def fingerprint(self) -> dict[str, str]:
        """Return what a resumed investigation must share with the one it continues, part by part."""
        kind, rest = bench_kind(self.address)
        first = "chosen by the bench" if self.first is None else json.dumps(self.first.configuration(), sort_keys=True)
        return {
            "bench": self.address,
            "bench digest": kind.digest(rest),
            "model": hashlib.sha256(dump_model(self.model).encode()).hexdigest(),
            "seed": str(self.seed),
            "first plan": first,
            "options": json.dumps(asdict(self.options), sort_keys=True),
            "mccd": tool_version(),
        }


LONGEST = 40
"""Characters of a setting in the error that compares two."""


@dataclass(frozen=True)
class Round:
    """One round: the plan with the settings that differ from its defaults, its log, and what all logs so far say."""

    number: int
    plan: str
    settings: dict[str, Any]
    duration_s: float
    log: str
    verdict: str = ""
    sentence: str = ""
    causes: tuple[str, ...] = ()
    ambiguous: tuple[tuple[str, ...], ...] = ()
    next_experiment: dict[str, Any] | None = None


@dataclass(frozen=True)
class Inquiry:
    """How an investigation stands: the last verdict, why it stopped, every round; `paused` by the user."""

    folder: Path
    verdict: str
    reason: str
    rounds: tuple[Round, ...]
    paused: bool = False


def investigate(
    quest: Quest,
    folder: str | Path,
    *,
    resume: bool = False,
    report: Report | None = None,
    remark: Callable[[str], None] = lambda _: None,
) -> Inquiry:
    """Investigate into `folder` and return how that ended; `remark` is called with each round's plan and verdict.

    The first Ctrl-C during a run ends it after the current segment, and `paused` says so; every log is kept. Raises
    ConfigError for a folder that holds another investigation, or this one without `resume`, and whatever running and
    diagnosing raise.
    """
    home = prepare_folder(Path(folder))
    planned = _claimed(quest, home, resume)
    with closing(open_bench(quest.address, quest.seed)) as bench:
        description = BenchDescription.of(bench)
    _require_ports(description, quest.model)
    plan = _planned(planned[0]) if planned else quest.first or first_plan(description, quest.model)
    rounds: list[Round] = []
    while True:
        number = len(rounds) + 1
        entry = _entry(number, plan, description)
        reason = _spent(quest, rounds, entry)
        if reason:
            return _ended(quest, home, rounds, reason)
        _write(quest, home, [*rounds, entry], "running")
        remark(f"round {number}: {plan.name}, {entry.duration_s:.1f} s")
        if not _played(quest, home, entry, plan, report):
            return _ended(quest, home, [*rounds, entry], "paused by the user", paused=True)
        rounds.append(_judged(quest, home, rounds, entry, description, report))
        _write(quest, home, rounds, "running")
        remark(f"round {number}: {rounds[-1].verdict}. {rounds[-1].sentence}")
        following = rounds[-1].next_experiment
        if rounds[-1].verdict in ENDS or following is None:
            return _ended(quest, home, rounds, _why(rounds[-1]))
        plan = (
            _planned(planned[number]) if number < len(planned) else make_plan(following["test"], following["settings"])
        )


def _require_ports(description: BenchDescription, model: Model) -> None:
    """Raise ConfigError, before anything moves, when the bench does not have what the model needs."""
    have = {(s.role, s.dof) for s in description.signals}
    for role, ports in (("input", model.inputs), ("output", model.outputs)):
        for port in ports:
            if (role, port.dof) not in have:
                dofs = ", ".join(sorted(dof for r, dof in have if r == role))
                raise ConfigError(
                    f"the bench has no {role} of {port.dof}, as model '{model.name}' has; its {role}s are of {dofs}: "
                    "give a model of this bench"
                )


def _why(last: Round) -> str:
    if last.verdict in ENDS:
        return f"the verdict is {last.verdict}"
    return f"the verdict is {last.verdict}, and no further experiment that this bench can do would change it"


def _spent(quest: Quest, rounds: Sequence[Round], entry: Round) -> str:
    """Return why the round `entry` cannot be played any more, or nothing."""
    if len(rounds) >= quest.rounds:
        return f"{quest.rounds} rounds are done (--rounds); the next would be the plan {entry.plan}"
    before = sum(r.duration_s for r in rounds)
    if before + entry.duration_s > quest.budget_s:
        return (
            f"the plan {entry.plan} takes {entry.duration_s:.1f} s on the bench, and of the {quest.budget_s:g} s "
            f"(--budget-s) {before:.1f} s are spent"
        )
    return ""


def _entry(number: int, plan: Plan, description: BenchDescription) -> Round:
    duration_s = estimate(plan, description).duration_s
    return Round(number, plan.name, plan.changes(), duration_s, f"round-{number}/{plan.name}.h5")


def _planned(entry: Round) -> Plan:
    return make_plan(entry.plan, entry.settings)


def _played(quest: Quest, home: Path, entry: Round, plan: Plan, report: Report | None) -> bool:
    """Play a round that is not complete yet; False when the user paused it."""
    name = f"round-{entry.number}"
    run = RunEntry(name=plan.name, plan=plan.name, settings=plan.changes())
    outcome = run_campaign(
        Campaign(name=name, title=plan.title, runs=(run,)),
        folder_within(home, name),
        address=quest.address,
        seed=run_seed(quest.seed, name),
        resume=read_state(home / name) is not None,
        report=report,
        note=quest.note,
    )
    return outcome.status == "complete"


def _judged(
    quest: Quest,
    home: Path,
    before: Sequence[Round],
    entry: Round,
    description: BenchDescription,
    report: Report | None,
) -> Round:
    """Return the round with what all logs so far say; a diagnosis of the same logs that is there already stands."""
    logs = [home / r.log for r in (*before, entry)]
    folder = home / f"round-{entry.number}" / "diagnosis"
    found = _known(folder, logs)
    if found is None:
        loaded, references = load_logs(logs, quest.model, max_rows=ROWS)

        def progress(what: str, part: float) -> None:
            if report is not None:
                report(part, 1.0, what)

        # the same again would only halve the noise; what is still undecided needs another view
        done = [_planned(r) for r in (*before, entry)]
        diagnosis = diagnose(loaded.data, quest.model, quest.options, progress, description, references, done)
        diagnosis = replace(diagnosis, notes=(*loaded.notes, *diagnosis.notes))
        folder_within(folder.parent, folder.name)
        files = write_files(diagnosis, quest.model, loaded.sources, folder)
        chops: tuple[ChopGain, ...] = ()
        try:
            if diagnosis.verdict == "named":
                nominal = write_text(folder / "nominal.toml", dump_model(quest.model))
                extended, bench = files["extended.toml"], partial(open_bench, quest.address, quest.seed)
                chops, why = chops_or_why(bench, nominal, extended, quest.model, quest.seed)
                diagnosis = replace(diagnosis, notes=(*diagnosis.notes, *why))
                write_files(diagnosis, quest.model, loaded.sources, folder, chops)
        finally:  # once: drawing takes as long as judging
            write_page(diagnosis, quest.model, loaded.sources, folder, chops)
        found = document(diagnosis, quest.model, loaded.sources, chops)
    return replace(
        entry,
        verdict=found["verdict"],
        sentence=found["sentence"],
        causes=tuple(f"{c['effect']} at {c['where']}" for c in found["causes"]),
        ambiguous=tuple(map(tuple, found["ambiguous"])),
        next_experiment=found["next_experiment"],
    )


def _known(folder: Path, logs: Sequence[Path]) -> dict[str, Any] | None:
    """Return the diagnosis in `folder` if it is one of these very logs."""
    try:
        found: dict[str, Any] = json.loads(read_small_text(folder / "diagnosis.json", STATE_BYTES))
        same = sorted(entry["sha256"] for entry in found["inputs"]) == sorted(sha256_of(log) for log in logs)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return found if same else None


def _claimed(quest: Quest, home: Path, resume: bool) -> list[Round]:
    """Return the rounds that the folder's own investigation has planned; make it this one's if it holds none."""
    path = home / STATE_FILE
    if not path.exists():
        _write(quest, home, [], "running")
        return []
    if not resume:
        raise ConfigError(f"{home} holds an investigation already; continue it with --resume or choose another --out")
    try:
        state = json.loads(read_small_text(path, STATE_BYTES))
        before, rounds = state["fingerprint"], [Round(**entry) for entry in state["rounds"]]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise DataError(f"{path}: cannot be read ({error}); choose another --out, the logs in it stay") from None
    changes = [
        f"{key} was {str(before.get(key))[:LONGEST]} and is {value[:LONGEST]}"
        for key, value in quest.fingerprint().items()
        if before.get(key) != value
    ]
    if changes:
        raise ConfigError(
            f"{home} cannot be resumed: {', '.join(changes)}; repeat the old settings or choose another --out"
        )
    return rounds


def _ended(quest: Quest, home: Path, rounds: Sequence[Round], reason: str, *, paused: bool = False) -> Inquiry:
    judged = [r.verdict for r in rounds if r.verdict]
    verdict = judged[-1] if judged else ""
    _write(quest, home, rounds, "paused" if paused else "ended", reason)
    return Inquiry(home, verdict, reason, tuple(rounds), paused)


def _write(quest: Quest, home: Path, rounds: Sequence[Round], status: str, reason: str = "") -> None:
    content = {
        "schema": SCHEMA,
        "status": status,
        "reason": reason,
        "fingerprint": quest.fingerprint(),
        "rounds": [asdict(r) for r in rounds],
    }
    write_text(home / STATE_FILE, json.dumps(content, indent=2, ensure_ascii=False) + "\n")
