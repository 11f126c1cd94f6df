"""From an emitted loop to machine code, which is kept on disk beside that of numba: made once on a machine."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from itertools import count
from pathlib import Path
from threading import Lock
from typing import Any

import llvmlite
import numba
from llvmlite import binding as llvm

from sim_backend.effects.compiled import plain
from sim_backend.kernel.called import along
from sim_backend.kernel.sample import NAME, Sample
from sim_backend.kernel.structure import Structure, step_symbol

Play = Callable[[int, int], None]
_lock = Lock()
_loaded: dict[Structure, tuple[Play, Any]] = {}
"""Every loop of this process with what holds its code."""
_numbers = count()


def loop_of(structure: Structure) -> Play:
    """Return the loop of a structure, from this process, from disk, or made now; takes two addresses."""
    found = _loaded.get(structure)
    if found is None:
        with _lock:
            found = _loaded.get(structure)
            if found is None:
                found = _loaded[structure] = _made(structure)
    return found[0]


def is_made(structure: Structure) -> bool:
    """Tell whether the loop of a structure is in this process or on disk."""
    return structure in _loaded or _file(structure).exists()


@cache
def _target() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features().flatten()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=3, jit=True)


@cache
def _made_by() -> str:
    """Return all that decides on the code besides the structure: its source, the compiler, the processor."""
    here = Path(__file__).parent
    around = [here.parent / "linear.py", *(here.parent / "effects" / name for name in ("base.py", "compiled.py"))]
    sources = b"".join(path.read_bytes() for path in [*sorted(here.glob("*.py")), *around])
    cpu = llvm.get_host_cpu_name() + llvm.get_host_cpu_features().flatten()
    return f"{sha256(sources).hexdigest()} {numba.__version__} {llvmlite.__version__} {cpu}"


def _file(structure: Structure) -> Path:
    name = sha256(f"{_made_by()} {structure.text()}".encode()).hexdigest()[:32]
    return Path(str(along.stats.cache_path)) / f"loop-{name}.o"


def _made(structure: Structure) -> tuple[Play, Any]:
    """Return a loop from disk or made now, which is then written to disk where that can be."""
    file = _file(structure)
    try:
        return _load(file.read_bytes())
    except (OSError, RuntimeError):  # it is not there, or damaged
        code = _compiled(structure)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as part:
            part.write(code)
        Path(part.name).replace(file)
    except OSError:
        pass  # a folder that nobody may write to: the next process makes it again
    return _load(code)


def _compiled(structure: Structure) -> bytes:
    module = llvm.parse_assembly(str(Sample(structure).emit()))
    for step in dict.fromkeys(structure.steps):
        text, name = plain(step)
        part = llvm.parse_assembly(text)
        part.get_function(name).name = step_symbol(step.key)
        module.link_in(part)
    for function in module.functions:
        if not function.is_declaration and function.name != NAME:
            function.linkage = llvm.Linkage.internal
            function.add_function_attribute("alwaysinline")
    module.triple, module.data_layout = _target().triple, str(_target().target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.slp_vectorization = False
    builder = llvm.create_pass_builder(_target(), options)
    builder.getModulePassManager().run(module, builder)
    return bytes(_target().emit_object(module))


@cache
def _linker() -> Any:
    return llvm.create_lljit_compiler(suppress_errors=True)


def _load(code: bytes) -> tuple[Play, Any]:
    library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol(NAME)
    linked = library.link(_linker(), f"loop-{next(_numbers)}")
    return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(linked[NAME]), linked
