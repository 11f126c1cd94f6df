"""Models of a bench."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sim_backend.model as core
from mccd.showing import as_html, xarray
from sim_backend.effects.words import effect_text
from sim_backend.errors import ConfigError
from sim_backend.safe_write import write_text

if TYPE_CHECKING:
    import control
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

ComplexArray = NDArray[np.complex128]

POINTS = 400
"""Frequencies of a response that was asked for without any, spaced evenly in their logarithm."""


class Model:
    """A model of a bench; `core` is the content of its file (`sim_backend.model.Model`)."""

    def __init__(self, content: core.Model) -> None:
        self.core = content

    @property
    def name(self) -> str:
        """Its name."""
        return self.core.name

    @property
    def sample_rate_hz(self) -> float:
        """The rate in Hz at which it is played and was identified."""
        return self.core.sample_rate_hz

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(port.name for port in self.core.inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(port.name for port in self.core.outputs)

    def frequency_response(self, frequency_hz: ArrayLike, *, held: bool = False) -> ComplexArray:
        """Return the response of the linear part at frequencies (n_f,) in Hz, shape (n_f, n_outputs, n_inputs).

        It is in output unit per input unit. With `held` it is that from the samples of a held input, as a bench with a
        converter measures it.
        """
        rate_hz = self.sample_rate_hz if held else None
        return self.core.linear().frequency_response(np.asarray(frequency_hz, dtype=float), rate_hz)

    def to_frame(self) -> pd.DataFrame:
        """Return a row per mode: frequency in Hz, damping ratio ζ and decay rate in s⁻¹, with standard deviations.

        A standard deviation is NaN where it is not known; ζ is NaN for a rigid body.
        """
        import pandas as pd

        rows = [_row(mode) for mode in self.core.modes]
        columns = ["frequency_hz", "frequency_std_hz", "zeta", "zeta_std", "decay_rate_1_s", "decay_rate_std_1_s"]
        index = pd.Index([mode.label for mode in self.core.modes], name="mode")
        return pd.DataFrame(rows, columns=columns, index=index)

    def to_xarray(self, frequency_hz: ArrayLike | None = None) -> xr.DataArray:
        """Return the response of the linear part over frequency (Hz), output and input, complex.

        Without `frequency_hz` (n_f,), from a tenth of the lowest mode to half the sample rate. Raises ConfigError
        without xarray.
        """
        f = self._frequencies() if frequency_hz is None else np.asarray(frequency_hz, dtype=float)
        return xarray().DataArray(
            self.frequency_response(f),
            dims=("frequency", "output", "input"),
            coords={
                "frequency": ("frequency", f, {"units": "Hz"}),
                "output": list(self.outputs),
                "input": list(self.inputs),
                "output_unit": ("output", [port.unit for port in self.core.outputs]),
                "input_unit": ("input", [port.unit for port in self.core.inputs]),
            },
            name=self.name,
        )

    def to_control(self) -> control.StateSpace:
        """Return the linear part as a continuous `control.StateSpace`, inputs and outputs in the order of the ports.

        Raises ConfigError when an input has a delay, which a state space cannot hold.
        """
        from analysis.linear.exchange import to_control

        system = to_control(self.core.linear())
        system.set_inputs(list(self.inputs))
        system.set_outputs(list(self.outputs))
        return system

    def plot(self) -> Figure:
        """Return the Bode diagram of the linear part, magnitude and phase of every entry."""
        from analysis.identification.bode import bode

        return bode(self.core, ())

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the model as TOML; raises ConfigError for an existing file unless `force` replaces it."""
        target = Path(path)
        if target.exists() and not force:
            raise ConfigError(f"{target} exists and would be overwritten; choose another path or give force=True")
        return write_text(target, core.dump_model(self.core))

    def __repr__(self) -> str:
        return f"<Model {self.name}: {len(self.core.modes)} modes, {len(self.core.effects)} effects>"

    def _repr_html_(self) -> str:
        effects = ", ".join(f"{effect_text(e.effect)} at {e.where}" for e in self.core.effects)
        ports = f"{', '.join(self.inputs)} → {', '.join(self.outputs)}, {self.sample_rate_hz:g} Hz"
        return as_html(f"Model {self.name}", [ports, *([f"effects: {effects}"] if effects else [])], self.to_frame())

    def _frequencies(self) -> NDArray[np.float64]:
        own = [hz for mode in self.core.modes if (hz := core.number(mode.frequency_hz)) > 0.0]
        low = 0.1 * min(own, default=1e-3 * self.sample_rate_hz)
        return np.geomspace(min(low, 0.1 * self.sample_rate_hz), 0.5 * self.sample_rate_hz, POINTS)


def load_model(model: str | Path) -> Model:
    """Return a bundled model by its name, or the model in a TOML or JSON file, or in a text of such a file.

    A string of more than one line is such a text. Raises ConfigError for what is none of them.
    """
    if isinstance(model, str) and "\n" in model:
        return Model(core.parse_model(model, "the given text"))
    return Model(core.load_model(model))


def core_model(model: Model | core.Model | str | Path) -> core.Model:
    """Return the content of a model, whichever way it is given; raises ConfigError for a file that is none."""
    if isinstance(model, Model):
        return model.core
    return model if isinstance(model, core.Model) else core.load_model(model)


def _row(mode: core.Mode) -> list[float]:
    known = (*core.with_std(mode.frequency_hz), *mode.damping_ratio(), *core.with_std(mode.decay_rate_1_s))
    return [math.nan if value is None else value for value in known]
