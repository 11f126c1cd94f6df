"""`mccd watch --web`: a real process, a real log that grows, ends and is replaced, in a real browser."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, sidecar_of
from sim_backend.model import dump_model
from tests import headless, running
from tests.small_bench import bench_model

RATE_HZ = 1e4
PICTURES = os.environ.get("MCCD_PICTURES")
"""A folder for pictures of the page, to be looked at."""
WAIT_S = 60.0
"""For what takes a fraction of a second on a machine of one's own."""

pytestmark = pytest.mark.skipif(headless.installed() is None, reason="no browser is installed")


def until(true: Callable[[], object]) -> None:
    end = time.monotonic() + WAIT_S
    while not true():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)


def angles(rows: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    torque = 1e-4 * rng.standard_normal(rows)
    x = 3e-6 * np.sin(np.arange(rows) / 300.0) + 1e-7 * rng.standard_normal(rows)
    return torque, x, -2e-3 * x[::-1]


def writer(path: Path, **more: Any) -> LogWriter:
    channels = [
        Channel("torque_x", "N m", "input", "theta_x", RATE_HZ),
        Channel("theta_x", "rad", "output", "theta_x", RATE_HZ),
        Channel("theta_y", "rad", "output", "theta_y", RATE_HZ),
    ]
    return LogWriter.create(path, channels, test="chop", bench={}, chunk_rows=500, expected_rows=40_000, **more)


def append(log: LogWriter, rows: Iterable[np.ndarray]) -> None:
    log.append(dict(zip(("torque_x", "theta_x", "theta_y"), rows, strict=True)))


class Watching:
    """`mccd watch --web` as a process, its address known."""

    def __init__(self, path: Path, *options: str) -> None:
        self.process = subprocess.Popen(
            [*running.MCCD, "watch", str(path), "--web", "--every", "0.1", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None and self.process.stderr is not None
        self.said = self.process.stdout.readline()
        found = re.match(r"(http://127\.0\.0\.1:(\d+)/) shows ", self.said)
        assert found, (self.said, self.process.stderr.read())
        self.address, self.port = found[1], int(found[2])

    def end(self) -> int:
        self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=WAIT_S)
        return self.process.returncode


@pytest.fixture
def watch() -> Iterator[Callable[..., Watching]]:
    started: list[Watching] = []

    def start(path: Path, *options: str) -> Watching:
        started.append(Watching(path, *options))
        return started[-1]

    yield start
    for one in started:
        one.process.kill()
        one.process.communicate()


@pytest.fixture(scope="module")
def program() -> Iterator[headless.Tab]:
    with headless.browser() as tab:
        yield tab


@pytest.fixture
def browser(watch: object, program: headless.Tab) -> Iterator[headless.Tab]:
    """The tab, empty again before the server of its page is ended."""
    yield program
    program.call("Page.navigate", url="about:blank")


def said(tab: headless.Tab, name: str) -> str:
    return tab.run(f"document.querySelector('[data-said={name}]').textContent")


def test_it_follows_a_growing_log_with_the_numbers_of_the_log(tmp_path, watch, browser):
    path, model = tmp_path / "run.h5", tmp_path / "model.toml"
    model.write_text(dump_model(bench_model()), encoding="utf-8")
    rows = angles(30_000)
    with writer(path) as log:
        with log.segment("first", {}):
            append(log, tuple(part[:10_000] for part in rows))
        page = watch(path, "--model", str(model))
        browser.open(page.address)
        assert said(browser, "status") == "running" and said(browser, "recorded") == "1.0 s"
        with log.segment("second at theta_x", {}):
            append(log, tuple(part[10_000:] for part in rows))
        until(lambda: said(browser, "recorded") == "3.0 s")  # without loading again
        until(lambda: said(browser, "segment") == "second at θx")
    until(lambda: said(browser, "status") == "complete")
    assert said(browser, "rows") == "30000 of 40000 samples (75 %)"

    last = np.stack(rows[1:])[:, 10_000:]  # of the last two seconds
    factors = {"θx (µrad)": 1e6, "θy (nrad)": 1e9}
    facts = browser.run(
        "[...document.querySelectorAll('.facts tbody tr')].map(r => "
        "[r.querySelector('th').textContent, ...[...r.querySelectorAll('data')].map(d => Number(d.value))])"
    )
    assert [one[0] for one in facts] == list(factors)
    for (_, now, low, high, residual, own), values, factor in zip(facts, last, factors.values(), strict=True):
        # one rounding of a double by the factor
        assert [now, low, high] == pytest.approx(
            [v * factor for v in (values[-1], values.min(), values.max())], rel=1e-15
        )
        assert own == pytest.approx(values.std() * factor, rel=1e-9) and residual > 0.0
    for panel, values, factor in zip(drawn(browser), last, factors.values(), strict=True):
        assert panel["names"] == ["measured", "simulated"]
        at = np.round(np.array(panel["x"]) * RATE_HZ).astype(int) + 20_000 - 1
        stretch = 50  # of which the smallest and the largest reading are drawn: 800 points of 20,000
        assert 0 <= at[0] < stretch and 20_000 - stretch <= at[-1] < 20_000 and np.diff(at).max() < 2 * stretch
        # six digits are drawn
        np.testing.assert_allclose(panel["y"], values[at] * factor, rtol=5.1e-6)
        assert min(panel["y"]) == pytest.approx(values.min() * factor, rel=5.1e-6)
    assert all(url.startswith((page.address, "data:")) for url in browser.requests())
    assert browser.complaints() == []
    assert page.end() == 0


def drawn(tab: headless.Tab) -> list[dict[str, Any]]:
    """What the newest state has as plots; the page draws one curve for each of its series."""
    found = tab.run(
        "fetch('state.json').then(a => a.json()).then(s => s.explorer.views[0].panels.map(p => "
        "({names: p.series.map(s => s.name), x: p.series[0].x, y: p.series[0].y})))"
    )
    assert tab.run("document.querySelectorAll('.panel path.curve').length") == sum(len(p["names"]) for p in found)
    return found


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 390])
def test_it_fits_and_can_be_read(tmp_path, watch, browser, width, scheme):
    path = tmp_path / "a-run-with-a-name-of-some-length-in-the-dark.h5"
    with writer(path) as log, log.segment("position 2, cycle 14 of 120", {}):
        append(log, angles(20_000))
        page = watch(path)
        browser.open(page.address, width=width, prefers_color_scheme=scheme)
        until(lambda: browser.run("performance.getEntriesByName(new URL('state.json', location).href).length") > 1)
        assert browser.run("document.documentElement.scrollWidth <= innerWidth")
        assert headless.cut_off(browser) == []
        assert headless.nameless(browser) == 0
        assert headless.least_contrast(browser) >= 4.5  # WCAG 2, level AA
        assert browser.run("document.querySelectorAll('.panel path.curve').length") == 2
        assert all(url.startswith((page.address, "data:")) for url in browser.requests())
        assert browser.complaints() == []
        if PICTURES:
            browser.screenshot(Path(PICTURES) / f"live-{width}-{scheme}.png")


