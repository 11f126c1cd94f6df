"""Small logs with known contents, written without a bench."""

import json

import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, read_run

RATE_HZ = 10_000.0


@pytest.fixture
def write_log(tmp_path):
    """Write parts (label, settings, {channel: values}) into a log and open it; closed after the test."""
    opened = []

    def write(test, channels, parts, name="run.h5", settings=None):
        path = tmp_path / name
        configuration = json.dumps({"plan": test, "settings": settings or {}})
        identity = {"kind": "sim", "name": "none"}
        rows = [Channel(n, unit, role, dof, RATE_HZ) for n, unit, role, dof in channels]
        with LogWriter.create(
            path, rows, test=test, bench=identity, configuration=configuration, seed=1, chunk_rows=64
        ) as log:
            for label, part, values in parts:
                with log.segment(label, part):
                    log.append({k: np.asarray(v, dtype=float) for k, v in values.items()})
        opened.append(read_run(path))
        return opened[-1]

    yield write
    for run in opened:
        run.close()
