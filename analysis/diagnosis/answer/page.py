"""The page of a diagnosis: one sentence first, then what it rests on, in one self-contained file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup, escape

from analysis.diagnosis.answer.changes import Change
from analysis.diagnosis.answer.explore import evidence_explorer, residual_explorer
from analysis.diagnosis.answer.figures import (
    Drawn,
    bode_figure,
    evidence_figures,
    residual_figures,
)
from analysis.diagnosis.answer.mechanism import mechanism_figure
from analysis.diagnosis.answer.opening import opening_figure, opening_output
from analysis.diagnosis.answer.output import DOMAINS, model_changes
from analysis.diagnosis.answer.sentence import SIGNIFICANT
from analysis.diagnosis.answer.surety import surety, times_less
from analysis.diagnosis.answer.words import measure_text
from analysis.diagnosis.evidence.domains import evidence
from analysis.diagnosis.evidence.gain import model_rms
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.records.loading import Source
from analysis.diagnosis.result import Cause, Diagnosis, Domain, Gain, Visible, hypothesis_text
from analysis.diagnosis.verdict.held_out import ABOVE_NOISE
from analysis.pages.environment import page_environment
from analysis.pages.explorer import Explorer
from analysis.pages.formats import fit_percent, known_exactly, readable, shown, unit_text, without_exponents
from analysis.pages.quantities import certainty, chance, quantity, share
from analysis.pages.svg import inlined
from campaigns.spreadsheet import inert_frame
from campaigns.version import tool_commit, tool_version
from sim_backend.effects import named
from sim_backend.effects.words import effect_text, with_effects
from sim_backend.model import Model
from sim_backend.safe_write import folder_within, write_text

if TYPE_CHECKING:
    import jinja2

    from analysis.diagnosis.evidence.chop_gain import ChopGain

_FEW = 3
"""Up to so many causes of one kind stand side by side in a table, more below each other."""

HEADLINES = {
    "consistent": "Model and data agree",
    "named": "The model lacks a known effect",
    "ambiguous": "The model is wrong; several causes would explain it",
    "unknown": "The model is wrong; no effect in the library explains it",
}


@dataclass(frozen=True)
class Cell:
    """One run and output in one domain: the highest level over the noise, its p-value in words, and its mark."""

    level: str
    chance: str
    where: str
    mark: str


@dataclass(frozen=True)
class OverviewRow:
    """One output of one run over all domains."""

    run: str
    output: str
    cells: tuple[Cell | None, ...]


@dataclass(frozen=True)
class Figures:
    """What is drawn, in the order of the page: measured and simulated, frequency response, the cause, and the rest."""

    opening: tuple[Drawn, ...] = ()
    response: tuple[Drawn, ...] = ()
    mechanism: tuple[Drawn, ...] = ()
    evidence: tuple[Drawn, ...] = ()
    residual: tuple[Drawn, ...] = ()

    def all(self) -> tuple[Drawn, ...]:
        """Return every figure."""
        return (*self.opening, *self.response, *self.mechanism, *self.evidence, *self.residual)


@dataclass(frozen=True)
class Drawings:
    """What is drawn on the page: its figures, their SVG by name, and interactive plots by key."""

    figures: Figures
    svg: dict[str, Markup]
    explorers: dict[str, Explorer]


def write_page(
    diagnosis: Diagnosis, model: Model, sources: Sequence[Source], out: Path, chops: Sequence[ChopGain] = ()
) -> dict[str, Path]:
    """Write `index.html` and its figures (SVG and CSV) into the folder `out` and return the paths by name."""
    files = {s.run_uid: Path(s.file).name for s in sources}
    figures, explorers = _drawings(diagnosis, model, files)
    return write_drawn(diagnosis, model, sources, out, figures, explorers, chops)


def write_drawn(
    diagnosis: Diagnosis,
    model: Model,
    sources: Sequence[Source],
    out: Path,
    figures: Figures,
    explorers: Mapping[str, Explorer] | None = None,
    chops: Sequence[ChopGain] = (),
) -> dict[str, Path]:
    """Write `index.html` with its figures; return the paths of all files by name."""
    folder = folder_within(out, "figures")
    runs = ", ".join(s.run_uid[:8] for s in sources[:2]) + (" …" if len(sources) > 2 else "")
    stamp = f"mccd {tool_version()} ({tool_commit()}) · run {runs}"
    paths: dict[str, Path] = {}
    drawings = {}
    for figure in figures.all():
        svg = figure.canvas.svg(stamp)
        paths[f"figures/{figure.name}.svg"] = write_text(folder / f"{figure.name}.svg", svg)
        write_text(folder / f"{figure.name}.csv", inert_frame(figure.canvas.numbers()).to_csv(index=False))
        drawings[figure.name] = Markup(inlined(svg, figure.name, str(escape(figure.title))))
    page = render(diagnosis, model, sources, Drawings(figures, drawings, dict(explorers or {})), chops)
    return paths | {"index.html": write_text(out / "index.html", page)}


def render(
    diagnosis: Diagnosis, model: Model, sources: Sequence[Source], drawn: Drawings, chops: Sequence[ChopGain] = ()
) -> str:
    """Return the page's HTML, in which text from files is escaped."""
    domains = [d for d in (*DOMAINS, *(k for k in diagnosis.evidence if k not in DOMAINS)) if diagnosis.evidence.get(d)]
    files = {s.run_uid: Path(s.file).name for s in sources}
    return str(
        _environment()
        .get_template("diagnosis.html.j2")
        .render(
            diagnosis=diagnosis,
            headline=HEADLINES[diagnosis.verdict],
            recorded=_recorded(diagnosis.data),
            kinds=_kinds(diagnosis.causes),
            few=_FEW,
            model=model,
            sources=sources,
            domains=domains,
            overview=_overview(diagnosis.evidence, domains, files),
            figures=drawn.figures,
            drawings=drawn.svg,
            surety=surety(diagnosis),
            above_noise=ABOVE_NOISE,
            seen_heading="Where it is seen" if diagnosis.effects else "Frequency response",
            trusted=_trusted(diagnosis.tolerance),
            causes_heading="Cause" if len(diagnosis.causes) == 1 else "Causes",
            visible=_by_effect(diagnosis.sensitivity),
            explorers=drawn.explorers,
            changes=_grouped(model_changes(diagnosis, model, sources)),
            symptoms={e.reported(): e.symptom for e in reversed(named())},
            held_out=_held_out(diagnosis, files),
            improved=_improved(diagnosis),
            better=_better(diagnosis.gain),
            compared=_compared(diagnosis),
            chops=chops,
            version=f"{tool_version()} ({tool_commit()})",
        )
    )