def test_a_telephone_shows_the_whole_table_and_a_desk_five_tiles_in_a_row(tmp_path, watch, browser):
    path, model = tmp_path / "run.h5", tmp_path / "model.toml"
    model.write_text(dump_model(bench_model()), encoding="utf-8")
    with writer(path) as log, log.segment("chop", {}):
        append(log, angles(20_000))
    page = watch(path, "--model", str(model))
    columns = []
    for width in (1400, 390):
        browser.open(page.address, width=width)
        until(lambda: browser.run("document.querySelectorAll('.facts th[scope=col]').length") == 6)
        assert browser.run("(e => e.scrollWidth <= e.clientWidth)(document.querySelector('.facts').parentNode)")
        browser.run("(e => e.append(e.lastElementChild.cloneNode(true)))(document.querySelector('.tiles'))")
        left = "new Set([...document.querySelectorAll('.tiles li')].map(e => e.offsetLeft)).size"
        columns.append(browser.run(left))
    assert columns == [5, 2]


def test_what_is_no_number_is_a_gap(tmp_path, watch, browser):
    path = tmp_path / "run.h5"
    torque, x, y = angles(20_000)
    x[9_000:9_300], y[:] = np.nan, np.nan
    with writer(path) as log:
        append(log, (torque, x, y))
    page = watch(path)
    browser.open(page.address)
    path_of = (
        "[...document.querySelectorAll('.panel path.curve')].map(e => (e.getAttribute('d').match(/M/g) || []).length)"
    )
    assert browser.run(path_of) == [2, 0]  # two stretches about the gap; nothing
    facts = browser.run("[...document.querySelectorAll('.facts data')].map(e => e.value)")
    assert float(facts[1]) == pytest.approx(np.nanmin(x) * 1e6, rel=1e-15) and facts[3:] == ["", "", ""]
    if PICTURES:
        browser.screenshot(Path(PICTURES) / "live-gap.png")
    assert browser.complaints() == []


