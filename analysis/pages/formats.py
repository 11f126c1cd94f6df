"""Numbers as a reader wants them: as many digits as their uncertainty or the paper's number carries, no more."""

from __future__ import annotations

import math
import re

from sim_backend.axis_names import with_axes

_EXACT = 1e-6
"""Standard deviation, as a part of the number, below which it is not worth printing."""

NONE = "—"
"""What stands where there is no number."""


def shown(value: float | None, like: float | None = None, std: float | None = None) -> str:
    """Return a number as text, to two digits of its standard deviation or else to one digit more than `like`.

    Neither given: four significant digits. None becomes a dash, infinity the word never.
    """
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "never"
    if value == 0.0:
        return "0"
    last = math.floor(math.log10(abs(value))) - 3
    if std is not None and 0.0 < std < math.inf:
        last = max(math.floor(math.log10(std)) - 1, last - 6)
    elif like is not None:
        last = _last_digit(like) - 1
        last = min(last, math.floor(math.log10(abs(value))) - 1)
    return rounded(value, last)


def exact(value: float | None) -> str:
    """Return a printed number with the digits it was printed with."""
    if value is None:
        return NONE
    if value == 0.0:
        return "0"
    return _signed(f"{value:.10g}") if 1e-3 <= abs(value) < 1e5 else _power(f"{value:.7g}", value)


def rounded(value: float, last: int) -> str:
    """Return a number rounded to the power of ten `last`, in powers of ten where it is very large or small."""
    size = math.floor(math.log10(abs(value))) if value else 0
    if -4 <= size < 5:
        return _signed(f"{round(value, -last):.{max(-last, 0)}f}")
    return _power(f"{value:.{max(size - last, 0)}e}", value)


def readable(value: float, digits: int = 3) -> str:
    """Return a number with so many digits, never as 3.3e+04: 33,000, 3.3·10⁷ or 2.1·10⁻⁵."""
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return _signed(text)
    return _signed(f"{float(text):,.0f}") if 0 < int(text.partition("e")[2]) < 6 else _power(text, value)


def known_exactly(value: float, std: float | None) -> bool:
    """Tell whether a number is known beyond any use: a step that every reading is a multiple of, for one."""
    return std is not None and std < _EXACT * abs(value)


def fit_percent(error: float) -> str:
    """Return a relative error (rms ÷ rms) as the fit that it leaves, in percent to two digits of what is missing.

    An error as large as the output leaves no fit; one below 0.001 % is given as a bound.
    """
    missing = abs(100.0 * error)
    if not math.isfinite(missing):
        return NONE
    if missing >= 100.0:
        return "no fit"
    if 0.0 < missing < 1e-3:
        return "above 99.999 %"
    digits = 1 if missing == 0.0 else max(1 - math.floor(math.log10(missing)), 1)
    return _signed(f"{100.0 * (1.0 - error):.{digits}f} %")


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: N m/rad³ for N m/rad^3, nothing for 1."""
    return "" if unit == "1" else re.sub(r"\^(-?\d+)", lambda found: "".join(_SUPER[c] for c in found[1]), unit)


_EXPONENT = re.compile(r"(?<![\w./-])-?\d+(?:\.\d+)?e[+-]\d+(?![\w/]|\.\w)")
_MINUS = re.compile(r"(?:(?<=[\s(±])|^)-(?=\d)")


def without_exponents(text: str) -> str:
    """Return a text whose numbers like 3.3e+04 read 33,000, with the digits that they have.

    What has no sign before its exponent is none of Python's numbers: 12e45678 is the name of a run.
    """

    def written(found: re.Match[str]) -> str:
        digits = len(found[0].partition("e")[0].replace("-", "").replace(".", ""))
        value = float(found[0])
        return readable(value, digits) if math.isfinite(value) else found[0]

    return _EXPONENT.sub(written, text)


def printed(text: str) -> str:
    """Return a text as a page prints it: axes by their signs, numbers without exponents, minus signs for hyphens."""
    return _MINUS.sub("−", with_axes(without_exponents(text)))


def _power(text: str, value: float) -> str:
    mantissa, _, exponent = f"{float(text):e}".partition("e")
    digits = text.partition("e")[0] if "e" in text else mantissa.rstrip("0").rstrip(".")
    return _signed(f"{digits}·10") + "".join(_SUPER[c] for c in str(int(exponent)))


_SUPER = dict(zip("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹", strict=True))


def _signed(text: str) -> str:
    return text.replace("-", "−")


def _last_digit(value: float) -> int:
    """Power of ten of the last significant digit that a number was written with."""
    text = f"{abs(value):.10g}"
    mantissa, _, exponent = text.partition("e")
    whole, _, fraction = mantissa.partition(".")
    power = int(exponent) if exponent else 0
    if fraction:
        return power - len(fraction)
    return power + len(whole) - len(whole.rstrip("0")) if value else 0