def _environment() -> jinja2.Environment:
    environment = page_environment("analysis.diagnosis.answer")
    environment.filters["quantity"] = quantity
    environment.filters["visible_size"] = _visible_size
    environment.filters["moment"] = lambda x: quantity(x, "s") if x < float("inf") else "never"
    environment.filters["unit"] = unit_text
    environment.filters["readable"] = readable
    environment.filters["effect"] = effect_text
    environment.filters["hypothesis"] = hypothesis_text
    environment.filters["placed"] = with_effects
    environment.filters["known_exactly"] = known_exactly
    environment.filters["fit"] = fit_percent
    environment.filters["plainly"] = without_exponents
    environment.filters["certainty"] = lambda probability: _unbroken(certainty(probability))
    environment.filters["percent"] = lambda x, digits=1: _unbroken(f"{100.0 * x:.{digits}f} %")
    environment.filters["share"] = lambda part: _unbroken(share(part))
    environment.filters["chance"] = lambda p: _unbroken(chance(p))
    return environment


def _unbroken(number: str) -> str:
    """Return a number with its unit, without a line break between them."""
    return number.replace(" ", "\N{NO-BREAK SPACE}")


def _drawings(diagnosis: Diagnosis, model: Model, files: dict[str, str]) -> tuple[Figures, dict[str, Explorer]]:
    data, before = diagnosis.data, diagnosis.before
    whitener = whitener_from(data, list(diagnosis.after))
    longest = max(r.n for r in data.records)
    noise_rms = model_rms(whitener, longest)
    floor = whitener_from(data, list(before)) if diagnosis.even else whitener  # both curves in one noise
    after = evidence(data, diagnosis.after, floor, model)
    output = opening_output(data, before, diagnosis.after, noise_rms)
    figures = Figures(
        opening=_those(opening_figure(data, before, diagnosis.after, noise_rms, model)),
        response=_those(bode_figure(diagnosis, model, output)),
        mechanism=_those(mechanism_figure(diagnosis, model, whitener)),
        evidence=tuple(evidence_figures(diagnosis.evidence, after, model)),
        residual=tuple(residual_figures(data, before, diagnosis.after, noise_rms, model)),
    )
    explorers = (
        residual_explorer(data, before, diagnosis.after, whitener, noise_rms, model, files),
        evidence_explorer(diagnosis.evidence, after, model, files),
    )
    return figures, {one.key: one for one in explorers if one is not None}


def _improved(diagnosis: Diagnosis) -> bool:
    """Tell whether the page shows an extended model: a cause is named, or tied ones gain more than chance does.

    What does not explain the residual is no better model, however little it leaves.
    """
    gain = diagnosis.gain
    better = gain is not None and gain.measurable and gain.rms_after < gain.rms_before
    return bool(diagnosis.causes) or (diagnosis.verdict == "ambiguous" and better)


MUCH_BETTER = 0.99
"""A reduction above it is stated as a ratio: of 99.8 % and 99.9 % nobody sees that one is twice the other."""


def _better(gain: Gain | None) -> tuple[str, str]:
    """Return by how much the error after is smaller than the one before, and the ends of that, in words."""
    if gain is None:
        return "", ""
    low, high = sorted(gain.ci95)
    if min(low, gain.reduction) > MUCH_BETTER and high < 1.0:
        ratio, least, most = (readable(1.0 / (1.0 - part), 2) for part in (gain.reduction, low, high))
        return f"{ratio} ×", f"smaller error than adjusted (95 %: {least} to {most} ×)"
    if gain.reduction < 0.0 and high < 0.0:
        low, high = -high, -low
    less = "more" if gain.reduction < 0.0 else "less"
    ends = f"{100.0 * low:.1f} % to {100.0 * high:.1f} %"
    return _unbroken(f"{100.0 * abs(gain.reduction):.1f} %"), f"{less} error than adjusted (95 %: {ends})"


