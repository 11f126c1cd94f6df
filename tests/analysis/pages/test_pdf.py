"""The PDF of a page: in its colours, of its own content alone, and refused in words where it cannot be made."""

from __future__ import annotations

import re
import sys
import zlib
from pathlib import Path

import pytest

from analysis.pages.pdf import require_pdf, write_pdf
from mccdcli.main import main
from sim_backend.errors import ConfigError

BLUE = b"0 0.447059 0.698039"
"""Curve 1 on paper, #0072b2, as a PDF writes it."""
PAGE = """<!doctype html><html><head><title>A page</title>
<style>:root { --ink: #111111; --curve-1: #123456; } @media print { :root:root { --curve-1: #0072b2; } }</style></head>
<body><p>One</p><svg viewBox="0 0 10 10"><path d="M0 0 L10 10" style="stroke: var(--curve-1)"/></svg>
<p style="break-before: page">Two <a href="figures/one.csv">CSV</a></p><img src="file:///etc/hostname">
<img src="http://192.0.2.1/x.png"></body></html>
"""


@pytest.fixture
def pdf_can_be_made() -> None:
    try:
        require_pdf()
    except ConfigError as error:
        pytest.skip(str(error))


def content(pdf: Path) -> bytes:
    """Return all of a PDF, unpacked."""
    data = pdf.read_bytes()
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.DOTALL)
    return data + b"\n".join(zlib.decompress(one) for one in streams if one[:1] == b"x")


@pytest.mark.usefixtures("pdf_can_be_made")
def test_it_has_the_colours_of_paper_and_asks_for_nothing(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(PAGE, encoding="utf-8")
    made = write_pdf(tmp_path / "index.html", tmp_path / "page.pdf")
    text = content(made)
    assert text.startswith(b"%PDF-") and re.search(rb"/Count 2\b", text)
    assert BLUE in text
    assert str(tmp_path).encode() not in text and b"/Image" not in text


@pytest.mark.usefixtures("pdf_can_be_made")
def test_an_earlier_one_is_replaced_and_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(PAGE, encoding="utf-8")
    (tmp_path / "victim").write_text("precious")
    (tmp_path / "page.pdf").symlink_to(tmp_path / "victim")
    for _ in range(2):
        made = write_pdf(tmp_path / "index.html", tmp_path / "page.pdf")
        assert made.read_bytes().startswith(b"%PDF-") and not made.is_symlink()
    assert (tmp_path / "victim").read_text() == "precious"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("raise ImportError('no module')", "pip install 'mccd[pdf]'"),
        ("raise OSError('cannot load library libpango-1.0-0\\nmore')", "apt install libpango-1.0-0"),
    ],
)
@pytest.mark.parametrize("command", [["report"], ["diagnose", "run.h5"]])
def test_without_what_it_needs_nothing_is_begun(tmp_path, monkeypatch, capsys, source, said, command) -> None:
    (tmp_path / "weasyprint.py").write_text(source)
    for name in [name for name in sys.modules if name.partition(".")[0] == "weasyprint"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    Path("run.h5").touch()
    assert main([*command, "--pdf"]) == ConfigError.exit_code
    told = capsys.readouterr().err
    assert said in told and told.startswith("mccd: error: ") and told.count("\n") == 1
    assert [path.name for path in Path().iterdir()] == ["run.h5"]
