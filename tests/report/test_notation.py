"""Mathematics on pages: the texts that become letters, those that stay words, and escaping."""

import html
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barbalat.report.notation import mathematics, naming


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("theta_tilde'Gamma^-1 theta_tilde", "<var>θ̃</var>′<var>Γ</var><sup>−1</sup> <var>θ̃</var>"),
        ("|e| <= nu_0/sqrt(Gamma)", "|<var>e</var>| ≤ <var>ν</var><sub>0</sub>/√(<var>Γ</var>)"),
        ("epsilon m_s and theta_hat'", "<var>ε</var> <var>m</var><sub>s</sub> and <var>θ̂</var>′"),
        ("W_b (1 - C), theta_max, x_m", "<var>W</var><sub>b</sub> (1 − C), <var>θ</var><sub>max</sub>, <var>x</var><sub>m</sub>"),
        ("eta^2/m_s^2", "<var>η</var><sup>2</sup>/<var>m</var><sub>s</sub><sup>2</sup>"),
        ("t^-1.04, e^(-0.05 s)", "t<sup>−1.04</sup>, e<sup>−0.05 s</sup>"),
        ("||W_b||_1 x", "‖<var>W</var><sub>b</sub>‖<sub>1</sub> x"),
        ("1/||T||_inf", "1/‖<var>T</var>‖<sub>∞</sub>"),
        ("W_c0", "<var>W</var><sub>c0</sub>"),
        ("theta_hat0 = 0", "<var>θ̂</var><sub>0</sub> = 0"),
        ("metal, betas, h = 1e-4 s", "metal, betas, <var>h</var> = 10<sup>−4</sup>\u00a0s"),
        ("2.24e+03, -1.5e-05; -5 to 5", "2.24·10<sup>3</sup>, −1.5·10<sup>−5</sup>; −5 to 5"),
        ("step_max, gamma_max_at_model", "<code>step_<wbr>max</code>, <code>gamma_<wbr>max_<wbr>at_<wbr>model</code>"),
        ("|theta|_1, e(0) = 0, inf", "|<var>θ</var>|<sub>1</sub>, <var>e</var>(0) = 0, ∞"),
        ("the case's, RK4, figures-2-5, kappa-0.05", "the case&#39;s, RK4, figures-2-5, <var>κ</var>-0.05"),
        ("<script>&'\"", "&lt;script&gt;&amp;&#39;&#34;"),
    ],
)
def test_what_becomes_mathematics(text, shown):
    assert mathematics(text) == shown


@given(st.text(alphabet=st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), max_size=60))
def test_any_text_stays_text(text):
    """The only tags are the tags for mathematics."""
    shown = str(mathematics(text))
    tags = re.findall(r"<[^>]*>", shown)
    assert set(tags) <= {f"<{end}{tag}>" for end in ("", "/") for tag in ("var", "sub", "sup", "code", "wbr")}
    assert "&" not in re.sub(r"&(?:amp|lt|gt|#39|#34);", "", shown)
    if re.fullmatch(r"[^\^_=<>|('-]*", text) and not re.search(r"[a-zA-Z]{2}|\d[ e]", text):
        assert html.unescape(shown) == text


def test_names_of_rows_are_set_as_they_are_typed():
    """Given names are kept whole. A word that only begins like one is mathematics."""
    shown = naming("tau-error and tau-limit-delay, no tau-errors; tau", ["tau-error", "tau-limit-delay"])
    assert shown == ("<code>tau-error</code> and <code>tau-limit-delay</code>, no <var>τ</var>-errors; <var>τ</var>")
    assert naming("tau", []) == "<var>τ</var>"
