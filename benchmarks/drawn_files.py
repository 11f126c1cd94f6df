"""Writes a drawn record as the program that makes such files would, each form with its own library."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import h5py
import numpy as np
import scipy.io

from benchmarks.drawn_records import COUNT_FILL, FLOAT_FILL, TEXT, Record, number_text

Selections = Mapping[str, str]
"""How `time`, `u` and `y` are selected in the file."""

SUFFIX = MappingProxyType({"mat 5": "mat", "mat 7.3": "mat", "nc 3": "nc", "nc 4": "nc", "archive": "csv"})


def write(folder: Path, record: Record) -> tuple[str, Selections]:
    """Write the record; return the name of its file and how its columns are selected."""
    path = folder / f"a.{SUFFIX.get(record.form, record.form)}"
    return path.name, WRITERS[record.form](path, record)


def variables(record: Record) -> dict[str, np.ndarray]:
    """Return what a file of arrays holds by name, time first; a flaw is among it."""
    found = {time_name(record): record.stamps[record.kept]} if record.clock != "rate" else {}
    for k, name in enumerate(record.names):
        values = record.stored[k][record.kept]
        if record.flaw == "missing" and record.at % 2 == k:
            values = values.copy()
            values[record.at] = COUNT_FILL if record.layout == "packed" else np.nan
        if record.flaw == "short" and record.at % 2 == k:
            values = values[:-1]
        found[name] = values
    return found


def time_name(record: Record) -> str:
    """Return the name of the time, which holds its unit where the record says so."""
    if record.told != "name" or record.clock == "date":
        return "t"
    plain = record.form in ("mat 5", "mat 7.3", "nc 3")
    return f"t_{record.clock}" if plain else f"t ({record.clock})"


def unit_of(record: Record, name: str) -> str | None:
    """Return the unit that the file names for a variable."""
    if name == time_name(record):
        return record.clock if record.told == "file" else None
    return record.told_units[record.names.index(name)] if record.told_units else None


def matrix(record: Record) -> np.ndarray:
    """Return time and channels as columns."""
    return np.column_stack([values.astype(np.float64) for values in variables(record).values()])


def by_number(record: Record, name: str = "") -> Selections:
    """Return the selections of the columns of a matrix."""
    first = int(record.clock != "rate")
    return {"time": f"{name}[:, 0]", "u": f"{name}[:, {first}]", "y": f"{name}[:, {first + 1}]"}


def by_name(record: Record, before: str = "") -> Selections:
    """Return the selections of variables, all with the same words before their name."""
    names = {"time": time_name(record), "u": record.names[0], "y": record.names[1]}
    return {key: f"{before}{name}" for key, name in names.items()}


def _npy(path: Path, record: Record) -> Selections:
    np.save(path, _ordered(record, matrix(record)))
    return by_number(record)


def _npz(path: Path, record: Record) -> Selections:
    save = np.savez_compressed if record.style["packed_file"] else np.savez
    if record.layout == "matrix":
        save(path, data=matrix(record))
        return by_number(record, "data")
    found: dict[str, Any] = {name: _ordered(record, values) for name, values in variables(record).items()}
    save(path, **found)
    return by_name(record)


def _ordered(record: Record, values: np.ndarray) -> np.ndarray:
    return values.astype(values.dtype.newbyteorder(">")) if record.style["big_endian"] else values


def _hdf5(path: Path, record: Record) -> Selections:
    with h5py.File(path, "w") as file:
        if record.layout == "compound":
            found = {name: _ordered(record, values) for name, values in variables(record).items()}
            table = np.zeros(int(record.kept.sum()), [(name, values.dtype) for name, values in found.items()])
            for name, values in found.items():
                table[name] = values
            file["run/daq"] = table
            return by_name(record, "run/daq/")
        if record.layout == "matrix":
            file["run/data"] = matrix(record)
            return by_number(record, "run/data")
        before = "run/" if record.layout == "group" else ""
        packed_file = {"compression": "gzip", "chunks": True} if record.style["packed_file"] else {}
        for name, values in variables(record).items():
            made = file.create_dataset(before + name, data=_ordered(record, values), **packed_file)
            if (unit := unit_of(record, name)) is not None:
                made.attrs["units"] = unit
            made.attrs.update(_packing(record, name))
    return by_name(record, before)


def _packing(record: Record, name: str) -> dict[str, Any]:
    """Return the attributes that say how packed numbers are meant."""
    if name == time_name(record):
        return {}
    if record.layout == "packed":
        factor, offset = record.packing
        return {
            "scale_factor": np.float64(factor),
            "add_offset": np.float64(offset),
            "_FillValue": np.int16(COUNT_FILL),
        }
    stored = record.stored[0].dtype
    return {"_FillValue": stored.type(FLOAT_FILL)} if record.style["mixed"] and stored.kind == "f" else {}


def _mat5(path: Path, record: Record) -> Selections:
    found: dict[str, Any] = variables(record) if record.layout != "matrix" else {"data": matrix(record)}
    if record.layout == "structure":
        found = {"rec": found}
    column = "column" if record.style["mixed"] else "row"
    scipy.io.savemat(path, found, do_compression=bool(record.style["packed_file"]), oned_as=column)
    return {"plain": by_name(record), "structure": by_name(record, "rec."), "matrix": by_number(record, "data")}[
        record.layout
    ]


CLASSES = {"f8": "double", "f4": "single", "i2": "int16", "i4": "int32", "u1": "uint8", "i8": "int64"}


def _mat73(path: Path, record: Record) -> Selections:
    found = variables(record) if record.layout != "matrix" else {"data": matrix(record)}
    before = "rec/" if record.layout == "structure" else ""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in found.items():
            columns = values.T if values.ndim == 2 else values[None, :]
            file.create_dataset(before + name, data=columns).attrs["MATLAB_class"] = np.bytes_(
                CLASSES[values.dtype.str[1:]]
            )
        if before:
            file["rec"].attrs["MATLAB_class"] = np.bytes_("struct")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return by_number(record, "data") if record.layout == "matrix" else by_name(record, "rec." if before else "")


def _netcdf3(path: Path, record: Record) -> Selections:
    with scipy.io.netcdf_file(path, "w", version=2 if record.style["packed_file"] else 1) as file:
        file.createDimension("time", None if record.style["mixed"] else int(record.kept.sum()))
        if record.layout == "matrix":
            data = matrix(record)
            file.createDimension("channel", data.shape[1])
            file.createVariable("data", "d", ("time", "channel"))[:] = data
            return by_number(record, "data")
        for name, values in variables(record).items():
            plain = values.astype(np.float64) if values.dtype == np.int64 else values
            variable = file.createVariable(name, plain.dtype.str[1:], ("time",))
            variable[:] = plain
            if (unit := unit_of(record, name)) is not None:
                variable.units = unit
            for key, value in _packing(record, name).items():
                setattr(variable, key, value)
    return by_name(record)


def _tdms(path: Path, record: Record) -> Selections:
    import nptdms

    channels = [
        nptdms.ChannelObject("DAQ", name, values, {"unit_string": unit} if (unit := unit_of(record, name)) else {})
        for name, values in variables(record).items()
    ]
    with nptdms.TdmsWriter(path) as file:
        if record.style["mixed"] and record.flaw != "short":  # a recorder that writes a block at a time
            half = int(record.kept.sum()) // 2
            for piece in (slice(0, half), slice(half, None)):
                file.write_segment(
                    [nptdms.ChannelObject(c.group, c.channel, c.data[piece], c.properties) for c in channels]
                )
        else:
            file.write_segment(channels)
    return by_name(record, "DAQ/")


def _parquet(path: Path, record: Record) -> Selections:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays, fields = [], []
    for name, values in variables(record).items():
        array = pa.array(values, from_pandas=bool(record.style["mixed"]))  # not-a-number, or nothing at all
        unit = unit_of(record, name)
        arrays.append(array)
        fields.append(pa.field(name, array.type, metadata={"unit": unit} if unit else None))
    table = pa.table(arrays, schema=pa.schema(fields))
    pq.write_table(table, path, row_group_size=5 if record.style["packed_file"] else None)
    return by_name(record)


def _dates(record: Record) -> list[str]:
    texts = [str(stamp) for stamp in record.stamps]
    if record.style["date"] == "iso":
        return texts
    return [f"{t[8:10]}.{t[5:7]}.{t[:4]} {t[11:]}" for t in texts]


def _stamp_cells(record: Record) -> list[str]:
    if record.clock == "date":
        return _dates(record)
    return [repr(stamp).replace(".", str(record.style["decimal"])) for stamp in record.stamps.tolist()]


def _number_cells(record: Record, channel: int) -> list[str]:
    form, decimal = str(record.style["number"]), str(record.style["decimal"])
    cells = [number_text(value, form).replace(".", decimal) for value in record.stored[channel].tolist()]
    if record.flaw == "missing" and record.at % 2 == channel:
        cells[record.at] = str(record.style["hole"])
    return cells


def _quoted(record: Record, cell: str, *, bare: bool = False) -> str:
    separator = str(record.style["separator"])
    needed = separator in cell and not bare
    return f'"{cell}"' if needed or (record.style["quotes"] and not bare) else cell


def _table(path: Path, record: Record) -> Selections:
    separator, bare = str(record.style["separator"]), record.flaw == "bare commas"
    timed = record.clock != "rate"
    columns = [*([_stamp_cells(record)] if timed else []), _number_cells(record, 0), _number_cells(record, 1)]
    names = [*([time_name(record)] if timed else []), *record.names]
    units = [unit_of(record, name) or "" for name in names]
    # ones alone below names may be data
    below = record.style["below"] and any(unit not in ("", "1") for unit in units)
    shown = names if below or not any(units) else [f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=True)]
    head = [separator.join(_quoted(record, name) for name in shown)]
    head += [separator.join(_quoted(record, unit or "-") for unit in units)] if below else []
    lines = []
    for k, row in enumerate(zip(*columns, strict=True)):
        cells = row[:-1] if record.flaw == "short" and k == record.at else row
        if record.kept[k]:
            lines.append(separator.join(_quoted(record, cell, bare=bare) for cell in cells))
    _save(path, record, head, lines)
    if record.style["head"] == "none":
        return by_number(record)
    return dict(zip(["time", "u", "y"] if timed else ["u", "y"], shown, strict=True))


def _archive(path: Path, record: Record) -> Selections:
    separator = str(record.style["separator"])
    stamps = _stamp_cells(record)
    lines = [
        separator.join(_quoted(record, cell) for cell in (stamps[k], name, cells[k]))
        for cells, name in ((_number_cells(record, channel), record.names[channel]) for channel in (0, 1))
        for k in range(record.rows)
    ]
    lines.append(separator.join(_quoted(record, cell) for cell in (stamps[0], "door", "closed")))
    if record.style["mixed"]:
        lines = [lines[k] for k in np.random.default_rng(record.at).permutation(len(lines))]
    _save(path, record, [separator.join(_quoted(record, cell) for cell in (time_name(record), "pv", "value"))], lines)
    return {"time": time_name(record), "u": record.names[0], "y": record.names[1]}


def _save(path: Path, record: Record, head: list[str], lines: list[str]) -> None:
    kind = str(record.style["head"])
    above = {"names": head, "none": [], "remark": [f"# {head[0]}", *head[1:]], "preamble": ["Recorder", "", *head]}[
        kind
    ]
    text = str(record.style["newline"]).join([*above, *lines, ""])
    path.write_bytes(text.encode(str(record.style["encoding"])))


WRITERS: Mapping[str, Callable[[Path, Record], Selections]] = MappingProxyType(
    dict.fromkeys(TEXT, _table)
    | {"archive": _archive, "npy": _npy, "npz": _npz, "h5": _hdf5, "nc 4": _hdf5, "mat 5": _mat5, "mat 7.3": _mat73}
    | {"nc 3": _netcdf3, "tdms": _tdms, "parquet": _parquet}
)
