"""The site of the documents: what stands in this folder, and pages made from the code, which are never out of date.

`make docs` builds it into build/docs, with warnings as errors.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from campaigns.version import tool_version  # noqa: E402  (the sources stand beside this folder)

project = "mccd"
copyright = "the mccd contributors; MIT licence"
release = tool_version()

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["examples"]
html_theme = "furo"
html_title = "mccd"
html_show_sphinx = False
html_copy_source = False
autodoc_typehints = "description"
autodoc_member_order = "bysource"


def commands_page() -> str:
    """Return the reference of the command line, from the commands themselves."""
    from mccdcli.main import cli
    from mccdcli.manual import markdown

    return markdown(cli)


def contradictions_page() -> str:
    """Return what in the paper does not add up, computed as for the report."""
    from analysis.paper.evidence import EVIDENCE

    parts = [
        "# What in the paper does not add up",
        "Each of these tables is computed, here and in every report, from the numbers as printed.",
    ]
    for make in EVIDENCE:
        found = make()
        rows = [found.heads, tuple("---" for _ in found.heads), *found.rows]
        table = "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows)
        parts += [f"## {found.title}", found.question, table, found.conclusion]
    return "\n\n".join(parts) + "\n"


def choices_page() -> str:
    """Return every choice behind the bench and the paper's campaign, from the model file and what is told of each."""
    from analysis.paper.choices import choices, choices_table

    rows = choices()
    return (
        "# Every choice of the bench\n\n"
        f"The {len(rows)} numbers behind the [bench as built](bench-model.md) and the paper's campaign, in SI units. "
        "*input*: printed, or computed from printed numbers. *calibrated*: set so that one printed number comes out. "
        "*bound*: assumed, and held by a printed upper bound. *assumed*: nothing printed decides it. What is "
        "*predicted* is nobody's choice: those rows are in the report.\n\n" + choices_table(rows) + "\n"
    )


def effects_page() -> str:
    """Return the library of effects: what each looks like, its parameters, and what it is called."""
    from sim_backend.effects import NAMED

    parts = [
        "# The library of effects",
        "What a diagnosis can name and a model can hold (`[[effects]]`, see [model files](../model-file.md)). Units "
        "are those of a bench driven in N m and read in rad. A *size* makes the effect grow, a *shape* forms it, a "
        "*constant* is stated and not searched. `mccd model effects` prints the same.",
    ]
    for effect in NAMED:
        named = "" if effect.name == effect.reported() else f" It is named **{effect.reported()}**."
        parts += [
            f"## {effect.name}",
            f"{effect.family.capitalize()}. The residual {effect.symptom}.{named}",
            "| parameter | unit | kind | without it | meaning |\n|---|---|---|---|---|\n"
            + "\n".join(
                f"| `{p.name}` | {p.dimension.unit('N m', 'rad')} "
                f"| {'size' if p.size else 'constant' if p.fixed else 'shape'} | {p.neutral:g} | {p.about} |"
                for p in effect.parameters()
            ),
        ]
    return "\n\n".join(parts) + "\n"


def diagnosis_page() -> str:
    """Return what diagnosis.json holds, part by part: words from a file, values from the schema."""
    from mccdcli.schema import as_table, values_of

    words = tomllib.loads((HERE / "reference" / "diagnosis-json.toml").read_text(encoding="utf-8"))
    by_part: dict[str, list[tuple[str, str, str]]] = {}
    for value in values_of("diagnose"):
        by_part.setdefault(re.split(r"\W", value[0])[0], []).append(value)
    if list(by_part) != list(words):
        raise ValueError(f"diagnosis.json has the parts {list(by_part)}, and there are words for {list(words)}")
    parts = [
        "# diagnosis.json",
        "What `mccd diagnose` writes beside its page, and prints with `--json`. `[]` stands for each item of a list, "
        "`{}` for each name of an object, `?` behind what may be absent; all else is always there. Numbers are in SI "
        "units unless a unit is given beside them; `null` is what is unknown or not finite. `mccd schema diagnose` "
        "prints the same as a JSON Schema, to which the tests hold the command.",
        *(f"## {part}\n\n{words[part].strip()}\n\n{as_table(values)}" for part, values in by_part.items()),
        "## What is not in it",
        "The adjusted numbers of the nominal model are in `extended.toml`: each of them has the origin "
        "*fitted*, the runs as its source, and its standard deviation as `std` ([model files](../model-file.md)). The "
        "numbers of the figures are in `figures/*.csv`.",
    ]
    return "\n\n".join(parts) + "\n"


def notebook_page() -> str:
    """Return the example notebook as a page: its words, its code and what that printed and drew."""
    cells = json.loads((HERE / "examples" / "diagnose.ipynb").read_text(encoding="utf-8"))["cells"]
    parts = []
    for cell in cells:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
        parts += (_notebook_output(output) for output in cell.get("outputs", []))
    parts.append("The notebook itself is `docs/examples/diagnose.ipynb`; a test runs it.")
    return "\n\n".join(parts) + "\n"


def _notebook_output(output: dict[str, Any]) -> str:
    """Return what a cell gave: a picture, a table, or lines of text."""
    data = output.get("data", {})
    if "image/png" in data:
        return f'<img alt="what the cell draws" src="data:image/png;base64,{"".join(data["image/png"]).strip()}">'
    if "text/html" in data:
        # on a phone a table is wider than the page
        scrolls = '<div style="overflow-x: auto">'
        return f"```{{raw}} html\n{scrolls}{''.join(data['text/html'])}</div>\n```"
    text = "".join(output.get("text", data.get("text/plain", [])))
    return f"```text\n{text.rstrip()}\n```"


def schemas_page() -> str:
    """Return every JSON schema of the command line."""
    from mccdcli.schema import described, names

    parts = [
        "# Results as JSON",
        "Every command takes `--json`: its result goes to standard output as one document (`watch` writes one per "
        "line), everything else to standard error. `mccd schema COMMAND` prints the JSON Schema of that document; the "
        "tests hold every command to it. Numbers are in SI units unless their name says otherwise; `null` stands for "
        "what is unknown or not finite.",
    ]
    return "\n\n".join([*parts, *(described(name) for name in names())]) + "\n"


PAGES = {
    "reference/commands.md": commands_page,
    "reference/json.md": schemas_page,
    "reference/effects.md": effects_page,
    "reference/diagnosis-json.md": diagnosis_page,
    "choices.md": choices_page,
    "contradictions.md": contradictions_page,
    "notebook.md": notebook_page,
}


def make_pages(_app: object) -> None:
    """Write the pages that are made from the code, where they have changed."""
    for name, make in PAGES.items():
        path, text = HERE / name, make()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")


def setup(app: object) -> None:
    """Make the pages before Sphinx looks for them."""
    app.connect("builder-inited", make_pages)  # type: ignore[attr-defined]
