"""`python -m campaigns.serial OPTIONS.json`: an emulated bench as a process of its own."""

import sys

import msgspec

from campaigns.benches import open_bench
from campaigns.serial.serve import ServeOptions, serve
from sim_backend.errors import MccdError


def _say(line: str) -> None:
    print(line, flush=True)


def _journal(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    try:
        serve(msgspec.json.decode(sys.argv[1], type=ServeOptions), open_bench, _say, _journal)
    except MccdError as error:
        _say(f"error {error.exit_code} {error}")
        sys.exit(error.exit_code)
