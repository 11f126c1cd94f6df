import math
import re
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import pytest

from analysis.paper.causes import NOT_EXPLAINED
from analysis.paper.numbers import PaperNumber, PaperTable
from analysis.paper.pieces import Evidence
from analysis.paper.rows import Ours, build_table
from analysis.report.page import linked, render_page, render_table
from analysis.report.tables import display_frame, latex, write_table
from analysis.report.verdict import verdict_of
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


def missed(found, key):
    return [row.number.key for group in found.misses[key] for row in group.rows]


def test_the_verdict_counts_requirements_and_predictions():
    found = verdict_of({"6.6": performance(a=4.5e-3, b=math.inf, c=2.751)})
    assert (found.met, found.measured, found.missed) == (2, 3, ("row b",))
    assert found.predicted == (0, 2, 0, 0)
    assert missed(found, "6.6") == ["a", "b"]
    # the paper's numbers: 5.6 and 32 ms of 5 ms, 2.75 A of 10 A
    assert found.paper_met == 1 and [row.number.key for row in found.unlike] == ["a"]


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
    for cell in ("4.5", "never", "2.751", "✗ no", "✓ yes"):
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
    assert found.predicted == (0, 0, 0, 0)
    assert missed(found, "6.6") == ["b"]
    page = " ".join(render_page([], {"6.6": table}, {}, []).split())
    assert "<strong>1 of 2</strong>bounds kept, which counts nowhere as agreement" in page
    assert "row c: a parameter, 2026-11-26; 5 and 7 give more" in page


def run_of(kind="sim", name="as-built"):
    header = {"bench": {"kind": kind, "name": name}, "seed": 0, "tool_version": "1", "tool_commit": "a" * 40}
    header |= {"test": "chop", "note": ""}
    return SimpleNamespace(
        header=SimpleNamespace(**header), path=Path("chop.h5"), run_uid="0123456789abcdef", rows=10, sample_rate_hz=10.0
    )


@pytest.mark.parametrize(
    ("kinds", "says"),
    [
        (("sim", "emulator"), "All runs are simulated: no hardware was tested."),
        (("sim", "serial", "tcp"), "1 of the 3 runs are simulated."),
        (("serial",), None),
        ((), None),
    ],
)
def test_the_first_sentence_says_what_is_simulated(kinds, says):
    runs = [run_of(kind) for kind in kinds]
    lead = render_page(runs, {"6.6": performance(a=4.5e-3)}, {}, []).split('<p class="lead">')[1].split("</p>")[0]
    assert ("simulated" in lead) == (says is not None)
    assert says is None or " ".join(lead.split()).startswith(says)


def test_every_miss_is_listed_with_a_cause_that_holds_for_the_bundled_bench_alone():
    numbers = (number("p6", label="input"), number("p1", label="input"), number("p2"), number("p3"))
    paper = PaperTable(title="k", note="", rows=numbers)
    given = {"p6": Ours(9e-3), "p1": Ours(9e-3), "p2": Ours(5.9e-3, std=2e-4), "p3": Ours(5.6e-3)}
    tables = {"6.3": build_table("6.3", paper, given, ("0123456789abcdef",))}
    found = verdict_of(tables, [run_of()]).misses["6.3"]
    assert [[row.number.key for row in group.rows] for group in found] == [["p6"], ["p1"], ["p2"]]
    assert "trim" in found[0].cause and [group.cause for group in found[1:]] == [NOT_EXPLAINED, "the noise decides"]
    for runs in ([run_of("serial")], [run_of(name="another")], [run_of(), run_of("tcp")], []):
        (unknown,) = verdict_of(tables, runs).misses["6.3"]
        assert unknown.cause == NOT_EXPLAINED and len(unknown.rows) == 3
    # what rests on no run was computed from design models
    assert "trim" in verdict_of({"6.3": build_table("6.3", paper, given)}).misses["6.3"][0].cause
    page = " ".join(re.sub(r"<[^>]+>", " ", render_page([run_of()], tables, {}, [])).split())
    assert "not explained. row p1 input 9.0 ms, paper 5.6 ±0.4" in page
    assert "the noise decides. row p2 predicted 5.90 ± 0.20 ms, paper 5.6 ±0.4; noise decides: 69 % agree" in page


@pytest.mark.parametrize(
    ("ours", "value", "printed", "tolerance", "shown"),
    [
        (4.2573505, 4.0, "", 0.72, ("4.26", "+0.26")),
        (498.5423, 500.0, "", 2.4, ("498.5", "−1.5")),
        (89.8956028, 89.64, "", 1.34, ("89.90", "+0.26")),
        (0.0117726, 1.04, "", 0.005, ("0.012", "−1.028")),
        (1.4355687e27, 2.77e27, "", 4.15e25, ("1.44·10²⁷", "−1.33·10²⁷")),
        (1.0, 1.6, "1.60", 0.5, ("1.00", "−0.60")),
        (8.0 + 1e-15, 8.0, "", 0.0, ("8.0", "0")),
        (2e-11, 0.0, "", 0.5, ("0", "0")),
    ],
)
def test_ours_less_the_papers_is_the_deviation_digit_by_digit(ours, value, printed, tolerance, shown):
    made = number("a", unit="", value=value, printed=printed, tolerance=tolerance)
    frame = display_frame(build_table("t", PaperTable(title="t", note="", rows=(made,)), {"a": Ours(ours)}))
    assert (frame["ours"][0], frame["deviation"][0]) == shown


def test_a_table_or_figure_that_the_page_has_is_linked_and_text_stays_text():
    text = "<b> see Fig. A3, Fig. 6.7, Table 6.6 and Table 6.67"
    found = linked(text, {"figure-A3", "table-6.6"})
    assert found == (
        '&lt;b&gt; see <a href="#figure-A3">Fig. A3</a>, Fig. 6.7, <a href="#table-6.6">Table 6.6</a> and Table 6.67'
    )
    assert linked(text, ()).count("<a") == 0


def test_a_folded_table_stands_under_a_summary_and_not_in_the_contents():
    paper = PaperTable(title="Coefficients", note="", rows=(number("a", requirement=None),), folded=True)
    page = render_page([], {"6.2-coefficients": build_table("6.2-coefficients", paper, {})}, {}, [])
    contents = page.split("<nav", 1)[1].split("</nav>")[0]
    assert "<summary>1 coefficients, of which 0 agree</summary>" in page and "6.2-coefficients" not in contents


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
