"""Broadband disturbance: a hump in the spectrum of the noise that has the shape of a torque through the plant.

The spectrum of what does not repeat is fitted with a smooth noise floor of each output, alone and with |G|² times a
resonator's spectrum on top. The floor is a polynomial over the logarithm of the frequency, whose number of terms
Akaike's criterion chooses. A torque of all frequencies, or of all up to some corner, is an amplifier's noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.fitting.fit import Fit, Setting, linear_of
from analysis.diagnosis.fitting.starts import without_starts
from analysis.diagnosis.noise.whitener import Bands
from analysis.diagnosis.search.shortlist import SURE_LEAD
from analysis.diagnosis.tails import chi2_tail
from analysis.diagnosis.variance.chance import Chance
from analysis.diagnosis.variance.spectrum import Series, series_of, spectrum_of
from analysis.diagnosis.variance.torques import Start
from analysis.diagnosis.variance.whittle import Band, Whittle
from sim_backend.effects.amplifier_noise import AmplifierNoise
from sim_backend.effects.broadband_vibration import BroadbandVibration
from sim_backend.effects.command_quantisation import CommandQuantisation
from sim_backend.linear import Array, ModalModel

_ORDERS = (4, 6, 8, 10, 12)
"""Terms of the floor's polynomial."""

_PITCH, _WIDTH, _FIRST_TERMS = 1.4, 0.3, 6
"""Grid of starts: ratio of neighbouring centres, width in parts of the centre, and terms of the floor below."""

_STARTS = 3
"""Bands of the grid, per input, that are fitted over every floor."""

_CORNERS = 4
"""Corners of a low pass are tried at every so many centres of the grid: its likelihood has few maxima."""

_NARROW = 4.0
"""A band narrower than so many times the frequency resolution is a line, which is another effect."""

_THERE = 0.1
"""Part of the filtered noise from which a band makes it louder."""

_CHUNK = 2048
"""Whether the band is there as well when little moves is seen on chunks of so many samples."""

_AS_STRONG = 0.5
"""A band is the same noise at two locations where it has at least this part of its power at either."""


def broadband(setting: Setting, fit: Fit) -> list[Chance]:
    """Return the broadband vibration that the noise shows, if there is one."""
    series, whittle, found = _looked_for(setting, fit)
    if whittle is None or found is None:
        return []
    linear = linear_of(setting, fit)
    if not (_steady(setting, linear, series, found.band) and _random(setting, linear, series, found.band)):
        return []
    place = setting.places.inputs[found.band.input]
    there = [e for e in (*setting.known, *fit.effects) if isinstance(e, BroadbandVibration) and not e.is_neutral()]
    known = any(e.where == place for e in there)
    # such noise through the plant is an amplifier's, white or behind a low pass, which is no error of a simulation; nor
    # is a reading's own, which as the likelier one leaves nothing to name
    if known or found.lead < -SURE_LEAD or found.reading_lead < 0.0:
        return []
    return [_chance(setting, whittle, found, place)]


@dataclass(frozen=True)
class NoiseEvidence:
    """The logarithm of the evidence of what does not repeat: under the best `floor`, and what a torque's `band` adds.

    `low_hz` to `high_hz` is where that band lies, nowhere if there is none.
    """

    floor: float = 0.0
    band: float = 0.0
    low_hz: float = 0.0
    high_hz: float = 0.0

    @property
    def total(self) -> float:
        """The evidence with the band, if it has any."""
        return self.floor + self.band


def noise_evidence(setting: Setting, fit: Fit) -> NoiseEvidence:
    """Return the evidence of what does not repeat under the best floor, with or without a torque."""
    _, whittle, found = _looked_for(setting, fit)
    if whittle is None:
        return NoiseEvidence()
    floor = _nothing(whittle)[0]
    # the noise of an amplifier may be the better one
    evidence = found.evidence + max(-found.lead, 0.0) if found else 0.0
    if found is None or evidence <= 0.0:
        return NoiseEvidence(floor)
    centre, width = found.band.centre_hz, found.band.width_hz
    return NoiseEvidence(floor, evidence, centre - width, centre + width)


