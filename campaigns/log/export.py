"""A log for other programs: a pandas frame, an xarray data set, and files for MATLAB, NeXus viewers and spreadsheets.

Times, units and segments are included wherever the format allows. All values are in SI, as in the log. Files
are written a block of samples at a time, so that a log may be larger than the memory.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from campaigns.log.failure import let_go, reason_of
from campaigns.log.limits import BLOCK_ROWS
from campaigns.log.matlab import Numbers, Value, write_structure
from campaigns.log.read import Run
from campaigns.log.schema import to_json
from campaigns.progress import Report, unheard
from campaigns.spreadsheet import inert
from sim_backend.errors import ConfigError, DataError, did_you_mean
from sim_backend.safe_write import whole_file, whole_path, whole_text_file

if TYPE_CHECKING:
    import h5py
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

CSV_ROWS = 20_000
"""Rows of text that are written between reports of progress: a second of work at most."""

MATLAB_NAME = 63
"""Letters of a name that MATLAB keeps."""

MAT_BYTES = 2**31 - 2**20
"""The most that a structure in a MATLAB file of version 5 can hold, less its names and segments."""


def to_frame(run: Run) -> pd.DataFrame:
    """Return the committed samples as a frame: a column per channel, time in s as index, units in `attrs["units"]`."""
    import pandas as pd

    frame = pd.DataFrame({name: run.read(name) for name in run.channels}, index=pd.Index(_time(run), name="time_s"))
    frame.attrs = {
        "units": {name: channel.unit for name, channel in run.channels.items()},
        "run_uid": run.run_uid,
        "test": run.header.test,
    }
    return frame


def to_dataset(run: Run) -> xr.Dataset:
    """Return the committed samples as a data set over `time`, with `units`, role and dof of each variable.

    The label of each sample's segment is the coordinate `segment`, empty between segments. Raises ConfigError when
    xarray is not installed.
    """
    try:
        import xarray as xr
    except ImportError:
        raise ConfigError("xarray is not installed; install it, or use pandas") from None
    names = _stored_names(run.channels, ("time", "segment"))
    variables = {
        names[name]: ("time", run.read(name), {"units": c.unit, "role": c.role, "dof": c.dof})
        for name, c in run.channels.items()
    }
    labels = np.zeros(run.rows, dtype=object)
    labels[:] = ""
    for segment in run.segments:
        labels[segment.start : segment.stop] = segment.label
    coordinates = {"time": ("time", _time(run), {"units": "s"}), "segment": ("time", labels)}
    about = {"run_uid": run.run_uid, "test": run.header.test, "sample_rate_hz": run.sample_rate_hz}
    return xr.Dataset(variables, coordinates, about)


def save_csv(run: Run, path: Path, report: Report = unheard) -> None:
    """Write one row per sample, `time (s)` first, the unit of each channel in its head, every digit."""
    import pandas as pd

    first = next(iter(run.channels))
    names = _stored_names(run.channels, ("time",))
    with whole_text_file(path, replace=False) as file:
        for start, block in run.blocks(rows=CSV_ROWS):
            report(start, run.rows, f"writing {path.name}")
            stop = start + next(iter(block.values())).size
            columns = {inert(f"{names[name]} ({run.channels[name].unit})"): values for name, values in block.items()}
            frame = pd.DataFrame(columns, index=pd.Index(run.time_s(first, start, stop), name="time (s)"))
            frame.to_csv(file, header=start == 0)


def save_npz(run: Run, path: Path, report: Report = unheard) -> None:
    """Write an archive of numpy arrays: `time_s`, one per channel, and `about` as JSON text."""
    reader = _Reader(run, report)
    names = _stored_names(run.channels, ("time_s", "about"))
    with whole_file(path, replace=False) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, blocks in {"time_s": _times(run), **{names[n]: reader.values(n) for n in run.channels}}.items():
            # its size is not asked for before it is written, so every entry may become larger than 4 GB
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                header = {"descr": "<f8", "fortran_order": False, "shape": (run.rows,)}
                np.lib.format.write_array_header_1_0(entry, header)
                for _, values in blocks:
                    entry.write(values.astype("<f8").tobytes())
        with archive.open("about.npy", "w") as entry:
            np.lib.format.write_array(entry, np.array(to_json(_about(run, names), "log")), allow_pickle=False)


def save_mat(run: Run, path: Path, report: Report = unheard) -> None:
    """Write a MATLAB file (v5) of one structure `run`: `time_s`, `channels`, `units`, `segments`, `about` as JSON text.

    Names that MATLAB cannot have are changed: other signs become `_`, and a leading digit gets an `x`. Segments count
    samples from 1 and include their last, as MATLAB does. Raises ConfigError for a log that this format cannot hold.
    """
    size = 8 * run.rows * (len(run.channels) + 1)
    if size > MAT_BYTES:
        raise ConfigError(
            f"{run.path} holds {size / 1e9:.3g} GB, a MATLAB file of version 5 at most {MAT_BYTES / 1e9:.3g} GB: "
            "write .nxs, which MATLAB reads by h5read, or read the log itself that way"
        )
    names, reader = _matlab_names(run.channels), _Reader(run, report)
    segments = run.segments
    content: dict[str, Value] = {
        "time_s": _column(run, _times(run)),
        "channels": {names[name]: _column(run, reader.values(name)) for name in run.channels},
        "units": {names[name]: channel.unit for name, channel in run.channels.items()},
        "segments": {
            "label": [s.label for s in segments],
            "first": _listed([s.start + 1 for s in segments]),
            "last": _listed([s.stop for s in segments]),
            "settings": [to_json(s.settings, s.label) for s in segments],
        },
        "about": to_json(_about(run, names), "log"),
    }
    with whole_file(path, replace=False) as file:
        write_structure(file, "run", content)


def save_nexus(run: Run, path: Path, report: Report = unheard) -> None:
    """Write a NeXus file: an NXentry with one NXdata per role, each channel with `units` over a shared time axis."""
    import h5py

    with whole_path(path, replace=False) as hidden:
        file = h5py.File(hidden, "x")
        try:
            _fill_nexus(file, run, _Reader(run, report))
            file.flush()
            file.close()
        except BaseException as error:
            let_go(file)
            if isinstance(error, OSError | RuntimeError):
                fix = "check the folder, its rights and the free space"
                raise DataError(f"{path}: {reason_of(error)}; {fix}") from None
            raise


def _fill_nexus(file: h5py.File, run: Run, reader: _Reader) -> None:
    file.attrs["NX_class"], file.attrs["default"] = "NXroot", "entry"
    entry = file.create_group("entry")
    entry.attrs["NX_class"] = "NXentry"
    entry["title"], entry["start_time"] = run.header.test, run.header.started_utc
    entry["entry_identifier"] = run.run_uid
    notes = entry.create_group("about")
    notes.attrs["NX_class"] = "NXnote"
    stored = _stored_names(run.channels, ("time",))
    notes["type"], notes["data"] = "application/json", to_json(_about(run, stored), "log")
    for role in dict.fromkeys(channel.role for channel in run.channels.values()):
        names = run.names(role)
        data = entry.create_group(role)
        data.attrs.update({"NX_class": "NXdata", "signal": stored[names[0]], "axes": ["time"], "time_indices": 0})
        if len(names) > 1:
            data.attrs["auxiliary_signals"] = [stored[name] for name in names[1:]]
        _stored(data, "time", run.rows, _times(run)).attrs["units"] = "s"
        for name in names:
            channel = _stored(data, stored[name], run.rows, reader.values(name))
            channel.attrs["units"], channel.attrs["long_name"] = run.channels[name].unit, name
    entry.attrs["default"] = "output" if run.names("output") else next(iter(run.channels.values())).role


FORMS: Final[Mapping[str, Callable[[Run, Path, Report], None]]] = {
    ".csv": save_csv,
    ".mat": save_mat,
    ".npz": save_npz,
    ".nxs": save_nexus,
}
"""How a log is written for others, by the ending of the file."""


def save(run: Run, path: Path, report: Report = unheard) -> None:
    """Write the committed samples of a log in the format that the file's ending names.

    Raises ConfigError for an ending that is none of FORMS, and for a file that exists.
    """
    ending = path.suffix.lower()
    if ending not in FORMS:
        raise ConfigError(
            f"{path}: '{ending}' is not a known format; {did_you_mean(ending, FORMS)}there are {', '.join(FORMS)}"
        )
    if path.exists():
        raise ConfigError(f"{path} exists and is not overwritten; choose another path")
    FORMS[ending](run, path, report)  # whole or not at all: half a file reads like a whole one


def _stored(group: h5py.Group, name: str, rows: int, blocks: Iterable[tuple[int, Array]]) -> h5py.Dataset:
    dataset = group.create_dataset(name, (rows,), "<f8")
    for start, values in blocks:
        dataset[start : start + values.size] = values
    return dataset


@dataclass
class _Reader:
    """Reads a run's channels, `BLOCK_ROWS` at a time, and reports how much of all of them that is."""

    run: Run
    report: Report
    done: int = 0

    def values(self, name: str) -> Iterator[tuple[int, Array]]:
        """Yield (first sample, values) of a channel."""
        for start, block in self.run.blocks([name]):
            self.report(self.done, self.run.rows * len(self.run.channels), f"channel {name}")
            self.done += block[name].size
            yield start, block[name]


