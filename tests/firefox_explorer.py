"""Explorers in Debian's Firefox: every slider is moved, and every metric must be identical to the metric from a run of the copied
case file.

    python tests/firefox_explorer.py [CASE ...]

It needs firefox-esr or the browser named by FIREFOX, and node and npm, which install puppeteer-core into a temporary folder,
because Playwright drives only its own Firefox. Each fault is printed on a line, and the exit code is then 1.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from barbalat.cases.load import CaseText
from barbalat.explorer.explorer import Explorer
from barbalat.explorer.source import TextSource
from browser_explorer import differences

DRIVER = "puppeteer-core@24.43.1"
SCRIPT = Path(__file__).with_suffix(".mjs")
CASES = ("quadrotor-pitch", str(Path(__file__).parent / "explorer" / "everything.toml"))


def main(cases: list[str]) -> int:
    """Check the cases and return the exit code."""
    firefox = os.environ.get("FIREFOX") or shutil.which("firefox-esr") or shutil.which("firefox")
    if firefox is None or shutil.which("npm") is None:
        sys.exit("no Firefox, or no npm: install Debian's firefox-esr, nodejs and npm, or name a Firefox by FIREFOX")
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder)
        subprocess.run(
            ["npm", "install", "--silent", "--no-audit", "--prefix", folder, DRIVER], check=True, stdout=subprocess.DEVNULL
        )
        shutil.copy(SCRIPT, made)  # Node looks for modules in the same folder
        pages = [
            Explorer(TextSource(CaseText.read(case))).save(made / f"{Path(case).stem}.html").as_uri() for case in cases or CASES
        ]
        done = subprocess.run(["node", str(made / SCRIPT.name), firefox, *pages], check=True, stdout=subprocess.PIPE, text=True)
    found = []
    for one in json.loads(done.stdout):
        name = Path(one["page"]).stem
        found += [f"{name}: {said}" for said in [*one["said"], *differences(one["text"], one["figures"], "in Firefox")]]
    print("\n".join(found) or f"no findings in {len(json.loads(done.stdout))} settings")  # noqa: T201
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
