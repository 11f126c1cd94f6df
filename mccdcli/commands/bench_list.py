"""`mccd bench list`: the benches that a test can run on."""

from __future__ import annotations

import click

from mccdcli.options import common_options
from mccdcli.output import emit, table


@click.command("list")
@common_options("json")
def list_benches(as_json: bool) -> None:
    """List the benches that --bench can name, and the models that a simulated one can run.

    \b
    Examples:
      mccd bench list
      mccd bench list --json
    """
    from campaigns.benches import BENCHES
    from sim_backend.model import bundled_models

    kinds = [{"bench": kind.form, "what": kind.help} for kind in BENCHES.values()]
    rows = [(kind["bench"], kind["what"]) for kind in kinds]
    text = f"{table(rows, heads=('bench', 'what'))}\n\nmodels: {', '.join(bundled_models())}"
    emit({"benches": kinds, "models": bundled_models()}, as_json=as_json, text=text)
