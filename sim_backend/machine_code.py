"""LLVM's text to machine code, kept on disk: a process that finds its code there needs neither LLVM nor numba."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from hashlib import sha256
from itertools import count, takewhile
from pathlib import Path
from threading import Lock
from typing import Any, Protocol

from sim_backend.jit import Callback, entry_name
from sim_backend.kernel_cache import keep_entry, read_entry
from sim_backend.object_code import Linked, in_memory

NAME = "play"
"""Name of the function that machine code is made of; what it calls is inlined or hidden."""

Part = tuple[str, str]
"""The text of a module, and the name of the function in it that is meant."""

_lock = Lock()
_callbacks: dict[Callback, Linked] = {}
"""Each callback of this process."""
_numbers = count()


@cache
def _llvm() -> Any:
    """Return LLVM's interface, loaded now, for this machine: nothing needs it before something is compiled."""
    from llvmlite import binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding


@cache
def _target() -> Any:
    llvm = _llvm()
    features = llvm.get_host_cpu_features().flatten()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=3, jit=True)


@cache
def made_by() -> tuple[str, str]:
    """Return what decides on all machine code besides versions and its own source: this file and the processor."""
    return sha256(Path(__file__).read_bytes()).hexdigest(), _processor()


_ASKED_FOR = ("vendor_id", "cpu family", "model", "flags")
"""What LLVM asks a processor for, in the names by which Linux tells it on x86-64."""


def _processor() -> str:
    """Return what LLVM goes by when it compiles for this processor, as stated by the system or else by LLVM itself."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            first = [line.partition(":") for line in takewhile(str.strip, file)]
    except OSError:
        first = []
    told = {name.strip(): value.strip() for name, _, value in first}
    if all(name in told for name in _ASKED_FOR):
        return repr([told[name] for name in _ASKED_FOR])
    llvm = _llvm()
    return str(llvm.get_host_cpu_name() + llvm.get_host_cpu_features().flatten())


class Translated(Protocol):
    """A function that numba translates to a module's text when it is asked for."""

    @property
    def alone(self) -> Part:
        """The text, and the function's name there."""


def compiled(whole: Part, parts: Mapping[str, Translated], *, several: bool = False) -> bytes:
    """Return the object code of a function, which is called NAME there.

    `parts` are the functions that it may call and does not have, by the names it uses; those that it does not call are
    not translated. `several` looks for steps that
    can share instructions.
    """
    llvm = _llvm()
    module = _read(whole, NAME)
    called = {function.name for function in module.functions}
    for symbol, part in parts.items():
        if symbol in called:
            module.link_in(_read(part.alone, symbol))
    for function in module.functions:
        if not function.is_declaration and function.name != NAME:
            function.linkage = llvm.Linkage.internal
            if not any(b"noinline" in attribute for attribute in function.attributes):
                function.add_function_attribute("alwaysinline")
    module.triple, module.data_layout = _target().triple, str(_target().target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.slp_vectorization = several
    builder = llvm.create_pass_builder(_target(), options)
    builder.getModulePassManager().run(module, builder)
    return bytes(_target().emit_object(module))


def _read(part: Part, symbol: str) -> Any:
    """Return a module, its function by another name."""
    text, name = part
    module = _llvm().parse_assembly(text)
    module.get_function(name).name = symbol
    return module


@cache
def _linker() -> Any:
    return _llvm().create_lljit_compiler(suppress_errors=True)


def linked(code: bytes) -> Linked:
    """Return the function NAME of object code in this process."""
    return in_memory(code, NAME) or _linked_by_llvm(code)


def _linked_by_llvm(code: bytes) -> Linked:
    library = _llvm().JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol(NAME)
    made = library.link(_linker(), f"code-{next(_numbers)}")
    return Linked(made[NAME], made)


def kept_or_made(entry: str, make: Callable[[], bytes]) -> bytes:
    """Return object code from disk, or what `make` returns, kept there."""
    code = read_entry(entry)
    if code is None:
        code = make()
        keep_entry(entry, code)
    return code


def address_of(callback: Callback) -> int:
    """Return the address of a callback, from this process, from disk, or made now."""
    with _lock:
        if callback not in _callbacks:
            entry = entry_name(callback.py_func.__name__.strip("_"), *made_by(), callback.stamp())
            _callbacks[callback] = linked(kept_or_made(entry, lambda: compiled(callback.alone, {})))
        return _callbacks[callback].address
