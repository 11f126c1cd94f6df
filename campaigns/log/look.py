"""What the child of `probe` does: it opens logs and looks at what could harm whoever reads them afterwards."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from campaigns.log.child import bound_memory, tell_ready
from campaigns.log.limits import BLOCK_ROWS
from campaigns.log.opening import has_writer, open_run, read_header
from campaigns.log.read import NoMemoryError, Run
from sim_backend.errors import DataError


def child() -> None:
    """Answer questions until standard input ends: each is a path, and whether all of its values are to be read.

    An answer is some lines on how far it is and one at the end: `refused`, `memory` (this process has too little) or
    `damage`, empty where there is none. A question may ask for the `header` instead, which is then the answer.
    """
    bound_memory()
    tell_ready()
    for line in sys.stdin.buffer:
        question = json.loads(line)
        try:
            path = Path(question["path"])
            if question["header"]:
                _tell(header=_listed(path))
            else:
                _tell(damage=_looked(path, question["whole"]))
        except (NoMemoryError, MemoryError) as error:
            _tell(memory=str(error))
        except DataError as error:
            _tell(refused=str(error))


def _listed(path: Path) -> dict[str, Any]:
    header = asdict(read_header(path))
    del header["configuration"]  # of any length, and no list shows it
    return header


def _looked(path: Path, whole: bool) -> str:
    with open_run(path) as run:
        _tell(rows=0, of=run.rows)
        if not has_writer(path, unknown=False):  # tables that are being written do not agree at every moment
            run.check_chunks()
        # what is not packed comes as it is stored, and its checksums are compared whenever it is read
        return _read_all(run, list(run.channels) if whole else run.packed())


def _read_all(run: Run, names: list[str]) -> str:
    """Read these channels, one after the other within a block of samples; return the first damage."""
    coarse = max(BLOCK_ROWS // run.chunk_rows, 1) * run.chunk_rows
    sound, damage = 0, ""
    for rows in (coarse, run.chunk_rows):  # the second pass finds the chunk within the block
        try:
            for first in range(sound, run.rows if names else 0, rows):
                until = min(first + rows, run.rows)
                for name in names:
                    run.stored(name, first, until)
                sound = until
                _tell(rows=sound)
        except NoMemoryError:
            raise
        except DataError as error:
            damage = str(error)
        else:
            return ""
    return damage


def _tell(**said: Any) -> None:
    print(json.dumps(said), flush=True)
