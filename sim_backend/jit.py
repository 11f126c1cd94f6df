"""Functions compiled by numba when they are first called, not when they are imported; their code is kept on disk.

`njit`, `cfunc` and `intrinsic` replace numba's decorators of the same names and differ in three ways:

- numba itself is imported with the first call: a command that computes nothing does not wait for it.
- The code is kept in `sim_backend.kernel_cache`, with a digest that is checked before it is used. numba's own cache
  loads whatever is there, and two processes that fill it at once may take each other's code.
- What is kept goes by everything that was compiled: the function, all kernels that it calls, and the values of the
  globals that it reads. numba's cache sees the function's own file alone.
"""

from __future__ import annotations

import dis
import pickle
import platform
from collections.abc import Callable, Iterator
from functools import cache, cached_property, update_wrapper
from hashlib import sha256
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import RLock
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast, overload

import numpy as np

from sim_backend.kernel_cache import keep_entry, read_entry

_making = RLock()
"""Held while a kernel is made: threads that need the same one wait for it."""


class Deferred:
    """An attribute of a module that is imported only when a kernel that uses it is compiled.

    The module's text and the versions of libraries stand for its value: it must import nothing of this project.
    """

    def __init__(self, module: str, attribute: str) -> None:
        self._module, self._attribute = module, attribute

    @cached_property
    def made(self) -> Any:
        """The attribute itself."""
        return getattr(import_module(self._module), self._attribute)

    def stamp(self) -> str:
        """Return its name with a digest of its module's text: who loads kept code does not import the module."""
        spec = find_spec(self._module)
        written = Path(spec.origin) if spec is not None and spec.origin else Path()
        text = written.read_bytes() if written.suffix == ".py" else b""
        return f"{self._module}.{self._attribute} {sha256(text).hexdigest()}"


class _Later:
    """A Python function of which something is made on first use."""

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        update_wrapper(cast(Any, self), function)
        self.py_func: Any = function
        self._options = options
        self._made: Any = None

    @property
    def made(self) -> Any:
        """What it is made into."""
        if self._made is None:
            with _making:
                if self._made is None:
                    self._made = self._make()
        return self._made

    def _make(self) -> Any:
        raise NotImplementedError

    def stamp(self, above: frozenset[Any] = frozenset()) -> str:
        """Return a digest of all that decides on the code of this function, which those `above` read."""
        return _stamp(self.py_func, self._options, above | {self})


class Kernel(_Later):
    """A function that `numba.njit` compiles for the types of its first call."""

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function."""
        return (self._made or self.made)(*arguments)

    def _make(self) -> Any:
        import numba

        dispatcher: Any = numba.njit(**self._options)(_resolved(self.py_func))
        dispatcher._cache = _Kept(self)  # noqa: SLF001 numba has no other way to choose where code is kept
        return dispatcher


class Callback(_Later):
    """A function for callers in C; `signature` is numba's, as text.

    Its machine code comes from `sim_backend.machine_code`, without numba where it is kept.
    """

    def __init__(self, function: Callable[..., Any], signature: str, **options: Any) -> None:
        super().__init__(function, signature=signature, **options)

    @property
    def alone(self) -> tuple[str, str]:
        """The function as LLVM's text, and its name there; numba translates it now."""
        # numba forbids to inline what it wraps for callers in C
        return self.made.inspect_llvm().replace("noinline", "alwaysinline"), self.made.native_name

    def _make(self) -> Any:
        from numba.core.ccallback import CFunc
        from numba.core.sigutils import normalize_signature

        options = {"nopython": True, **self._options}
        signature = normalize_signature(options.pop("signature"))
        made: Any = CFunc(_resolved(self.py_func), signature, {}, options)
        made.compile()
        return made


class Intrinsic(_Later):
    """A function that emits LLVM's instructions, by `numba.extending.intrinsic`."""

    def __call__(self, *arguments: Any) -> Any:
        """Say that only kernels may call it."""
        raise TypeError(f"{self.py_func.__name__} can only be called inside a kernel")

    def _make(self) -> Any:
        from numba.extending import intrinsic as made_by_numba

        return made_by_numba(_resolved(self.py_func))


@overload
def njit(function: Callable[..., Any], /) -> Kernel: ...
@overload
def njit(**options: Any) -> Callable[[Callable[..., Any]], Kernel]: ...
def njit(function: Callable[..., Any] | None = None, /, **options: Any) -> Any:
    """Return `function` as a Kernel that runs without the interpreter's lock; `options` are those of `numba.njit`."""
    options = {"nogil": True, **options}
    return Kernel(function, **options) if function else lambda given: Kernel(given, **options)


