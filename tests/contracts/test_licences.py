"""docs/licences.md names everything installed with the package and marks whatever is under a GNU licence."""

import re
import tomllib
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PAGE = (ROOT / "docs" / "licences.md").read_text()
SHOWN = {"control": "python-control", "numpy": "NumPy"}
"""Names on the page that differ from the names of the packages."""


def required(requirement, found):
    """The package of a requirement and all its dependencies, without extras."""
    name = re.match(r"[A-Za-z0-9._-]+", requirement).group().lower().replace("_", "-")
    if name in found or "extra ==" in requirement or "sys_platform" in requirement or "platform_system" in requirement:
        return
    found.add(name)
    for inner in metadata.requires(name) or ():
        required(inner, found)


def test_every_package_stands_on_the_page():
    found = set()
    extras = PROJECT["optional-dependencies"]
    for requirement in PROJECT["dependencies"] + extras["tables"] + extras["control"] + extras["robust"] + extras["study"]:
        required(requirement, found)
    assert len(found) > 20
    for name in found:
        assert SHOWN.get(name, name).lower() in PAGE.lower(), name
        stated = metadata.metadata(name)
        licence = stated.get("License-Expression") or " ".join(
            [stated.get("License") or "", *(stated.get_all("Classifier") or [])]
        )
        if re.search(r"L?GPL(?!-3.0-with-GCC)|Lesser General Public", licence.split("\n")[0]):
            row = next(line for line in PAGE.splitlines() if line.startswith("|") and name in line.lower())
            assert "**" in row, name


def test_what_is_copied_into_pages_has_its_licence_beside_it_and_in_them():
    package = ROOT / "src" / "barbalat"
    folder = package / "pictures" / "templates" / "uplot"
    licence, script = ((folder / name).read_text() for name in ("LICENSE", "uPlot.iife.min.js"))
    assert licence.startswith("The MIT License") and "Leon Sorokin" in licence
    version = re.search(r"uPlot\.js \(v([\d.]+)\)|v(1\.\d+\.\d+)", script[:300])
    assert version is not None and next(filter(None, version.groups())) in PAGE
    assert "{{LICENCE}}" in (package / "explorer" / "templates" / "explore.html").read_text()
    assert "{{ licence }}" in (package / "report" / "templates" / "charts.html").read_text()


def test_the_lock_is_made_by_a_fixed_version():
    assert re.search(r"pip install [^\n]*uv==\d+\.\d+\.\d+", (ROOT / "dev").read_text())
