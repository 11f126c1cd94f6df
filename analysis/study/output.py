"""The files of a study: every trial as CSV, what they say together as JSON, and a figure."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from analysis.study.figures import study_figure
from analysis.study.store import FILE, Store
from analysis.study.summary import Summary
from analysis.study.trial import Job
from campaigns.spreadsheet import inert
from sim_backend.errors import DataError
from sim_backend.safe_write import whole_text_file, write_text

SCHEMA = "mccd-study-results/1"


def document(job: Job, summary: Summary) -> dict[str, Any]:
    """Return what a study says, as JSON can hold it; the same for any number of workers and either engine."""
    study = job.study
    columns = [{"name": c.name, "about": c.about, "kind": c.kind, "limit": c.limit} for c in job.columns]
    return {
        "schema": SCHEMA,
        "title": study.title,
        "seed": study.seed,
        "draws": study.trials,
        "columns": columns,
        "varied": list(job.varied_names),
        **_plain(dataclasses.asdict(summary)),
    }


def write_results(job: Job, store: Store, summary: Summary, folder: Path) -> dict[str, Path]:
    """Write trials.csv, study.json and study.svg, each in one step; raises DataError when they cannot be written."""
    files = {"trials": folder / FILE}
    try:
        files["csv"] = _csv(job, store, folder / "trials.csv")
        text = json.dumps(document(job, summary), indent=2, ensure_ascii=False) + "\n"
        files["json"] = write_text(folder / "study.json", text)
        files["figure"] = write_text(folder / "study.svg", study_figure(job, store, summary).svg(study_stamp(job)))
    except OSError as error:
        raise DataError(f"{folder}: {error.strerror}; check the folder, its rights and the free space") from None
    return files


def study_stamp(job: Job) -> str:
    """Return what stands below the figure: which study it shows."""
    return f"{job.study.name}, seed {job.study.seed}, {job.study.total} trials"


def _csv(job: Job, store: Store, path: Path) -> Path:
    with whole_text_file(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        heads = ("trial", "status", "reason", *job.varied_names, *(c.name for c in job.columns))
        writer.writerow(map(inert, heads))
        writer.writerows([inert(v) if isinstance(v, str) else v for v in row] for row in store.rows(job.study.total))
    return path


def _plain(value: Any) -> Any:
    """Return a value with what JSON has no number for as null."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