def _looked_for(setting: Setting, fit: Fit) -> tuple[list[Series], Whittle | None, _Best | None]:
    """Return what does not repeat, its likelihood and the best band in it, computed once.

    Lines are compared with a band, and then the band itself is examined.
    """

    def looked() -> tuple[Fit, list[Series], Whittle | None, _Best | None]:
        series = _series(setting, fit)
        whittle = _whittle(setting, fit, [one.rows for one in series])
        found = None if whittle is None else _best(whittle, _resolution(setting, series))
        return fit, series, whittle, found  # with the fit itself, so that no other one gets its number

    return setting.once.of(("band", id(fit)), looked)[1:]


def _series(setting: Setting, fit: Fit) -> list[Series]:
    # a start rings in the modes, as a random torque does, but once
    linear = linear_of(setting, fit)
    rest = without_starts(setting.data, linear, setting.whitener, fit.residuals)
    return [
        part
        for record, residual in zip(setting.data.records, rest, strict=True)
        for part in series_of(setting, record, _white(setting, residual))
    ]


def _whittle(setting: Setting, fit: Fit, series: Sequence[Array]) -> Whittle | None:
    spectrum = spectrum_of(setting, series)
    return None if spectrum is None else Whittle.of(spectrum, linear_of(setting, fit), setting.data.rate_hz)


def _resolution(setting: Setting, series: Sequence[Series]) -> float:
    return setting.data.rate_hz / max(one.rows.shape[0] for one in series)


def _white(setting: Setting, residual: Array) -> Array:
    columns = [setting.whitener.apply(residual[:, o, None], o)[:, 0] for o in setting.whitener.outputs]
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class _Best:
    """The best band with its evidence against nothing, its p-value, and its lead.

    `lead` is by how much the noise of an amplifier trails, white or behind a low pass, `white_lead` white noise alone,
    `reading_lead` a band of a reading's own noise, which does not pass through the plant.
    """

    band: Band
    evidence: float
    p_value: float
    lead: float
    white_lead: float
    reading_lead: float


def _best(whittle: Whittle, resolution_hz: float) -> _Best | None:
    nothing, floors = _nothing(whittle)
    price, n_y = _price(whittle), whittle.gain.shape[0]
    flexible = max(value for _, value in floors.values())
    terms = min(_FIRST_TERMS, max(floors))
    starts, tried = _starts(whittle, floors[terms][0], terms)
    best: dict[tuple[int, bool, bool], tuple[float, Band]] = {}
    for terms, (floor, _) in floors.items():
        for band in whittle.bands(terms, starts, floor):
            if band is None or band.width_hz < _NARROW * resolution_hz:
                continue
            value = band.log_likelihood - n_y * terms - price - _narrowed(whittle, band)
            key = band.input, band.low_pass, band.steep
            if key not in best or value > best[key][0]:
                best[key] = value, band
    if not best:
        return None
    finite = [key for key in best if not key[1]]
    if not finite:
        return None
    top = max(finite, key=lambda k: best[k][0])
    value, band = best[top]
    # against the most flexible floor of all, at any point of the grid
    p_value = min(tried * float(chi2_tail(2.0 * max(band.log_likelihood - flexible, 0.0), 3)), 1.0)
    forms = [(v - value, other) for key, (v, other) in best.items() if key[:2] == top[:2]]
    white = max((v for v, other in best.values() if math.isinf(other.width_hz)), default=-math.inf)
    passed = max((v for v, other in best.values() if other.low_pass), default=-math.inf)
    own = band.log_likelihood - n_y * band.terms - _of_readings(whittle, band, floors)
    return _Best(_blended(band, forms), value - nothing, p_value, value - passed, value - white, own)


