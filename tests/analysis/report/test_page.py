import math
import re
from html.parser import HTMLParser
from pathlib import Path

from analysis.paper.numbers import PaperNumber, PaperTable
from analysis.paper.pieces import Evidence
from analysis.paper.rows import Ours, build_table
from analysis.report.page import render_page, render_table, verdict_of
from analysis.report.tables import display_frame, latex, write_table
from campaigns.version import tool_commit, tool_version


def number(key, **changes):
    given = {
        "key": key,
        "row": f"row {key}",
        "unit": "ms",
        "label": "predicted",
        "tolerance": 0.4,
        "why": "half a period",
        "value": 5.6,
        "requirement": 5.0,
    }
    return PaperNumber(**{**given, **changes})


def performance(**ours):
    rows = (
        number("a"),
        number("b", value=32.0),
        number("c", unit="A", requirement=10.0, label="calibrated", value=2.75, tolerance=0.005),
        number("d", row="<script>alert(1)</script> & more", value=None, requirement=None, label="input"),
    )
    paper = PaperTable(title="Performance", note="A note.", rows=rows)
    return build_table("6.6", paper, {k: Ours(v) for k, v in ours.items()}, ("0123456789abcdef",))


def test_the_verdict_counts_requirements_and_predictions():
    found = verdict_of({"6.6": performance(a=4.5e-3, b=math.inf, c=2.751)})
    assert (found.met, found.measured, found.missed) == (2, 3, ("row b",))
    assert (found.agreeing, found.predictions) == (0, 2)
    assert [row.number.key for row in found.failures["6.6"]] == ["a", "b"]


def test_a_campaign_without_requirements_says_so():
    page = render_page([], {}, {}, [])
    assert "measured none of the requirements" in page


class Reader(HTMLParser):
    """Collects tags, ids and the text of cells."""

    def __init__(self):
        super().__init__()
        self.tags, self.ids, self.sources, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.tags.append(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.sources += [given[k] for k in ("src", "href") if k in given]

    def handle_data(self, data):
        self.text.append(data.strip())


def test_the_page_escapes_what_it_shows_and_asks_for_nothing_outside():
    table = performance(a=4.5e-3, b=math.inf, c=2.751)
    page = render_page([], {"6.6": table}, {}, [])
    reader = Reader()
    reader.feed(page)
    assert reader.tags.count("script") == 1 and "link" not in reader.tags and "img" not in reader.tags
    assert "<script>alert(1)</script> & more" in " ".join(reader.text)
    assert len(reader.ids) == len(set(reader.ids))
    assert not any(s.startswith(("http:", "https:", "//")) for s in reader.sources)
    assert "url(" not in page.split("</style>")[0]
    for cell in ("4.50", "never", "2.751", "✗ no", "✓ yes"):
        assert cell in " ".join(reader.text)
    assert render_page([], {"6.6": table}, {}, []) == page


def test_one_frame_gives_csv_latex_and_html(tmp_path: Path):
    table = performance(a=4.5e-3, c=2.751)
    paths = write_table(table, tmp_path, render_table(table))
    lines = paths["csv"].read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("row,requirement,paper,ours,std,deviation,unit,label,tolerance,ok")
    assert "row a,5.0,5.6,4.5," in lines[1]
    tex = paths["tex"].read_text(encoding="utf-8")
    assert tex == latex(table)
    assert r"\begin{tabular}" in tex and "Table 6.6: Performance" in tex and r"\&" in tex
    html = paths["html"].read_text(encoding="utf-8")
    frame = display_frame(table)
    for column in ("paper", "ours", "deviation", "tolerance"):
        assert all(cell in html and cell.replace("%", r"\%") in tex for cell in frame[column])
    assert "half a period" in html


def test_a_bound_is_marked_as_kept_and_counted_apart():
    rows = (
        number("a", label="bound", upper=True),
        number("b", label="bound", upper=True),
        number("c", label="calibrated", target="a parameter", chosen="2026-11-26", seen="5 and 7 give more"),
    )
    paper = PaperTable(title="Performance", note="", rows=rows)
    table = build_table("6.6", paper, {"a": Ours(1e-3), "b": Ours(9e-3), "c": Ours(5.6e-3)})
    assert display_frame(table)["agrees"].tolist() == ["kept", "no", "yes"]
    assert display_frame(table)["paper"].tolist()[:2] == ["≤ 5.6", "≤ 5.6"]
    found = verdict_of({"6.6": table})
    assert (found.agreeing, found.predictions) == (0, 0)
    assert [row.number.key for row in found.failures["6.6"]] == ["b"]
    page = " ".join(render_page([], {"6.6": table}, {}, []).split())
    assert "<strong>1 of 2</strong>bounds are kept: no agreement" in page
    assert "row c: a parameter, 2026-11-26; 5 and 7 give more" in page


def test_a_folded_table_stands_under_a_summary_and_not_in_the_contents():
    paper = PaperTable(title="Coefficients", note="", rows=(number("a", requirement=None),), folded=True)
    page = render_page([], {"6.2-coefficients": build_table("6.2-coefficients", paper, {})}, {}, [])
    assert (
        "<summary>1 coefficients, of which 0 agree</summary>" in page and 'href="#table-6.2-coefficients"' not in page
    )


def test_the_page_has_no_exponents_where_a_person_reads_and_all_digits_where_a_program_does():
    evidence = Evidence("What", "Why at most 1+4.6e-05?", ("L", "z"), (("printed", "-6.253e-05"),), "k is 2.2e-3.")
    paper = PaperTable(title="k", note="", rows=(number("a", unit="A"),))
    table = build_table("6.6", paper, {"a": Ours(6.253e-05)}, ("0123456789abcdef",))
    page = render_page([], {"6.6": table}, {}, [evidence])
    read = re.sub(r"<[^>]+>", " ", re.sub(r"<(script|style|svg).*?</\1>", "", page, flags=re.S))
    stamp = f"{tool_version()} ({tool_commit()})"
    assert stamp in read
    # the name of a commit may hold a digit, an e and a digit, and is no number
    assert not re.search(r"\d[eE][-+]?\d", read.replace(stamp, ""))
    for text in ("1+4.6·10⁻⁵", "−6.253·10⁻⁵", "k is 0.0022"):
        assert text in read
    assert 'value="6.253e-05"' in page