@dataclass(frozen=True)
class Compared:
    """A hypothesis in words, how many times less likely it makes the data, and what would be seen if it were true."""

    name: str
    times: str
    seen: str


def _compared(diagnosis: Diagnosis) -> list[Compared]:
    symptoms = {e.reported(): e.symptom for e in reversed(named())}
    rows = []
    for name, log_odds in diagnosis.considered:
        seen = [symptoms[one] for one in name.split("+") if one in symptoms]
        rows.append(
            Compared(hypothesis_text(name), times_less(log_odds), f"the residual {', and '.join(seen)}" if seen else "")
        )
    return rows


def _those(*figures: Drawn | None) -> tuple[Drawn, ...]:
    return tuple(figure for figure in figures if figure is not None)


def _recorded(data: Dataset) -> str:
    """Return in words how much was judged: samples, rate, outputs and the part held out; nothing of a response."""
    if not data.records:
        return ""
    samples = sum(w.stop - w.start for r in data.records for w in r.windows)
    held = sum(w.stop - w.start for r in data.records for w in r.windows if w.held_out)
    outputs = f"{data.n_outputs} output{'' if data.n_outputs == 1 else 's'}"
    return f"{samples:,} samples at {quantity(data.rate_hz, 'Hz')}, {outputs}, {share(held / max(samples, 1))} held out"


@dataclass(frozen=True)
class Kind:
    """Causes of one effect, and the sentence that they share."""

    effect: str
    why: str
    causes: tuple[Cause, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of the parameters of all."""
        return tuple(dict.fromkeys(name for cause in self.causes for name in cause.parameters))

    def undetermined(self) -> list[str]:
        """Return where no number of a cause is three standard deviations from zero."""
        return [
            cause.where
            for cause in self.causes
            if cause.parameters and not any(abs(p.value) >= 3.0 * p.std for p in cause.parameters.values())
        ]


def _kinds(causes: Sequence[Cause]) -> list[Kind]:
    alike: dict[tuple[str, str, float], list[Cause]] = {}
    for cause in causes:
        alike.setdefault((cause.effect, cause.why, cause.probability), []).append(cause)
    return [Kind(effect, why, tuple(own)) for (effect, why, _), own in alike.items()]


def _by_effect(seen: Sequence[Visible]) -> dict[str, list[Visible]]:
    """Return the visible sizes by effect and the parameter that measures it."""
    out: dict[str, list[Visible]] = {}
    for one in seen:
        effect, measure = effect_text(one.effect), measure_text(one)
        out.setdefault(effect if measure.endswith(effect) else f"{effect}: {measure}", []).append(one)
    return out


def _visible_size(one: Visible) -> str:
    """Return a size with its unit and as a part of what the record has of it; a part of a whole in percent."""
    if one.natural is None:
        return share(one.size) if one.unit == "1" else quantity(one.size, one.unit)
    return f"{quantity(one.size, one.unit)} ({_unbroken(share(one.size / one.natural))})"


def _trusted(tolerance: float | None) -> str:
    """Return in words how far the model's own numbers are trusted."""
    if tolerance is None:
        return "The model's own numbers were fitted to these very records, and are adjusted freely."
    return (
        f"The model's own numbers are trusted to ±{readable(100.0 * tolerance)} % (one standard deviation of each; "
        "--nominal-tolerance), and adjusted within that."
    )


def _overview(found: dict[str, tuple[Domain, ...]], domains: Sequence[str], files: dict[str, str]) -> list[OverviewRow]:
    places = list(dict.fromkeys((d.record, d.output) for name in domains for d in found[name]))
    total = max(sum(len(found[name]) for name in domains), 1)
    rows = []
    for record, output in places:
        cells: list[Cell | None] = []
        for name in domains:
            here = [d for d in found[name] if (d.record, d.output) == (record, output)]
            cells.append(_cell(here[0], total) if here else None)
        rows.append(OverviewRow(files.get(record, record), output, tuple(cells)))
    return rows


def _cell(d: Domain, total: int) -> Cell:
    level = float(np.max(d.level / d.floor))
    corrected = d.p_value * total
    mark = "quiet" if corrected >= SIGNIFICANT else "strong" if level >= 3.0 else "faint"
    return Cell(shown(level), chance(d.p_value), d.where, mark)


def _grouped(rows: Sequence[Change]) -> dict[str, list[Change]]:
    out: dict[str, list[Change]] = {}
    for row in rows:
        out.setdefault(row.place, []).append(row)
    return out


def _held_out(diagnosis: Diagnosis, files: dict[str, str]) -> list[str]:
    """Return the held-out segments as "file: label", with the names of files instead of those of runs."""
    named = []
    for entry in diagnosis.gain.held_out if diagnosis.gain else ():
        run, _, label = entry.partition("#")
        named.append(f"{files.get(run, run)}: {label}")
    return named