def test_a_log_that_goes_and_one_that_takes_its_place_are_told_and_zoom_and_hold_stay(tmp_path, watch, browser):
    path, model = tmp_path / "run.h5", tmp_path / "model.toml"
    model.write_text(dump_model(bench_model()), encoding="utf-8")
    with writer(path) as log:
        append(log, angles(30_000))
    page = watch(path, "--model", str(model))
    browser.open(page.address)
    browser.run("document.querySelector('[aria-label=\"Zoom in\"]').click()")
    ticks = "[...document.querySelectorAll('.panel:last-of-type text[text-anchor=middle]')].map(e => e.textContent)"
    zoomed = browser.run(ticks)
    values = "[...document.querySelectorAll('.facts data')].map(e => e.value)"
    held = browser.run(values)
    browser.run("document.getElementById('hold').click()")
    first = said(browser, "run")
    for one in (path, sidecar_of(path)):
        one.rename(tmp_path / f"old-{one.name}")
    until(lambda: "run.h5" in said(browser, "trouble"))
    if PICTURES:
        browser.screenshot(Path(PICTURES) / "live-gone.png")
    with writer(tmp_path / "new.h5") as log:  # shorter than what was followed
        append(log, angles(5_000, seed=1))
    sidecar_of(tmp_path / "new.h5").rename(sidecar_of(path))
    (tmp_path / "new.h5").rename(path)
    until(lambda: said(browser, "run") != first)
    until(lambda: said(browser, "recorded") == "0.5 s" and said(browser, "trouble") == "")
    assert browser.run("document.querySelectorAll('.facts tbody tr').length") == 2
    assert browser.run(values) == held
    browser.run("document.getElementById('hold').click()")
    until(lambda: browser.run(values) != held)
    assert browser.run(ticks) == zoomed
    inside = "[...document.querySelectorAll('.panel text')].every(e => e.getBoundingClientRect().right <= innerWidth"
    assert browser.run(f"{inside} && e.getBBox().x + e.getBBox().width <= e.closest('svg').clientWidth)")
    assert page.end() == 0


def test_the_page_says_when_nobody_answers_any_more(tmp_path, watch, browser):
    path = tmp_path / "run.h5"
    with pytest.raises(ValueError, match="broken"), writer(path) as log:
        append(log, angles(1_000))
        raise ValueError("broken")
    page = watch(path)
    browser.open(page.address)
    assert said(browser, "status") == "failed"
    assert page.end() == 1  # as without --web
    until(lambda: "does not answer" in said(browser, "silence"))
    assert browser.run("document.querySelectorAll('.panel path.curve').length") == 2


def answer(port: int, method: str, where: str, headers: dict[str, str]) -> tuple[int, bytes]:
    connection = HTTPConnection("127.0.0.1", port, timeout=WAIT_S)
    connection.putrequest(method, where, skip_host=True)
    for name, value in headers.items():
        for one in value.split("|"):
            connection.putheader(name, one)
    connection.endheaders()
    with connection.getresponse() as found:
        text = found.status, found.read()
    connection.close()
    return text


def test_only_reading_is_answered_and_only_under_a_name_of_this_machine(tmp_path, watch):
    path = tmp_path / "run.h5"
    with writer(path) as log:
        append(log, angles(1_000))
    page = watch(path)
    own = f"127.0.0.1:{page.port}"
    for host in (own, f"localhost:{page.port}", f"LOCALHOST:{page.port}"):
        for where in ("/", "/state.json", "/?again=1"):
            status, content = answer(page.port, "GET", where, {"Host": host})
            assert status == 200 and b"theta_x" not in content and "θx".encode() in content or b"\\u03b8x" in content
    others = ["evil.example", f"evil.example:{page.port}", "127.0.0.1", f"127.0.0.1:{page.port + 1}", f"{own}|{own}"]
    for host in [*others, f"127.0.0.1.evil.example:{page.port}", "", f"[::1]:{page.port}"]:
        status, content = answer(page.port, "GET", "/state.json", {"Host": host})
        assert status == 421 and b"complete" not in content, host
    assert answer(page.port, "GET", "/", {})[0] == 421
    for method in ("POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "TRACE", "CONNECT", "MADE-UP"):
        assert answer(page.port, method, "/", {"Host": own})[0] == 405, method
    for where in ("/../run.h5", "/run.h5", "/%2e%2e/", "http://evil.example/"):
        assert answer(page.port, "GET", where, {"Host": own})[0] == 404, where
    with urlopen(page.address) as found:
        assert found.headers["Cache-Control"] == "no-store" and "Access-Control-Allow-Origin" not in found.headers
        assert found.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    # nothing listens elsewhere: 127.0.0.2 is this machine too
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", page.port), timeout=5.0)
    assert page.end() == 0


def test_a_port_in_use_and_options_that_do_not_go_together_are_refused(tmp_path):
    path = tmp_path / "run.h5"
    with writer(path) as log:
        append(log, angles(1_000))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        found = running.mccd("watch", str(path), "--web", "--port", str(port))
        assert found.returncode == 2 and f"port {port} of 127.0.0.1 is in use" in found.stderr
        assert "--port" in found.stderr and "Traceback" not in found.stderr and found.stdout == ""
    for options in (["--port", "8080"], ["--web", "--json"], ["--web", "--once"], ["--web", "--port", "65536"]):
        found = running.mccd("watch", str(path), *options)
        assert found.returncode == 2 and "--" in found.stderr and found.stdout == "", options
    found = running.mccd("watch", str(tmp_path / "none.h5"), "--web")
    assert found.returncode == 4 and "none.h5" in found.stderr and found.stdout == ""
