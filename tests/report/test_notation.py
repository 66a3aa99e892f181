"""Mathematics on pages: what becomes a letter, what stays a word, and that nothing is unescaped."""

import html
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barbalat.report.notation import mathematics


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("theta_tilde'Gamma^-1 theta_tilde", "<var>θ̃</var>&#39;<var>Γ</var><sup>−1</sup> <var>θ̃</var>"),
        ("|e| <= nu_0/sqrt(Gamma)", "|e| ≤ <var>ν</var><sub>0</sub>/√(<var>Γ</var>)"),
        ("epsilon m_s and theta_hat'", "<var>ε</var> <var>m</var><sub>s</sub> and <var>θ̂</var>&#39;"),
        ("W_b (1 - C), theta_max, x_m", "<var>W</var><sub>b</sub> (1 - C), <var>θ</var><sub>max</sub>, <var>x</var><sub>m</sub>"),
        ("eta^2/m_s^2", "<var>η</var><sup>2</sup>/<var>m</var><sub>s</sub><sup>2</sup>"),
        ("t^-1.04, e^(-0.05 s)", "t<sup>−1.04</sup>, e<sup>−0.05 s</sup>"),
        ("||W_b||_1 x", "‖<var>W</var><sub>b</sub>‖<sub>1</sub> x"),
        ("W_c0", "<var>W</var><sub>c0</sub>"),
        ("theta_hat0 = 0", "<var>θ̂</var><sub>0</sub> = 0"),
        ("metal, betas, error_bound, h = 1e-4 s", "metal, betas, error_bound, h = 1e-4 s"),
        ("<script>&'\"", "&lt;script&gt;&amp;&#39;&#34;"),
    ],
)
def test_what_becomes_mathematics(text, shown):
    assert mathematics(text) == shown


@given(st.text(alphabet=st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), max_size=60))
def test_any_text_stays_text(text):
    """The only tags are those of mathematics."""
    shown = str(mathematics(text))
    tags = re.findall(r"<[^>]*>", shown)
    assert set(tags) <= {f"<{end}{tag}>" for end in ("", "/") for tag in ("var", "sub", "sup")}
    assert "&" not in re.sub(r"&(?:amp|lt|gt|#39|#34);", "", shown)
    if not any(part in text for part in ("^", "_", "sqrt", "=", ">", "-", "||")) and not re.search(r"[a-zA-Z]{2}", text):
        assert html.unescape(shown) == text
