"""`mccd identify`: a linear model from a stepped sine, or from any logs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mccdcli.options import POSITIVE, NewPath, Real, WholeRange, common_options
from mccdcli.output import emit, table
from mccdcli.progress import progress
from mccdcli.trials import count_campaign, play_campaign, settings_option

if TYPE_CHECKING:
    from analysis.identification.identified import Identification
    from analysis.identification.response_curves import ResponseCurve
    from campaigns.log import Run


@click.command()
@click.option(
    "--log",
    "given",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="RUN.h5",
    help="Identify from this log instead of running a sweep; repeatable.",
)
@click.option("--axis", "axes", multiple=True, metavar="AXIS", help="Axis to sweep; repeatable.  [default: all]")
@click.option("--logs", "folder", type=NewPath(), metavar="DIR", help="Folder for the logs of the sweeps.")
@click.option("--modes", type=WholeRange(min=1), metavar="N", help="Number of modes.  [default: chosen from the data]")
@click.option(
    "--only",
    default="",
    metavar="TEXT",
    help="Fit only segments whose label contains TEXT; all held-out ones are tested.",
)
@click.option(
    "--equal-weights",
    is_flag=True,
    help="Weight all frequency bins of a periodic record alike: least rms error where distortion limits the fit.",
)
@click.option(
    "--response",
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="Also write the measured frequency response: .csv with its uncertainty, or .sNp (Touchstone-like).",
)
@click.option(
    "--frf",
    "table_file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Fit a table of frequency response instead of logs (frequency, magnitude, phase; levels).",
)
@click.option(
    "--rate",
    "rate_hz",
    type=POSITIVE,
    metavar="HZ",
    help="With --frf: sample rate of the model.  [default: 10 times the highest frequency]",
)
@click.option("--level", type=Real(), help="With --frf: level of excitation to fit.  [default: the lowest]")
@click.option(
    "--plot",
    "picture",
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="Also draw a Bode plot of data and model: .png, .svg or .pdf.",
)
@click.option(
    "--force", is_flag=True, help="Replace an existing model, and picture of --plot; --response never replaces a file."
)
@settings_option
@common_options()
def identify(
    bench: str,
    out: Path | None,
    seed: int,
    dry_run: bool,
    as_json: bool,
    settings: dict[str, Any],
    given: tuple[Path, ...],
    axes: tuple[str, ...],
    folder: Path | None,
    modes: int | None,
    only: str,
    equal_weights: bool,
    response: Path | None,
    table_file: Path | None,
    rate_hz: float | None,
    level: float | None,
    picture: Path | None,
    force: bool,
) -> int:
    """Sweep every axis with a stepped sine and fit a linear model, or fit one to the logs of any bench.

    The model is nominal.toml unless --out names another; the sweeps' logs go into a folder beside it.

    \b
    Examples:
      mccd identify --out nominal.toml
      mccd identify --log RUN.h5 --log OTHER.h5 --modes 3 -o nominal.toml
      mccd identify --log RUN.h5 --only "200 mV" --modes 14 --equal-weights -o nominal.toml
      mccd identify --log RUN.h5 --response response.csv -o nominal.toml
      mccd identify --log RUN.h5 --plot bode.png -o nominal.toml
      mccd identify --frf response.csv --rate 5000 -o nominal.toml
    """
    from mccdcli.models import refuse_existing

    target = out or Path("nominal.toml")
    refuse_existing(target, force=force)
    if picture is not None:
        from campaigns.log.plot import require_picture

        require_picture(picture, force=force)
    if table_file is not None:
        if given:
            raise click.UsageError("give logs or a table of frequency response, not both")
        fitted = _from_table(table_file, modes=modes, rate_hz=rate_hz, level=level, name=target.stem)
        return _done(fitted, (), target, (table_file,), response, picture, as_json, force=force)
    if not given and dry_run:
        return _counted(bench, axes, settings, seed, as_json)
    logs = given or _swept(bench, axes, settings, folder or target.with_suffix(".runs"), seed)
    if isinstance(logs, int):
        return logs
    from campaigns.log import read_run

    with ExitStack() as stack:
        runs = [stack.enter_context(read_run(log)) for log in logs]
        found = _from_logs(runs, modes=modes, only=only, equal_weights=equal_weights, name=target.stem)
        return _done(found, runs, target, logs, response, picture, as_json, force=force)


def _counted(bench: str, axes: tuple[str, ...], settings: dict[str, Any], seed: int, as_json: bool) -> int:
    from campaigns.playing.sweep_campaign import sweep_campaign

    count_campaign(sweep_campaign(bench, axes, settings), bench, seed, as_json=as_json)
    return 0


def _from_table(file: Path, **settings: Any) -> Identification:
    from analysis.identification.from_table import identify_table

    with progress("identifying") as report:
        return identify_table(file, **settings, report=report)


def _from_logs(runs: Sequence[Run], **settings: Any) -> Identification:
    from analysis.identification.identify import identify_runs

    with progress("identifying") as report:
        return identify_runs(runs, **settings, report=report)


def _swept(
    bench: str, axes: tuple[str, ...], settings: dict[str, Any], folder: Path, seed: int
) -> tuple[Path, ...] | int:
    """Return the logs of the sweeps, played now or found in the folder; the exit code where they were stopped."""
    from campaigns.playing.sweep_campaign import sweep_campaign

    played = play_campaign(sweep_campaign(bench, axes, settings), folder, bench, seed, resume=True)
    return played.exit_code or tuple(played.logs.values())


def _done(
    found: Identification,
    runs: Sequence[Run],
    target: Path,
    sources: tuple[Path, ...],
    response: Path | None,
    picture: Path | None,
    as_json: bool,
    *,
    force: bool,
) -> int:
    """Write the model, then response and picture where they are wanted, and show it."""
    from analysis.identification.response_files import save_response
    from mccdcli.models import save_model

    save_model(found.model, target, force=force)
    if response is not None:
        save_response(found.response, response)
    if picture is not None:
        from analysis.identification.bode import save_bode

        save_bode(found, runs, picture)
    text = f"{_text(found)}\n\nmodel: {target}; from {', '.join(map(str, sources))}"
    emit({"model": target, "logs": list(sources), "identification": found}, as_json=as_json, text=text)
    return 0


def _text(found: Identification) -> str:
    rows = [
        (
            f"{mode['frequency_hz']:.4f} ± {mode['frequency_std_hz']:.2g}",
            f"{mode['decay_rate_1_s']:.4g} ± {mode['decay_rate_std_1_s']:.2g}",
            _damping(mode),
        )
        for mode in found.modes
    ]
    facts = [("method", found.method), *_gains(found), *_delays(found)]
    if found.chi2_per_dof is not None:
        facts.append(("misfit over noise", f"{found.chi2_per_dof:.3g} (χ² per degree of freedom)"))
    facts += [(name, f"{100.0 * value:.3f} % of the output") for name, value in _levels(found) if value is not None]
    facts += [(f"{one.input} → {one.output}", _uncertainty(one)) for one in found.response]
    facts += [(f"error on {one.segment}", f"{100.0 * one.total:.2f} %") for one in found.held_out]
    remarks = "".join(f"\nremark: {remark}" for remark in found.remarks)
    return f"{table(rows, heads=('frequency, Hz', 'decay rate, s⁻¹', 'damping ratio ζ'))}\n\n{table(facts)}{remarks}"


def _uncertainty(curve: ResponseCurve) -> str:
    """State the range over which a response was measured, and its uncertainty at the median line."""
    relative = sorted(
        std / size for std, size in zip(curve.std.tolist(), curve.magnitude.tolist(), strict=True) if size
    )
    f = curve.frequency_hz
    middle = f"{100.0 * relative[len(relative) // 2]:.2f} %" if relative else "unknown"
    return f"response at {f.size} lines, {f[0]:.4g}–{f[-1]:.4g} Hz, standard deviation {middle} (median)"


def _levels(found: Identification) -> list[tuple[str, float | None]]:
    return [("noise", found.noise), ("nonlinear distortion", found.distortion)]


def _damping(mode: dict[str, float]) -> str:
    """Return ζ = σ / ω of a mode with its standard deviation; a rigid body has none."""
    omega = 2.0 * math.pi * mode["frequency_hz"]
    if omega == 0.0:
        return ""
    zeta = mode["decay_rate_1_s"] / omega
    relative = math.hypot(
        mode["decay_rate_std_1_s"] / max(mode["decay_rate_1_s"], 1e-300),
        mode["frequency_std_hz"] / mode["frequency_hz"],
    )
    return f"{zeta:.4g} ± {zeta * relative:.2g}"


def _gains(found: Identification) -> list[tuple[str, str]]:
    """Return the static gain of every entry with its unit, where nothing is a rigid body."""
    import numpy as np

    linear = found.model.linear()
    if any(omega == 0.0 for omega in linear.omega_rad_s.tolist()):
        return []
    static = linear.with_(delay_s=0.0 * linear.delay_s).frequency_response(np.zeros(1))[0].real.tolist()
    return [
        (f"static gain {i.name} → {o.name}", f"{static[k][j]:.4g} {o.unit} per {i.unit}")
        for k, o in enumerate(found.model.outputs)
        for j, i in enumerate(found.model.inputs)
    ]


def _delays(found: Identification) -> list[tuple[str, str]]:
    told = []
    for port in found.model.inputs:
        delay = found.model.delay_s.get(port.name, 0.0)
        value, std = (delay, 0.0) if isinstance(delay, float | int) else (delay.value, delay.std or 0.0)
        if value:
            told.append((f"delay of {port.name}", f"{1e3 * value:.4g} ms" + (f" ± {1e3 * std:.2g} ms" if std else "")))
    return told
