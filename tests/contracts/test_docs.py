"""The pages in docs/ use one notation, and all their links work in the repository's viewer."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("docs/*.md"), *ROOT.glob("docs/*/*.md"), ROOT / "README.md"])
GENERATED = {"cases.md"}  # from docstrings, which name symbols as code does
SPELLED = re.compile(r"(?<![\w./])(theta|omega)(_hat|_tilde)?(?!\w)|(?<![\w./])(Gamma|kappa|epsilon|lambda)(?!\w)|<=|>=")


def prose(page: Path) -> str:
    """A page without its code, formulas, links' targets and drawings."""
    text = re.sub(r"^[ ]*```.*?^[ ]*```$|^---\n.*?^---$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"(?:^ {4}.*\n)*^ {4}.*\+--.*\n(?:^ {4}.*\n)*", "", text, flags=re.MULTILINE)
    return re.sub(r"`[^`]*`|\$\$.*?\$\$|\$[^$]*\$|\]\([^)]*\)", "", text, flags=re.DOTALL)


@pytest.mark.parametrize("page", [page for page in PAGES if page.name not in GENERATED], ids=lambda page: page.name)
def test_symbols_in_prose_are_symbols(page):
    found = [match[0] for match in SPELLED.finditer(prose(page))]
    assert not found, f"docs/notation.md has the symbols; spelled out as in code: {found}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere_in_the_repository(page):
    text = re.sub(r"^[ ]*```.*?^[ ]*```$|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", text):
        made = "gallery" in Path(target).parts and page.name != "README.md"  # by the site's build, from examples/gallery
        assert made or (page.parent / target).exists(), target
