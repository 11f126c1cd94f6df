"""A headless Chromium for tests, spoken to over its debugging pipe: no driver, no port, no network."""

from __future__ import annotations

import base64
import contextlib
import itertools
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def installed() -> str | None:
    """Return the browser's path, None where there is none; MCCD_BROWSER names another."""
    return os.environ.get("MCCD_BROWSER") or next(filter(None, map(shutil.which, NAMES)), None)


class Tab:
    """One page: `events` holds what the browser told of it since it was opened."""

    def __init__(self, write: int, read: int) -> None:
        self.events: list[dict[str, Any]] = []
        self._write, self._read = write, read
        self._ids = itertools.count(1)
        self._rest = b""
        self._session: str | None = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> Any:
        """Call a method of the debugging protocol and return its result; AssertionError when it fails."""
        number = next(self._ids)
        message: dict[str, Any] = {"id": number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        deadline = time.monotonic() + 30.0
        while True:
            found = self._next(deadline)
            if found.get("id") == number:
                assert "error" not in found, f"{method}: {found['error']}"
                return found["result"]
            self.events.append(found)

    def open(self, path: Path | str, width: int = 1200, height: int = 900, **media: str) -> None:
        """Load a file or an address, with media features such as prefers_color_scheme="dark", and wait until it is."""
        features = [{"name": k.replace("_", "-"), "value": v} for k, v in media.items()]
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call("Emulation.setEmulatedMedia", features=features)
        self.events.clear()
        self.call("Page.navigate", url=path if isinstance(path, str) else path.resolve().as_uri())
        deadline = time.monotonic() + 30.0
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self._next(deadline))

    def run(self, script: str) -> Any:
        """Evaluate JavaScript and return its value; AssertionError with what it threw."""
        done = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    def choose(self, place: str, option: str) -> None:
        """Choose an option of the list that a CSS selector finds."""
        self.run(
            f"{{const s = document.querySelector({json.dumps(place)}); s.value = {json.dumps(option)};"
            "s.dispatchEvent(new Event('change'))}"
        )

    def key(self, name: str, code: int, modifiers: int = 0) -> None:
        """Press and release a key as a person does."""
        text = {"Enter": "\r", " ": " "}.get(name, name if len(name) == 1 else "")
        for kind in ("keyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=name,
                windowsVirtualKeyCode=code,
                modifiers=modifiers,
                **({"text": text} if text and kind == "keyDown" else {}),
            )

    def drag(self, start: tuple[float, float], stop: tuple[float, float]) -> None:
        """Drag with the left mouse button."""
        self._mouse("mousePressed", start)
        self._mouse("mouseMoved", ((start[0] + stop[0]) / 2, (start[1] + stop[1]) / 2))
        self._mouse("mouseMoved", stop)
        self._mouse("mouseReleased", stop)

    def _mouse(self, kind: str, at: tuple[float, float]) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", buttons=1, clickCount=1)

    def complaints(self) -> list[str]:
        """Return every exception, console error and failed load since `open`."""
        found = []
        for event in self.events:
            method, params = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                found.append(str(params["exceptionDetails"]))
            elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                found.append(params["entry"]["text"])
            elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning"):
                found.append(str(params["args"]))
        return found

    def requests(self) -> list[str]:
        """Return the address of everything that the page asked for since `open`."""
        sent = (e for e in self.events if e.get("method") == "Network.requestWillBeSent")
        return [e["params"]["request"]["url"] for e in sent]

    def screenshot(self, path: Path, whole: bool = True) -> None:
        """Write a picture of the page (PNG)."""
        data = self.call("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
        path.write_bytes(base64.b64decode(data))

    def pdf(self) -> bytes:
        """Return the page as it would be printed."""
        return base64.b64decode(self.call("Page.printToPDF", printBackground=False)["data"])

    def _next(self, deadline: float) -> dict[str, Any]:
        while b"\0" not in self._rest:
            left = deadline - time.monotonic()
            ready, _, _ = select.select([self._read], [], [], max(left, 0.0))
            assert ready, "the browser did not answer in 30 s"
            data = os.read(self._read, 1 << 20)
            assert data, "the browser ended"
            self._rest += data
        message, _, self._rest = self._rest.partition(b"\0")
        found: dict[str, Any] = json.loads(message)
        return found


def cut_off(tab: Tab) -> list[str]:
    """Return what of the page stands out to the right or left of the window and cannot be scrolled to, as text.

    Tables and code may scroll by themselves; figures, texts, controls and captions of tables have to fit, unless a
    heading before a table says the same.
    """
    script = """{
      const shown = e => e.checkVisibility() && e.getBoundingClientRect().width > 0;
      const scrolls = e => e.closest('h3 + .scroll') || (e.closest('.scroll') && !e.matches('caption span'));
      [...document.querySelectorAll('body *')]
        .filter(e => shown(e) && !scrolls(e) && !e.closest('.skip') && !(e.closest('svg') && e.tagName !== 'svg'))
        .filter(e => { const r = e.getBoundingClientRect(); return r.right > innerWidth + 1 || r.left < -1; })
        .map(e => `${e.tagName} ${e.id} ${e.className.baseVal ?? e.className}: ${e.textContent.trim().slice(0, 40)}`)
    }"""
    found: list[str] = tab.run(script)
    return found


def small_print(tab: Tab) -> float:
    """Return the smallest size in CSS pixels in which a text of a figure on the page is seen."""
    script = """{
      const seen = e => e.getBoundingClientRect().width > 0 && e.textContent.trim();
      [...document.querySelectorAll('figure svg text')].filter(seen).map(e => {
        const svg = e.closest('svg'), scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
        return scale * parseFloat(getComputedStyle(e).fontSize); }).reduce((x, y) => Math.min(x, y), 99)
    }"""
    return float(tab.run(script))


def nameless(tab: Tab) -> int:
    """Return how many controls and drawings of the page have no name for somebody who hears it."""
    found = tab.run(
        "[...document.querySelectorAll('button, input, select, [tabindex], [role=group], svg[role=img]')]"
        ".filter(e => !(e.ariaLabel || e.labels?.[0]?.textContent.trim() || e.textContent.trim())).length"
    )
    return int(found)


def least_contrast(tab: Tab) -> float:
    """Return the lowest contrast of text with its ground on the page, as WCAG 2 counts it."""
    script = """{
      const parse = c => c.match(/[\\d.]+/g).map(Number);
      const linear = v => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
      const light = c => { const [r, g, b] = parse(c).map(linear); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
      const ground = e => { for (; e; e = e.parentElement) {
        const c = getComputedStyle(e).backgroundColor; if (!/, 0\\)$/.test(c)) return c; }
        return "rgb(255, 255, 255)"; };
      const texts = 'h1, p, th, td, a, button, .label, .met, .mark, .verdict, .cell, strong';
      [...document.querySelectorAll(texts)].map(e => {
        const [a, b] = [light(getComputedStyle(e).color), light(ground(e))].sort((x, y) => y - x);
        return (a + 0.05) / (b + 0.05); }).reduce((x, y) => Math.min(x, y))
    }"""
    return float(tab.run(script))


def check_desk_and_phone(tab: Tab, page: Path) -> None:
    """Assert that a page asks for nothing else, fits, and can be heard and read, light on a desk, dark on a phone."""
    for width, scheme in ((1280, "light"), (390, "dark")):
        tab.open(page, width=width, prefers_color_scheme=scheme)
        assert tab.complaints() == [] and tab.requests() == [page.resolve().as_uri()]
        assert tab.run("document.documentElement.scrollWidth") <= width
        # WCAG 2, level AA, for text of any size
        assert nameless(tab) == 0 and least_contrast(tab) >= 4.5


@contextlib.contextmanager
def browser() -> Iterator[Tab]:
    """Start the browser with a profile of its own and yield a tab; it is gone after the block."""
    program = installed()
    assert program is not None, "no browser is installed"
    to_child, write = os.pipe()
    read, from_child = os.pipe()
    with tempfile.TemporaryDirectory(prefix="mccd-browser-", ignore_cleanup_errors=True) as profile:
        options = [
            "--headless=new",
            "--no-sandbox",  # as root, in a container, there is none
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--hide-scrollbars",
            "--remote-debugging-pipe",
            f"--user-data-dir={profile}",
        ]
        # the browser reads commands from its descriptor 3 and answers on 4
        script = f'exec 3<&{to_child} 4>&{from_child}; exec "$0" "$@"'
        process = subprocess.Popen(
            ["/bin/bash", "-c", script, program, *options],
            pass_fds=(to_child, from_child),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(to_child)
        os.close(from_child)
        try:
            yield Tab(write, read)
        finally:
            os.close(write)  # the browser leaves when nobody speaks to it any more
            os.close(read)
            try:
                process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
