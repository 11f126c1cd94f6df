"""The site of the documents: what stands in this folder, and pages made from the code, which are never out of date.

`make docs` builds it into build/docs, with warnings as errors.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

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


def effects_page() -> str:
    """Return the library of effects: what each looks like, its parameters, and what it is called."""
    from sim_backend.effects import EFFECTS

    parts = [
        "# The library of effects",
        "What a diagnosis can name and a model can hold (`[[effects]]`, see [model files](../model-file.md)). Units "
        "are those of a bench driven in N m and read in rad. A *size* makes the effect grow, a *shape* forms it, a "
        "*constant* is stated and not searched. `mccd model effects` prints the same.",
    ]
    for effect in EFFECTS:
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


def notebook_page() -> str:
    """Return the example notebook as a page: its words, its code and what that printed."""
    cells = json.loads((HERE / "examples" / "diagnose.ipynb").read_text(encoding="utf-8"))["cells"]
    parts = []
    for cell in cells:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    parts.append("The notebook itself is `docs/examples/diagnose.ipynb`; a test runs it.")
    return "\n\n".join(parts) + "\n"


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
