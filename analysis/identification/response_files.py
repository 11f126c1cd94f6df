"""Files of frequency responses: a CSV table with uncertainty, and Touchstone-like text, there and back."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from analysis.identification.response_curves import ResponseCurve, require_new, save_curves
from campaigns.spreadsheet import as_named
from sim_backend.errors import ConfigError, DataError
from sim_backend.safe_write import write_text
from sim_backend.small_files import TABLE_BYTES, read_small, read_small_text

_COLUMNS = list(ResponseCurve.__dataclass_fields__)
_NAMES = re.compile(r"^!\s*(inputs|outputs):\s*(.*)$")


def save_response(curves: tuple[ResponseCurve, ...], path: Path) -> None:
    """Write a response as `.csv` (with uncertainty) or `.sNp` (Touchstone-like, without).

    Raises ConfigError for another ending, no curves, or a file that exists.
    """
    if path.suffix.lower() == ".csv":
        save_curves(curves, path)
        return
    if not re.fullmatch(r"\.s\d+p", path.suffix.lower()):
        raise ConfigError(
            f"{path}: '{path.suffix}' is not a format of responses; use .csv, or .s1p, .s2p … for N inputs"
        )
    require_new(curves, path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, _touchstone(curves, path))


def load_response(path: Path) -> tuple[ResponseCurve, ...]:
    """Return the curves in a file that `save_response` or another program has written.

    Touchstone text may have magnitude and angle, dB and angle, or real and imaginary part, in Hz to GHz; what it does
    not hold (uncertainty) is NaN. Raises DataError for a file that cannot be understood.
    """
    try:
        if path.suffix.lower() == ".csv":
            return _from_csv(path)
        return _from_touchstone(path)
    except (OSError, UnicodeDecodeError, ValueError, KeyError, IndexError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise DataError(f"{path}: no frequency response ({reason}); see docs/how-to/exchange.md") from None


def _from_csv(path: Path) -> tuple[ResponseCurve, ...]:
    import pandas as pd  # a third of a second, which only this needs

    table = pd.read_csv(io.BytesIO(read_small(path, TABLE_BYTES)))
    missing = [name for name in _COLUMNS if name not in table]
    if missing:
        raise ValueError(f"no column {missing[0]}")
    return tuple(
        ResponseCurve(
            as_named(str(output)), as_named(str(input_)), *(part[name].to_numpy(dtype=float) for name in _COLUMNS[2:])
        )
        for (output, input_), part in table.groupby(["output", "input"], sort=False)
    )


def _touchstone(curves: tuple[ResponseCurve, ...], path: Path) -> str:
    """Return the text: rows of frequency and all entries, output by output, as real and imaginary part."""
    outputs, inputs = (list(dict.fromkeys(getattr(c, name) for c in curves)) for name in ("output", "input"))
    ports = max(len(outputs), len(inputs))
    if path.suffix.lower() != f".s{ports}p":
        raise ConfigError(f"{path}: {len(inputs)} inputs and {len(outputs)} outputs need the ending .s{ports}p")
    by_entry = {(c.output, c.input): c for c in curves}
    f = curves[0].frequency_hz
    columns = [f]
    for i, j in _order(ports):
        entry = by_entry.get((outputs[i], inputs[j])) if i < len(outputs) and j < len(inputs) else None
        value = np.zeros(f.size, complex) if entry is None else entry.magnitude * np.exp(1j * entry.phase_rad)
        columns += [value.real, value.imag]
    head = [
        "! frequency response, output per input in SI units, no scattering parameters",
        f"! inputs: {' '.join(inputs)}",
        f"! outputs: {' '.join(outputs)}",
        "# Hz H RI",
    ]
    rows = [" ".join(f"{x:.17g}" for x in row) for row in np.column_stack(columns)]
    return "\n".join([*head, *rows]) + "\n"


def _from_touchstone(path: Path) -> tuple[ResponseCurve, ...]:
    found = re.fullmatch(r"\.s(\d+)p", path.suffix.lower())
    if not found:
        raise ValueError(f"'{path.suffix}' is neither .csv nor .sNp")
    ports = int(found[1])
    names: dict[str, list[str]] = {}
    scale, form, numbers = 1e9, "MA", []  # what Touchstone says when the file does not
    for line in read_small_text(path, TABLE_BYTES).splitlines():
        if named := _NAMES.match(line):
            names[named[1]] = named[2].split()
        text = line.partition("!")[0].strip()
        if text.startswith("#"):
            words = text[1:].upper().split()
            scale = next((s for w, s in (("HZ", 1.0), ("KHZ", 1e3), ("MHZ", 1e6), ("GHZ", 1e9)) if w in words), scale)
            form = next((w for w in ("RI", "MA", "DB") if w in words), form)
        elif text:
            numbers += [float(word) for word in text.split()]
    table = np.array(numbers).reshape(-1, 1 + 2 * ports**2)
    first, second = table[:, 1::2], table[:, 2::2]
    if form == "RI":
        values = first + 1j * second
    else:
        values = (first if form == "MA" else 10.0 ** (first / 20.0)) * np.exp(1j * np.deg2rad(second))
    ins = names.get("inputs", [f"input {j + 1}" for j in range(ports)])
    outs = names.get("outputs", [f"output {i + 1}" for i in range(ports)])
    unknown = np.full(table.shape[0], np.nan)
    return tuple(
        ResponseCurve(out, in_, table[:, 0] * scale, np.abs(v), np.angle(v), unknown, unknown)
        for i, out in enumerate(outs)
        for j, in_ in enumerate(ins)
        for v in [values[:, _order(ports).index((i, j))]]
    )


def _order(ports: int) -> list[tuple[int, int]]:
    """Output and input of every entry in the order of a row: by output, but for two ports Touchstone's own order."""
    if ports == 2:
        return [(0, 0), (1, 0), (0, 1), (1, 1)]
    return [(i, j) for i in range(ports) for j in range(ports)]