def _of_readings(whittle: Whittle, band: Band, floors: Mapping[int, tuple[Array, float]]) -> float:
    """Return the log-likelihood, less a floor's terms, of the best band like this one in the noise of one reading.

    Where the plant is smooth over a band, a torque in it and a reading's own hum look alike.
    """
    n_y = whittle.gain.shape[0]
    straight = np.zeros((n_y, n_y, *whittle.gain.shape[2:]))
    straight[np.arange(n_y), np.arange(n_y)] = 1.0
    alone = replace(whittle, gain=straight)
    best = -math.inf
    places = [(o, band.centre_hz, band.width_hz, steep) for o in range(n_y) for steep in (True, False)]
    for terms, (floor, _) in floors.items():
        found = alone.bands(terms, _as_strong_as(alone, floor, places), floor)
        best = max(best, *(-math.inf if one is None else one.log_likelihood - n_y * terms for one in found))
    return best


def _price(whittle: Whittle) -> float:
    """Return what one parameter costs: half the logarithm of all numbers."""
    return 0.5 * math.log(float(whittle.spectrum.count.sum()) * whittle.spectrum.power.shape[0])


def _nothing(whittle: Whittle) -> tuple[float, dict[int, tuple[Array, float]]]:
    """Return the evidence of the best floor alone, and every floor with its log-likelihood by its terms.

    A term costs one (Akaike 1974): a floor that is too stiff would pull a band aside.
    """
    orders = [k for k in _ORDERS if 3 * k < whittle.spectrum.count.size]
    floors = {k: whittle.floor(k) for k in orders or _ORDERS[:1]}
    n_y = whittle.gain.shape[0]
    return max(value - n_y * k for k, (_, value) in floors.items()), floors


def _blended(band: Band, forms: Sequence[tuple[float, Band]]) -> Band:
    """Return `band` with its numbers averaged over both shapes of its flanks, and their scatter in its deviations."""
    weight = np.exp([v for v, _ in forms])
    weight /= weight.sum()
    values = np.array([[b.rms, b.centre_hz, b.width_hz] for _, b in forms])
    if not np.all(np.isfinite(values)):
        return band
    mean = weight @ values
    std = np.sqrt(weight @ (np.array([b.std for _, b in forms]) ** 2 + (values - mean) ** 2))
    return replace(
        band,
        rms=float(mean[0]),
        centre_hz=float(mean[1]),
        width_hz=float(mean[2]),
        std=(float(std[0]), float(std[1]), float(std[2])),
    )


def _narrowed(whittle: Whittle, band: Band) -> float:
    """Return the logarithm by which the data narrow what is free of centre and width, of any size at first."""
    f = whittle.spectrum.frequency_hz
    room = math.log(float(f[-1, -1]) / float(f[0, 0]))
    sizes = () if math.isinf(band.width_hz) else (2,) if band.low_pass else (1, 2)
    share = (band.std[k] / (band.centre_hz, band.width_hz)[k - 1] for k in sizes)
    return sum(max(math.log(room / (math.sqrt(2.0 * math.pi) * max(s, 1e-12))), 0.0) for s in share)


def _starts(whittle: Whittle, floor: Array, terms: int) -> tuple[list[Start], int]:
    """Return starts for every input, and how many were tried for them.

    Whittle's likelihood has a maximum near every feature of the spectrum; a band is fitted from each of many centres.
    """
    low, high = float(whittle.spectrum.frequency_hz[0, 0]), float(whittle.spectrum.frequency_hz[-1, -1])
    centres = np.geomspace(low * _PITCH, high / _PITCH, max(round(math.log(high / low) / math.log(_PITCH)), 2))

    inputs = range(whittle.gain.shape[1])
    places = [(j, float(c), _WIDTH * float(c), True) for j in inputs for c in centres]
    places += [(j, 0.0, 2.0 * float(c), False) for j in inputs for c in centres[::_CORNERS]]
    found = [b for b in whittle.bands(terms, _as_strong_as(whittle, floor, places), floor) if b is not None]
    found.sort(key=lambda b: -b.log_likelihood)
    starts: list[Start] = []
    for j in inputs:
        bands = [b for b in found if b.input == j and not b.low_pass][:_STARTS]
        starts += [(j, b.centre_hz, b.width_hz, steep, b.rms**2) for b in bands for steep in (True, False)]
        passes = [b for b in found if b.input == j and b.low_pass][:1]
        starts += [(j, 0.0, b.width_hz, False, b.rms**2) for b in passes]
    starts += _as_strong_as(whittle, floor, [(j, 1.0, math.inf, True) for j in inputs])
    return starts, 2 * centres.size * len(inputs)