def _times(run: Run) -> Iterator[tuple[int, Array]]:
    first = next(iter(run.channels))
    for start in range(0, run.rows, BLOCK_ROWS):
        yield start, run.time_s(first, start, min(start + BLOCK_ROWS, run.rows))


def _column(run: Run, blocks: Iterable[tuple[int, Array]]) -> Numbers:
    return Numbers((run.rows, 1), (values for _, values in blocks))


def _listed(rows: list[int]) -> Numbers:
    return Numbers((len(rows), 1) if rows else (0, 0), [np.array(rows, dtype=float)])


def _time(run: Run) -> Array:
    return run.time_s(next(iter(run.channels)))


def _about(run: Run, stored: Mapping[str, str]) -> dict[str, Any]:
    """Return what is known of a run; `stored` gives the name of each channel in the file."""
    header = run.header
    return {
        "run_uid": run.run_uid,
        "test": header.test,
        "status": run.status,
        "started_utc": header.started_utc,
        "bench": dict(header.bench),
        "seed": header.seed,
        "configuration": header.configuration,
        "sample_rate_hz": run.sample_rate_hz,
        "channels": {
            n: {"unit": c.unit, "role": c.role, "dof": c.dof, "stored_as": stored[n]} for n, c in run.channels.items()
        },
        "segments": [
            {"label": s.label, "start": s.start, "stop": s.stop, "settings": dict(s.settings)} for s in run.segments
        ],
    }


def _stored_names(names: Iterable[str], reserved: Iterable[str] = (), longest: int = 1000) -> dict[str, str]:
    """Return under which name each channel is stored: its own, with `_` or a number at the end where that is taken.

    All of them differ within their first `longest` signs.
    """
    taken = {*reserved, *(name for name in names if len(name) <= longest and name not in reserved)}
    found: dict[str, str] = {}
    for name in names:
        if len(name) <= longest and name not in reserved:
            found[name] = name
            continue
        ends = ("", "_", *(f"_{k}" for k in range(2, 10_000)))
        found[name] = next(new for end in ends if (new := name[: longest - len(end)] + end) not in taken)
        taken.add(found[name])
    return found


def _matlab_names(names: Iterable[str]) -> dict[str, str]:
    plain: dict[str, str] = {}
    for name in names:
        new = re.sub(r"\W", "_", name, flags=re.ASCII)
        new = new if new[0].isalpha() else f"x{new}"
        while new in plain.values():
            new += "_"
        plain[name] = new
    stored = _stored_names(plain.values(), longest=MATLAB_NAME)
    return {name: stored[new] for name, new in plain.items()}
