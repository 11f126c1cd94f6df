"""The page of a design in a real browser."""

from __future__ import annotations

import json

import pytest

from mccdcli.main import main
from tests import headless
from tests.designed import designed


@pytest.mark.skipif(headless.installed() is None, reason="no Chromium is installed; MCCD_BROWSER may name one")
def test_it_asks_for_nothing_fits_a_telephone_and_is_readable() -> None:
    made = designed()
    found = json.loads((made / "printed.json").read_text(encoding="utf-8"))
    page = made / "design" / "index.html"
    with headless.browser() as tab:
        headless.check_desk_and_phone(tab, page)
        tab.choose(".colours select", "light")
        assert tab.run("document.documentElement.dataset.colours") == "light"
        cells = tab.run("[...document.querySelectorAll('td')].map(e => e.textContent)")
        expected = found["axes"]["theta_x"]["stability_3sigma_rad"]["identified"]
        assert any(cell.startswith(f"{1e6 * expected:.3f}") for cell in cells)
        assert tab.run("document.querySelectorAll('table')[1].tBodies[0].rows.length") == len(found["stages"])


def test_a_move_beyond_the_end_stops_is_refused_before_anything_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["design", "--model", "design", "--reach", "30"]) == 2
    assert "end stops" in capsys.readouterr().err and list(tmp_path.iterdir()) == []
