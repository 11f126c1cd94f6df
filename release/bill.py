"""Write the bill of materials of the release in a folder: `mccd-VERSION.cdx.json` (CycloneDX), beside the wheel.

It names the product by its version, and every package that `requirements-run.txt` pins with the digests of its files.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LISTED = ("requirements", "requirements-run.txt", "--pyproject", "pyproject.toml", "--mc-type", "application")
FORM = ("--output-reproducible", "--output-format", "JSON", "--no-validate", "--output-file", "-")


def main(folder: Path) -> Path:
    """Write the bill into `folder`, which holds one wheel, and return its path."""
    (wheel,) = folder.glob("mccd-*.whl")
    version = wheel.name.split("-")[1]
    command = [sys.executable, "-m", "cyclonedx_py", *LISTED, *FORM]
    bill = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    bill["metadata"]["component"] |= {"version": version, "purl": f"pkg:pypi/mccd@{version}"}
    path = folder / f"mccd-{version}.cdx.json"
    path.write_text(json.dumps(bill, indent=2) + "\n", encoding="utf-8")
    return path


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
