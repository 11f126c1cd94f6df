"""`mccd bench serve` and `mccd bench check` as a user runs them: real processes, real lines."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import h5py
import jsonschema
import pytest

from mccdcli.schema import schema_of
from sim_backend.model import dump_model
from tests import running
from tests.small_bench import bench_model

MCCD = [*running.MCCD, "bench"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*MCCD, *arguments], capture_output=True, text=True, timeout=120)


@pytest.fixture
def model(tmp_path: Path) -> str:
    path = tmp_path / "small.toml"
    path.write_text(dump_model(bench_model()), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("transport", ["pty", "tcp"])
def test_a_served_bench_is_checked_and_ends_safely(model: str, transport: str, tmp_path: Path) -> None:
    link = tmp_path / "bench"
    lasting = ["--link", str(link)] if transport == "pty" else []
    served = subprocess.Popen(
        [*MCCD, "serve", "--transport", transport, "--model", model, *lasting, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert served.stdout is not None
        said = "".join(served.stdout.readline() for _ in range(3))
        jsonschema.validate(json.loads(said), schema_of("bench serve"))
        address = json.loads(said)["address"]
        assert address.startswith("tcp:127.0.0.1:" if transport == "tcp" else f"serial:{link}")
        checked = run("check", "--bench", address, "--json")
        assert checked.returncode == 0, checked.stdout
        result = json.loads(checked.stdout)
        assert result["ok"] and len(result["checks"]) == 21
        served.send_signal(signal.SIGTERM)
        _, journal = served.communicate(timeout=30)
        assert served.returncode == 0
        assert journal.splitlines()[-1].endswith("safe")
        assert not link.is_symlink()
    finally:
        served.kill()
        served.communicate()


def test_the_table_for_a_person() -> None:
    checked = run("check", "--bench", "emulator")
    assert checked.returncode == 0
    rows = checked.stdout.splitlines()
    assert len(rows) == 21 and all(row.startswith("ok  ") for row in rows)


def test_a_test_on_the_emulated_bench_of_a_model_file_records_what_the_simulated_one_does(
    model: str, tmp_path: Path
) -> None:
    recorded = {}
    for kind in ("sim", "emulator"):
        log = tmp_path / f"{kind}.h5"
        done = subprocess.run(
            [*MCCD[:-1], "hysteresis", "--bench", f"{kind}:{model}", "--seed", "3", "-o", str(log)],
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert log.exists(), done.stderr
        with h5py.File(log) as file:
            assert f'"kind": "{kind}"' in file.attrs["bench"] and '"name": "small"' in file.attrs["bench"]
            recorded[kind] = {name: data[:].tobytes() for name, data in file["channels"].items()}
    assert recorded["sim"] == recorded["emulator"]
    assert any(any(data) for data in recorded["sim"].values())


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("check", "--bench", "sim"), 2, "has no line"),
        (("check", "--bench", "tcp:127.0.0.1:9"), 3, "cannot be reached"),
        (("check", "--bench", "serial:/dev/no-such-device"), 3, "cannot be opened"),
        (("check", "--bench", "emulator:"), 2, "emulator[:MODEL]"),
        (("check", "--bench", "emulator:none.toml"), 2, "model 'none.toml': no such file"),
        (("serve", "--faults", "7/burn=1"), 2, "the kinds are flip"),
        (("serve", "--model", "no-such-model"), 2, "no-such-model"),
        (("serve", "--transport", "tcp", "--host", "192.0.2.1"), 2, "give --allow-remote and a token"),
        (("serve", "--transport", "tcp", "--host", "0.0.0.0", "--allow-remote"), 2, "there is no token"),
        (("serve", "--transport", "tcp", "--host", "a..b"), 2, "host 'a..b': no address can be found"),
        (("serve", "--transport", "tcp", "--host", ""), 2, "host '': no address"),
        (("serve", "--transport", "tcp", "--port", "70000"), 2, "70000 is not in the range"),
        (("check", "--bench", "tcp:a..b:80"), 2, "host 'a..b': no address can be found"),
        (("check", "--bench", "tcp:no-such-host.invalid:80"), 2, "host 'no-such-host.invalid': no address"),
        (("serve", "--port", "5025"), 2, "--port goes with --transport tcp"),
        (("serve", "--host", "127.0.0.1"), 2, "--host goes with --transport tcp"),
        (("serve", "--transport", "tcp", "--link", "bench"), 2, "--link goes with --transport pty"),
        (("check", "--bench", "tcp:localhost:0"), 2, "PORT is '0'; it is 1 to 65535"),
        (("check", "--bench", "tcp:localhost:70000"), 2, "PORT is '70000'; it is 1 to 65535"),
        (("check", "--bench", "tcp:localhost:80", "--seed", "1"), 2, "--seed goes with --bench emulator"),
    ],
)
def test_mistakes_end_in_one_line(arguments: tuple[str, ...], code: int, message: str) -> None:
    done = run(*arguments)
    assert done.returncode == code
    assert message in done.stderr and "Traceback" not in done.stderr


def test_an_address_that_is_not_this_machines(tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("0123456789abcdef")
    token.chmod(0o600)
    where = ("--transport", "tcp", "--host", "192.0.2.1", "--allow-remote", "--token-file", str(token))
    done = run("serve", *where)
    assert done.returncode == 3 and "cannot listen on 192.0.2.1" in done.stderr
