"""The empty log: everything in the file before its first sample."""

from __future__ import annotations

from dataclasses import astuple, fields

import h5py
import numpy as np

from campaigns.log.disk_space import header_bytes, take
from campaigns.log.schema import (
    CHANNELS,
    COMMITTED,
    EXPECTED,
    SCHEMA,
    SEGMENTS,
    Channel,
    Header,
    segment_dtype,
    to_json,
)

SEGMENTS_PER_CHUNK = 64


def lay_out(
    file: h5py.File,
    header: Header,
    channels: tuple[Channel, ...],
    chunk_rows: int,
    settings_bytes: int,
    expected_rows: int | None,
) -> None:
    """Write the header, the empty channels, the empty table of segments and the counter into a new file.

    Raises OSError, with nothing written, when the disk has no space for them.
    """
    take(file, header_bytes(sum(len(str(value)) for value in astuple(header)), len(channels)))
    file.attrs["schema"] = SCHEMA
    for field in fields(Header):
        value = getattr(header, field.name)
        if field.name == "seed":
            if value is not None:
                file.attrs["seed"] = np.int64(value)
        elif field.name == "bench":
            file.attrs["bench"] = storable(to_json(value, "bench identity"))
        elif field.name != "note" or value:
            file.attrs[field.name] = storable(value)
    if expected_rows is not None:
        file.attrs[EXPECTED] = np.int64(expected_rows)
    group = file.create_group(CHANNELS)
    for index, channel in enumerate(channels):
        dataset = group.create_dataset(
            channel.name, (0,), "<f8", maxshape=(None,), chunks=(chunk_rows,), fletcher32=True
        )
        dataset.attrs["index"] = np.int64(index)
        for field in fields(Channel):
            if field.name != "name":
                dataset.attrs[field.name] = getattr(channel, field.name)
    file.create_dataset(SEGMENTS, (0,), segment_dtype(settings_bytes), maxshape=(None,), chunks=(SEGMENTS_PER_CHUNK,))
    file.create_dataset(COMMITTED, data=np.int64(0))


def storable(text: str) -> str:
    """Return `text` without what HDF5 strings cannot hold: NUL and lone surrogates."""
    return text.replace("\0", "\ufffd").encode("utf-8", "replace").decode("utf-8")
