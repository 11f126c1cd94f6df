"""A case's runs as logs: exact numbers, or text or counts of another bench that `mccd import` has read."""

from __future__ import annotations

import json
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.challenge.second.campaign import Campaign
from analysis.challenge.second.excite import Record
from analysis.challenge.second.plant import DRIVES
from campaigns.importing import import_run
from campaigns.log import Channel, LogWriter
from campaigns.log.checksum import sidecar_of, write_sidecar
from sim_backend import safe_write

Array = NDArray[np.float64]

EPOCH = datetime(2026, 1, 1, tzinfo=UTC)
"""Every run begins at this time: a clock would tell in which order cases were made."""


def channels_of(campaign: Campaign, temperature: bool) -> list[Channel]:
    """Return the channels of a run's log."""
    plant, rate = campaign.plant, campaign.rate_hz
    channels = [Channel(f"command_{d}", DRIVES[plant.unit], "input", d, rate) for d in plant.names]
    channels += [Channel(d, plant.unit, "output", d, rate) for d in plant.names]
    if campaign.control is not None:
        channels += [Channel(f"reference_{d}", plant.unit, "reference", d, rate) for d in plant.names]
    if temperature:
        channels.append(Channel("temperature", "K", "aux", "", rate))
    return channels


def columns_of(
    campaign: Campaign, record: Record, command: Array, reading: Array, temperature: Array | None
) -> dict[str, Array]:
    """Return what is recorded of a run by channel, each (n,); `command` and `reading` are (n, axes)."""
    names = campaign.plant.names
    columns = {f"command_{d}": command[:, i] for i, d in enumerate(names)}
    columns |= {d: reading[:, i] for i, d in enumerate(names)}
    if campaign.control is not None:
        columns |= {f"reference_{d}": campaign.scale[i] * record.wave[:, i] for i, d in enumerate(names)}
    if temperature is not None:
        columns["temperature"] = temperature
    return columns


def write_exact(
    path: Path, channels: list[Channel], record: Record, columns: dict[str, Array], rng: np.random.Generator
) -> None:
    """Write a run, its `columns` (n,) each, as a log of exact numbers."""
    with LogWriter.create(
        path, channels, test="free-run", bench={"kind": "bench", "name": "challenge"}, run_uid=rng.bytes(16).hex()
    ) as log:
        at = 0
        for stretch in record.stretches:
            with log.segment(stretch.label, stretch.settings):
                log.append({k: v[at : at + stretch.n] for k, v in columns.items()})
            at += stretch.n
    _put_in_order(path, record.n / channels[0].sample_rate_hz, rng)


def write_text(
    path: Path,
    channels: list[Channel],
    record: Record,
    columns: dict[str, Array],
    rng: np.random.Generator,
    *,
    digits: int,
    counts: dict[str, float],
) -> None:
    """Write a run as tables of text with `digits` significant digits, and import them by a map.

    Each of `columns` is (n,); channels in `counts` are whole numbers of that many units each.
    """
    folder = path.parent / "import"
    folder.mkdir()
    at = 0
    for number, stretch in enumerate(record.stretches):
        formats = ["%d" if name in counts else f"%.{digits}g" for name in columns]
        rows = np.column_stack(list(columns.values()))[at : at + stretch.n]
        rows = rows / np.array([counts.get(name, 1.0) for name in columns])
        rows = np.where([name in counts for name in columns], np.rint(rows), rows)
        head = ",".join(columns)
        with safe_write.whole_text_file(folder / f"part-{number}.csv") as file:
            np.savetxt(file, rows, delimiter=",", header=head, comments="", fmt=formats)
        at += stretch.n
    safe_write.write_text(folder / "map.toml", _map(channels, record, counts))
    import_run(folder / "map.toml", path)
    shutil.rmtree(folder)
    _put_in_order(path, record.n / channels[0].sample_rate_hz, rng)


def _map(channels: list[Channel], record: Record, counts: dict[str, float]) -> str:
    started = EPOCH.isoformat(timespec="seconds")
    lines = ["[log]", 'test = "free-run"', f"sample_rate_hz = {channels[0].sample_rate_hz!r}"]
    lines += ['bench = "challenge"', f'started_utc = "{started}"']
    for channel in channels:
        lines += ["", f"[channels.{channel.name}]", f'select = "{channel.name}"', f'unit = "{channel.unit}"']
        lines += [f'role = "{channel.role}"'] + ([f'dof = "{channel.dof}"'] if channel.dof else [])
        lines += [f"scale = {counts[channel.name]!r}"] if channel.name in counts else []
    for number, stretch in enumerate(record.stretches):
        settings = ", ".join(f"{k} = {json.dumps(v)}" for k, v in stretch.settings.items())
        lines += ["", "[[parts]]", f'label = "{stretch.label}"', f'source = "part-{number}.csv"']
        lines += [f"settings = {{ {settings} }}"]
    return "\n".join(lines) + "\n"


def _put_in_order(path: Path, length_s: float, rng: np.random.Generator) -> None:
    """Give a log the name and times that its case has, whenever and by whomever it was written."""
    sidecar_of(path).unlink()
    times = {"started_utc": EPOCH, "ended_utc": EPOCH + timedelta(seconds=length_s)}
    with h5py.File(path, "r+") as file:
        file.attrs.modify("run_uid", rng.bytes(16).hex())
        for name, time in times.items():
            file.attrs.modify(name, time.isoformat(timespec="milliseconds"))
    write_sidecar(path)
