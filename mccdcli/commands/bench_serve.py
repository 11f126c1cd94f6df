"""`mccd bench serve`: the emulated bench as a process."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.idle_options import refuse_typed
from mccdcli.options import NewPath, RealRange, WholeRange, common_options
from mccdcli.output import emit, say


@click.command()
@click.option("--transport", type=click.Choice(["pty", "tcp"]), default="pty", show_default=True, help="Kind of port.")
@click.option("--model", default="as-built", show_default=True, metavar="MODEL", help="Model of the emulated bench.")
@click.option("--link", type=NewPath(), metavar="PATH", help="Symbolic link that leads to the pseudo-terminal.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on with tcp.")
@click.option("--port", type=WholeRange(0, 65535), default=0, show_default=True, help="Port of tcp; 0: a free one.")
@click.option("--allow-remote", is_flag=True, help="Allow a --host that other machines can reach; they need the token.")
@click.option(
    "--token-file",
    type=click.Path(path_type=Path),
    envvar="MCCD_BENCH_TOKEN_FILE",
    metavar="FILE",
    help="File with the token that tcp clients must have. The variable MCCD_BENCH_TOKEN may hold it instead.",
)
@click.option(
    "--baud", type=RealRange(min=300), metavar="N", help="Limit the traffic to that of a serial line of N baud."
)
@click.option(
    "--speed",
    type=RealRange(min=1e-3),
    metavar="X",
    help="Speed of the bench over real time.  [default: as fast as it computes]",
)
@click.option(
    "--faults", metavar="SEED[/KIND=RATE,…]", help="Faults of the line: given kinds and rates, or drawn from SEED."
)
@common_options("seed", "json")
def serve(
    transport: str,
    model: str,
    link: Path | None,
    host: str,
    port: int,
    allow_remote: bool,
    token_file: Path | None,
    baud: float | None,
    speed: float | None,
    faults: str | None,
    seed: int,
    as_json: bool,
) -> None:
    """Serve an emulated bench at a pseudo-terminal or a TCP port.

    Its address is printed first; what the bench does goes to standard error. It runs until Ctrl-C or SIGTERM and
    leaves the bench safe. The kinds of faults are flip, lose, repeat, garbage, delay, drop, reset and stall; RATE is
    per byte on the line.

    A tcp connection must begin with *IDN? or ABORt. If there is a token, only these two are carried out without it.
    Nothing is encrypted: through a network that is not yours, use ssh -L.

    \b
    Examples:
      mccd bench serve
      mccd bench serve --transport tcp --port 5025 --speed 1
      mccd bench serve --link ./bench --baud 115200 --faults 7/flip=1e-4,drop=1e-5
    """
    if transport == "pty":
        refuse_typed(("host", "port", "allow_remote", "token_file"), "goes with --transport tcp")
    else:
        refuse_typed(("link",), "goes with --transport pty: it leads to a pseudo-terminal")
    from campaigns.benches import open_bench
    from campaigns.serial.serve import ServeOptions
    from campaigns.serial.serve import serve as run

    options = ServeOptions(
        bench=f"sim:{model}",
        seed=seed,
        transport="tcp" if transport == "tcp" else "pty",
        host=host,
        port=port,
        allow_remote=allow_remote,
        token_file=None if token_file is None else str(token_file),
        link=None if link is None else str(link),
        baud=baud,
        speed=speed,
        faults=faults,
    )

    def tell(address: str) -> None:
        emit({"address": address}, as_json=as_json, text=address)

    run(options, open_bench, tell, say)
