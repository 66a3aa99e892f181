"""The pages in docs/ use one notation, and all their links work in the repository's viewer."""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.cheap

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("docs/*.md"), *ROOT.glob("docs/*/*.md"), ROOT / "README.md"])
GENERATED = {"cases.md"}  # from docstrings, which name symbols as code does
INDEX = ROOT / "docs" / "index.md"
NOT_COUNTED = {"Reference", "Laboratory notebook"}
MOST_WORDS = 35_000
"""Largest number of words on the site without the reference, the notebook, code and formulas: as much as a reader can be expected
to read."""
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
def test_no_page_contains_the_marks_of_a_merge(page):
    assert not re.findall(r"^(?:<{7}|>{7}) .*$", page.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere_in_the_repository(page):
    text = re.sub(r"^[ ]*```.*?^[ ]*```$|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", text):
        made = "gallery" in Path(target).parts and page.name != "README.md"  # by the site's build, from examples/gallery
        assert made or (page.parent / target).exists(), target


def words(page: Path) -> int:
    """The number of words of two letters or more. Names in the text count, but blocks of code, formulas and link targets do
    not."""
    text = re.sub(r"^[ ]*```.*?^[ ]*```$|^---\n.*?^---$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\$\$.*?\$\$|\$[^$\n]*\$|\]\([^)]*\)", "", text, flags=re.DOTALL)
    return len(re.findall(r"[^\W\d_]{2}[\w'’-]*", text))


def test_the_site_is_not_too_long():
    trees = re.findall(r"^:caption: ([^\n]*)\n:hidden:\n(.*?)^```$", INDEX.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    assert {caption for caption, _ in trees} >= NOT_COUNTED
    names = [name for caption, pages in trees if caption not in NOT_COUNTED for name in pages.split()]
    counted = {name: words(ROOT / "docs" / f"{name}.md") for name in ("index", *names)}
    assert sum(counted.values()) <= MOST_WORDS, sorted(counted.items(), key=lambda one: -one[1])[:10]
