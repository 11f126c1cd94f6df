"""The loops of this process: from disk, or emitted and compiled, which happens once on a machine."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import Lock, Thread
from threading import enumerate as threads

from sim_backend.effects.compiled import Step
from sim_backend.jit import entry_name
from sim_backend.kernel.structure import Structure, step_symbol
from sim_backend.kernel_cache import keep_entry, read_entry
from sim_backend.machine_code import NAME, compiled, kept_or_made, linked, made_by
from sim_backend.object_code import Linked

Play = Callable[[int, int], None]
_lock = Lock()
_loaded: dict[Structure, tuple[Play, Linked]] = {}
"""Every loop of this process with what holds its code."""
_locks: dict[Structure, Lock] = {}
"""One for each loop that is being made: different ones are made side by side."""
_steps: dict[Step, Linked] = {}
"""Each step's loop over its places."""
_absent: set[Structure] = set()
"""Loops that were not on disk when they were asked for: a process looks for each once."""
ASIDE = "kernel"
"""Name of a thread that makes a loop."""


def loop_of(structure: Structure) -> Play:
    """Return the loop of a structure, from this process, from disk, or made now; takes two addresses."""
    found = _loaded.get(structure)
    if found is None:
        with _lock:
            own = _locks.setdefault(structure, Lock())
        with own:
            found = _loaded.get(structure)
            if found is None:
                # another thread may have loaded it from disk in the meantime, and plays it: what holds its code stays
                found = _loaded.setdefault(structure, _kept(structure) or _made(structure))
    return found[0]


def is_loaded(structure: Structure) -> bool:
    """Tell whether the loop of a structure is ready in this process."""
    return structure in _loaded


def load(structure: Structure) -> bool:
    """Load the loop of a structure if it is on disk; tell whether it is ready now."""
    if structure not in _loaded and structure not in _absent:
        if found := _kept(structure):
            _loaded.setdefault(structure, found)
        else:
            _absent.add(structure)
    return structure in _loaded


def make_aside(structure: Structure) -> None:
    """Make the loop of a structure in a thread of its own, unless it is being made; the process's end waits for it."""
    with _lock:
        if structure in _locks:
            return
        _locks[structure] = Lock()
    Thread(target=loop_of, args=(structure,), name=ASIDE).start()


def wait() -> None:
    """Wait until the loops that are being made aside are there."""
    for thread in threads():
        if thread.name == ASIDE:
            thread.join()


@cache
def _emitted_by() -> str:
    """Return a digest of all that decides on the emitted text besides the structure."""
    here = Path(__file__).parent
    around = [here.parent / "linear.py", *(here.parent / "effects" / name for name in ("base.py", "compiled.py"))]
    return sha256(b"".join(path.read_bytes() for path in [*sorted(here.glob("*.py")), *around])).hexdigest()


def _entry(label: str, what: str) -> str:
    return entry_name(label, *made_by(), _emitted_by(), what)


def _kept(structure: Structure) -> tuple[Play, Linked] | None:
    """Return a loop from disk, or None if it is not there."""
    code = read_entry(_entry("loop", structure.text()))
    return None if code is None else _as_loop(code)


def _made(structure: Structure) -> tuple[Play, Linked]:
    """Return a loop made now, and keep it on disk."""
    from sim_backend.kernel.sample import Sample

    # steps that are there for several lanes at once are not called one by one
    parts = {step_symbol(step.key): step for step in structure.steps}
    code = compiled((str(Sample(structure).emit()), NAME), parts, several=structure.lanes > 1)
    keep_entry(_entry("loop", structure.text()), code)
    _absent.discard(structure)
    return _as_loop(code)


def _as_loop(code: bytes) -> tuple[Play, Linked]:
    library = linked(code)
    return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(library.address), library


def address_of(step: Step) -> int:
    """Return the address of the loop over all places of a step, from this process, from disk, or made now."""
    with _lock:
        if step not in _steps:
            _steps[step] = linked(kept_or_made(_entry("places", step.key), lambda: _over_places(step)))
        return _steps[step].address


def _over_places(step: Step) -> bytes:
    from sim_backend.kernel.called_step import emit_places

    return compiled((str(emit_places(step.key, NAME)), NAME), {step_symbol(step.key): step})
