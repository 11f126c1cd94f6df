"""`mccd bench check`: does a bench keep to the serial protocol?"""

from __future__ import annotations

import click

from mccdcli.idle_options import refuse_typed
from mccdcli.options import BENCHES, BenchAddress, common_options
from mccdcli.output import BAD, GOOD, emit, table
from mccdcli.progress import progress
from sim_backend.errors import ConfigError


@click.command()
@click.option(
    "--bench",
    type=BenchAddress(),
    envvar="MCCD_BENCH",
    required=True,
    metavar="BENCH",
    help=f"Which bench: {', '.join(form for form in BENCHES if not form.startswith('sim'))}.",
)
@common_options("seed", "json")
def check(bench: str, seed: int, as_json: bool) -> int:
    """Check that a bench keeps to the serial protocol; exit code 1 if it does not.

    Nothing moves: every segment that is played is zero. The bench must not be in use.

    \b
    Examples:
      mccd bench check --bench emulator
      mccd bench check --bench emulator:my-bench.toml
      mccd bench check --bench serial:/dev/ttyUSB0
      mccd bench check --bench tcp:192.168.1.20:5025 --json
    """
    kind, _, address = bench.partition(":")
    if kind == "sim":
        raise ConfigError("bench 'sim' has no line to check; check emulator, serial:DEVICE or tcp:HOST:PORT")

    if kind != "emulator":
        refuse_typed(("seed",), "goes with --bench emulator: this bench draws nothing from it; leave it out")
    from campaigns.serial.conformance import check_bench
    from campaigns.serial.emulator import EmulatorProcess
    from campaigns.serial.serve import ServeOptions
    from campaigns.serial.transport import transport_at

    with progress("checking") as report:
        if kind == "emulator":
            with EmulatorProcess(ServeOptions(bench=f"sim:{address or 'as-built'}", seed=seed)) as emulator:
                results = check_bench(emulator.transport(), report)
        else:
            results = check_bench(transport_at(kind, address), report)
    ok = all(result.ok for result in results)
    rows = [("ok" if r.ok else "FAILED", r.name, r.detail) for r in results]
    emit(
        {"ok": ok, "bench": bench, "checks": results},
        as_json=as_json,
        text=table(rows),
        colours={"ok": GOOD, "FAILED": BAD},
    )
    return 0 if ok else 1
