"""What `mccd` offers to programs and notebooks: one verb for each command, results that other libraries take.

    import mccd

    run = mccd.read_run("run.h5")                       # or mccd.simulate("design", "freerun")
    found = mccd.identify(run, modes=2)
    answer = mccd.diagnose(run, found.model)
    answer.verdict, answer.to_frame(), answer.plot()

Values are in SI units and names contain the unit (`rate_hz`). Errors that a user can act on are `mccd.MccdError`s. Each
name is loaded when it is first used: importing `mccd` costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mccd.designed import Controller, design
    from mccd.diagnosed import Arrays, Diagnosis, diagnose
    from mccd.identified import Identification, identify
    from mccd.models import Model, load_model
    from mccd.runs import Run, read_run, simulate
    from sim_backend.errors import MccdError

_PLACES = {
    "Arrays": "mccd.diagnosed",
    "Controller": "mccd.designed",
    "Diagnosis": "mccd.diagnosed",
    "Identification": "mccd.identified",
    "MccdError": "sim_backend.errors",
    "Model": "mccd.models",
    "Run": "mccd.runs",
    "design": "mccd.designed",
    "diagnose": "mccd.diagnosed",
    "identify": "mccd.identified",
    "load_model": "mccd.models",
    "read_run": "mccd.runs",
    "simulate": "mccd.runs",
}

__all__ = [
    "Arrays",
    "Controller",
    "Diagnosis",
    "Identification",
    "MccdError",
    "Model",
    "Run",
    "design",
    "diagnose",
    "identify",
    "load_model",
    "read_run",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from campaigns.version import tool_version

        return tool_version()
    if name not in _PLACES:
        raise AttributeError(f"module 'mccd' has no attribute {name!r}")
    found = getattr(import_module(_PLACES[name]), name)
    globals()[name] = found  # from now on found at once
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
