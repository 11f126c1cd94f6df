"""From an emitted loop to machine code, which is kept on disk: made once on a machine."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import cache
from hashlib import sha256
from itertools import count
from pathlib import Path
from threading import Lock, Thread
from threading import enumerate as threads
from typing import Any

from llvmlite import binding as llvm

from sim_backend.effects.compiled import Step
from sim_backend.jit import entry_name
from sim_backend.kernel.called_step import emit_places
from sim_backend.kernel.sample import NAME, Sample
from sim_backend.kernel.structure import Structure, step_symbol
from sim_backend.kernel_cache import keep_entry, read_entry

Play = Callable[[int, int], None]
_lock = Lock()
_loaded: dict[Structure, tuple[Play, Any]] = {}
"""Every loop of this process with what holds its code."""
_locks: dict[Structure, Lock] = {}
"""One for each loop that is being made: different ones are made side by side."""
_steps: dict[Step, Any] = {}
"""What holds the code of each step's loop over its places."""
_absent: set[Structure] = set()
"""Loops that were not on disk when they were asked for: a process looks for each once."""
_numbers = count()
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
                found = _loaded[structure] = _kept(structure) or _made(structure)
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
def _set_up() -> None:
    """Make this machine known to LLVM: a process that only loads code needs it, too."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()


@cache
def _target() -> Any:
    _set_up()
    features = llvm.get_host_cpu_features().flatten()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=3, jit=True)


@cache
def _made_by() -> tuple[str, str]:
    """Return all that decides on the code besides the structure and the versions: its source and the processor."""
    here = Path(__file__).parent
    around = [here.parent / "linear.py", *(here.parent / "effects" / name for name in ("base.py", "compiled.py"))]
    sources = b"".join(path.read_bytes() for path in [*sorted(here.glob("*.py")), *around])
    return sha256(sources).hexdigest(), llvm.get_host_cpu_name() + llvm.get_host_cpu_features().flatten()


def _kept(structure: Structure) -> tuple[Play, Any] | None:
    """Return a loop from disk, or None if it is not there."""
    code = read_entry(entry_name("loop", *_made_by(), structure.text()))
    return None if code is None else _as_loop(code)


def _made(structure: Structure) -> tuple[Play, Any]:
    """Return a loop made now, and keep it on disk."""
    code = _compiled(str(Sample(structure).emit()), structure.steps, several=structure.lanes > 1)
    keep_entry(entry_name("loop", *_made_by(), structure.text()), code)
    _absent.discard(structure)
    return _as_loop(code)


def _as_loop(code: bytes) -> tuple[Play, Any]:
    linked = _linked(code)
    return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(linked[NAME]), linked


def address_of(step: Step) -> int:
    """Return the address of the loop over all places of a step, from this process, from disk, or made now."""
    with _lock:
        if step not in _steps:
            entry = entry_name("places", *_made_by(), step.key)
            code = read_entry(entry)
            if code is None:
                code = _compiled(str(emit_places(step.key, NAME)), (step,))
                keep_entry(entry, code)
            _steps[step] = _linked(code)
        return int(_steps[step][NAME])


def _compiled(text: str, steps: Sequence[Step], *, several: bool = False) -> bytes:
    """Return the object code of an emitted module, in which the steps that it names are inlined."""
    module = llvm.parse_assembly(text)
    called = {function.name for function in module.functions}
    for step in dict.fromkeys(steps):
        if step_symbol(step.key) not in called:
            continue  # it is there for several lanes at once
        own, name = step.alone
        part = llvm.parse_assembly(own)
        part.get_function(name).name = step_symbol(step.key)
        module.link_in(part)
    for function in module.functions:
        if not function.is_declaration and function.name != NAME:
            function.linkage = llvm.Linkage.internal
            if not any(b"noinline" in attribute for attribute in function.attributes):
                function.add_function_attribute("alwaysinline")
    module.triple, module.data_layout = _target().triple, str(_target().target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.slp_vectorization = several  # steps of several benches may share instructions
    builder = llvm.create_pass_builder(_target(), options)
    builder.getModulePassManager().run(module, builder)
    return bytes(_target().emit_object(module))


@cache
def _linker() -> Any:
    _set_up()
    return llvm.create_lljit_compiler(suppress_errors=True)


def _linked(code: bytes) -> Any:
    """Return object code in this process, which gives the address of its function NAME."""
    library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol(NAME)
    return library.link(_linker(), f"code-{next(_numbers)}")