def cfunc(signature: str, **options: Any) -> Callable[[Callable[..., Any]], Callback]:
    """Return a decorator that makes a Callback of numba's `signature`, "void(intp, CPointer(float64))" for example."""
    return lambda function: Callback(function, signature, **options)


def intrinsic(function: Callable[..., Any]) -> Any:
    """Return `function` as an Intrinsic; kernels call it without its first argument, the typing context."""
    return Intrinsic(function)


def _resolved(function: Any) -> Any:
    """Return a copy of a Python function in which its kernels are replaced by what they are made into."""
    used = set(_globals_of(function.__code__))
    found = {name: value for name, value in function.__globals__.items() if name in used}
    made = {name: value.made for name, value in found.items() if isinstance(value, _Later | Deferred)}
    copy = FunctionType(
        function.__code__,
        {**function.__globals__, **made},
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copy.__qualname__ = function.__qualname__
    return copy


def _globals_of(code: CodeType) -> Iterator[str]:
    """Give every global that a code object reads, also in functions inside it."""
    yield from (i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL")
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _globals_of(constant)


def _names_of(code: CodeType) -> Iterator[str]:
    """Give every name that may be a global of a code object, also in functions inside it, or else an attribute's.

    Instructions would show which, at ten times the time, in every process.
    """
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names_of(constant)


def _stamp(function: Any, options: Any, above: frozenset[Any]) -> str:
    """Return a digest of a function's code, its options and, one by one, the globals of the names that occur in it."""
    used = sorted(set(_names_of(function.__code__)) & set(function.__globals__))
    chosen = [(name, sorted(value) if isinstance(value, set) else value) for name, value in sorted(options.items())]
    parts = [_code(function.__code__), chosen, function.__module__, function.__qualname__]
    parts += [(name, _value(function.__globals__[name], above)) for name in used]
    parts += [_value(cell.cell_contents, above) for cell in function.__closure__ or ()]
    return sha256(repr(parts).encode()).hexdigest()


def _code(code: CodeType) -> list[Any]:
    constants = [_code(c) if isinstance(c, CodeType) else repr(c) for c in code.co_consts]
    return [code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars]


def _value(value: Any, above: frozenset[Any]) -> str:
    """Return what a global is, as text that changes whenever the code that reads it would."""
    if isinstance(value, _Later):
        return "itself" if value in above else value.stamp(above)
    if isinstance(value, Deferred):
        return value.stamp()
    if isinstance(value, ModuleType):
        return value.__name__
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, FunctionType):
        return _stamp(value, {}, above)
    return repr(value)


class _Kept:
    """What numba asks of the cache of one function."""

    cache_path = None

    def __init__(self, owner: _Later) -> None:
        self._label, self._stamp = owner.py_func.__name__.strip("_"), owner.stamp()

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return what was compiled for a signature, or None."""
        from numba.core.compiler import CompileResult

        target_context.refresh()
        data = read_entry(self._name(signature, target_context.codegen()))
        # the digest has been checked: it is what this program has written
        return None if data is None else CompileResult._rebuild(target_context, *pickle.loads(data))  # noqa: SLF001

    def save_overload(self, signature: Any, made: Any) -> None:
        """Keep what was compiled for a signature, unless it holds addresses of this process."""
        from numba.core.serialize import dumps

        if any(not lifted.can_cache for lifted in made.lifted) or made.library.has_dynamic_globals:
            return
        keep_entry(self._name(signature, made.codegen), dumps(made._reduce()))  # noqa: SLF001

    def _name(self, signature: Any, codegen: Any) -> str:
        return entry_name(self._label, self._stamp, str(signature), repr(codegen.magic_tuple()))


def entry_name(label: str, *decides: str) -> str:
    """Return the name of an entry of the kernel cache: `label`, and a digest of all that decides on the code."""
    return f"{label}-{sha256(repr((_versions(), decides)).encode()).hexdigest()[:32]}"


@cache
def _versions() -> tuple[str, ...]:
    """Return the versions of what makes the code, without importing numba: who loads a kept loop does not need it."""
    return platform.python_version(), _version("numba"), _version("llvmlite"), np.__version__


def _version(library: str) -> str:
    """Return what tells one version of a library from another: the text that states it."""
    spec = find_spec(library)
    if spec is not None and spec.origin and (stated := Path(spec.origin).with_name("_version.py")).is_file():
        return sha256(stated.read_bytes()).hexdigest()
    from importlib.metadata import version  # takes 20 ms, which a process that only plays need not wait for

    return version(library)