def _as_strong_as(whittle: Whittle, floor: Array, places: Sequence[tuple[int, float, float, bool]]) -> list[Start]:
    """Return starts at points (input, centre, width, steep), each as strong as the floor (n_y, k) at its largest."""
    humps = whittle.humps([(*place, 1.0) for place in places])
    return [(*place, 1.0 / float(np.max(hump / floor))) for place, hump in zip(places, humps, strict=True)]


def _steady(setting: Setting, linear: ModalModel, series: Sequence[Series], band: Band) -> bool:
    """Tell whether the band is there as well in the half of the samples in which less is played."""
    chunks = [
        (one.rows[a : a + _CHUNK], float(one.motion[a : a + _CHUNK].mean()))
        for one in series
        for a in range(0, max(one.rows.shape[0] - _CHUNK // 2, 1), _CHUNK)
    ]
    middle = float(np.median([size for _, size in chunks]))
    quiet, loud = ([x for x, size in chunks if (size > middle) is much] for much in (False, True))
    return _as_strong(setting, linear, quiet, loud, band)


def _random(setting: Setting, linear: ModalModel, series: Sequence[Series], band: Band) -> bool:
    """Tell whether the band is there as well in what is noise alone: an error of the model would repeat there."""
    alone, rest = ([one.rows for one in series if one.alone is noise] for noise in (True, False))
    return _as_strong(setting, linear, alone, rest, band)


def _as_strong(setting: Setting, linear: ModalModel, here: Sequence[Array], there: Sequence[Array], band: Band) -> bool:
    """Tell whether a band may be as strong in some series as in others; it may be where there are too few samples."""
    seen = []
    for part in (here, there):
        spectrum = spectrum_of(setting, part)
        if spectrum is None:
            return True
        seen.append(Whittle.of(spectrum, linear, setting.data.rate_hz).strength(band))
    (one, first), (other, second) = seen
    return one > _AS_STRONG * other - 4.0 * math.hypot(first, _AS_STRONG * second)


def _chance(setting: Setting, whittle: Whittle, found: _Best, place: str) -> Chance:
    band = found.band
    effect = BroadbandVibration(place, rms=band.rms, centre_hz=band.centre_hz, bandwidth_hz=band.width_hz)
    std = dict(zip(("rms", "centre_hz", "bandwidth_hz"), band.std, strict=True))
    (hump,) = whittle.humps([(band.input, band.centre_hz, band.width_hz, band.steep, band.rms**2)])
    f = whittle.spectrum.frequency_hz.mean(axis=1) / setting.data.rate_hz
    line = np.exp(-2j * np.pi * np.outer(f, np.arange(setting.whitener.order + 1)))
    passed = np.abs(line @ setting.whitener.taps.T).T ** 2
    raised = hump * passed
    # as strong as it is there, for part of the hump may be in the filter already
    louder = np.where(raised > _THERE, np.maximum(whittle.spectrum.power * passed, 1.0), 1.0)
    count = whittle.spectrum.count
    # what rounding leaves of a lively command is a torque of all frequencies as well
    rivals = (
        (AmplifierNoise.name, found.lead),
        (CommandQuantisation.name, found.white_lead),
        ("noise of a reading in a band", found.reading_lead),
    )
    return Chance(
        effect,
        std,
        found.evidence,
        found.p_value,
        0.0 if setting.added else float(np.sum(count * raised) / np.sum(count)) / hump.shape[0],
        math.sqrt(0.5 * float(np.sum(count * (hump / whittle.spectrum.power) ** 2))),
        rivals,
        Bands(whittle.spectrum.edges_hz / setting.data.rate_hz, louder),
    )
