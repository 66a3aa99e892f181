"""Mathematics on the site: docutils places some subscripts wrongly, and every formula of the pages is corrected."""

import importlib.util
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytestmark = pytest.mark.cheap

DOCS = Path(__file__).parents[2] / "docs"
SPEC = importlib.util.spec_from_file_location("accents", DOCS / "sitekit" / "accents.py")
accents = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(accents)

OPEN = '<math xmlns="http://www.w3.org/1998/Math/MathML">'


def shape(mathml):
    """Tags and letters, nested: msub(mover(x ˙) m)."""

    def of(node):
        name = node.tag.split("}")[1]
        inner = " ".join(map(of, node)) or (node.text or "").strip()
        return inner if name in ("mi", "mn", "mo", "math") else f"{name}({inner})"

    return of(ElementTree.fromstring(mathml))


def test_the_subscript_of_an_accented_letter_stands_beside_it():
    wrong = f"{OPEN}<munderover><mi>x</mi><mi>m</mi><mo>˙</mo></munderover></math>"
    assert shape(accents.with_subscripts_beside(wrong)) == "msub(mover(x ˙) m)"


def test_limits_of_a_sum_stay_where_they_are():
    right = f"{OPEN}<munderover><mo>∑</mo><mi>i</mi><mo>∗</mo></munderover></math>"
    assert shape(accents.with_subscripts_beside(right)) == shape(right) == "munderover(∑ i ∗)"


@pytest.mark.parametrize(
    ("tex", "shown"),
    [
        (r"\dot x_m", "msub(mover(x ˙) m)"),
        (r"{\dot x}_m", "msub(mover(x ˙) m)"),
        (r"\hat\theta_1", "msub(mover(θ ˆ) 1)"),
        (r"\tilde x_m^2", "msup(msub(mover(x ~) m) 2)"),
        (r"\bar{\theta}_0", "msub(mover(θ ˉ) 0)"),
        (r"{\dot{\hat\theta}}_i", "msub(mover(mover(θ ˆ) ˙) i)"),
    ],
)
def test_accents_of_docutils(tex, shown):
    latex2mathml = pytest.importorskip("docutils.utils.math.latex2mathml")
    assert shape(accents.with_subscripts_beside(str(latex2mathml.tex2mathml(tex)))) == shown


def test_no_formula_of_the_pages_has_a_subscript_below_a_letter():
    latex2mathml = pytest.importorskip("docutils.utils.math.latex2mathml")
    formulas = [
        found[1] or found[2]
        for page in sorted(DOCS.rglob("*.md"))
        for found in re.finditer(r"\$\$(.+?)\$\$|(?<!\$)\$([^$\n]+)\$(?!\$)", page.read_text(encoding="utf-8"), re.DOTALL)
    ]
    accented = [one for one in formulas if re.search(r"\\(dot|hat|tilde|bar)\b", one)]
    assert len(accented) > 10
    for one in accented:
        shown = shape(accents.with_subscripts_beside(str(latex2mathml.tex2mathml(one))))
        assert not re.search(r"munderover\((?![∑∏∫])", shown), one
