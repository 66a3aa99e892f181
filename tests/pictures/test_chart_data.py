"""Panels as data of a page's charts: the page draws the same as a picture."""

from base64 import b64decode

import numpy as np
import pytest

from barbalat.pictures.chart_data import MOST_WINDOWS, UNSEEN_SHARE, Arrays, panels_data
from barbalat.pictures.panels import Level, Panel, Series
from barbalat.pictures.symbols import without_mathtext


def read(data, one, name):
    return np.frombuffer(b64decode(data["arrays"][one[name]]), "<f4").astype(float)


def only(panel, t_end):
    data = panels_data([panel], t_end)
    ((found,), *_) = data["groups"]
    return data, found


def test_a_smooth_series_is_a_line_within_less_than_a_pixel():
    t = np.linspace(0.0, 10.0, 20_001)
    data, panel = only(Panel(title="a", series=[Series(t=t, value=np.sin(t), label="b")]), 10.0)
    (line,) = panel["series"]
    assert "high" not in line and len(read(data, line, "t")) == MOST_WINDOWS + 1
    drawn = np.interp(t, read(data, line, "t"), read(data, line, "low"))
    assert np.abs(drawn - np.sin(t)).max() < 2 * UNSEEN_SHARE


def test_what_oscillates_too_fast_keeps_its_extrema_and_its_ends():
    """The extrema between the instants, which only the envelope contains, are kept too."""
    t = np.linspace(0.0, 10.0, 5_001)
    value = np.sin(40 * np.pi * t) * t
    low, high = np.minimum(value[:-1], value[1:]), np.maximum(value[:-1], value[1:])
    high[2_000] = 25.0
    data, panel = only(Panel(title="a", series=[Series(t=t, value=value, label="b", low=low, high=high)]), 10.0)
    (band,) = panel["series"]
    at, lower, upper = (read(data, band, name) for name in ("t", "low", "high"))
    assert upper.max() == 25.0 and at[upper.argmax()] == pytest.approx(t[2_000], abs=10 / MOST_WINDOWS)
    assert lower.min() == pytest.approx(low.min(), rel=1e-6)
    assert (at[0], at[-1], upper[0], lower[-1]) == (0.0, 10.0, value[0], pytest.approx(value[-1], abs=1e-6))


def test_panels_that_show_a_part_are_a_group_of_their_own():
    t = np.linspace(0.0, 10.0, 101)
    whole = Panel(
        title="a", series=[Series(t=t, value=t, label="b")], levels=[Level(value=2.0, label="c"), Level(value=3.0, label="c")]
    )
    part = Panel(title="d", series=whole.series, times=(2.0, 4.0))
    data = panels_data([whole, part], 10.0)
    (first,), (second,) = data["groups"]
    assert [one["label"] for one in first["series"]] == ["b", "c", ""]
    assert set(read(data, second["series"][0], "t")[[0, -1]]) == {2.0, 4.0}


def test_a_run_that_diverges_ends_at_its_last_number():
    t = np.linspace(0.0, 1.0, 11)
    value = np.where(t < 0.5, 1e300, np.inf)
    data, panel = only(Panel(title="a", series=[Series(t=t, value=value, label="b")], scale="symlog"), 1.0)
    (line,) = panel["series"]
    assert read(data, line, "t")[-1] == pytest.approx(0.4) and np.isfinite(read(data, line, "low")).all()


def test_equal_arrays_are_on_the_page_once():
    arrays = Arrays()
    assert [arrays.add(np.arange(3.0)), arrays.add(np.ones(2)), arrays.add(np.arange(3.0))] == [0, 1, 0]


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        (r"$\hat{\theta}_{1}$", "θ\u0302₁"),
        ("State $x_1$ = alpha, model", "State x₁ = alpha, model"),
        (r"a \$ is no formula: $e = x - x_m$", "a $ is no formula: e = x − xₘ"),
        ("model $x_{m,2}$", "model xₘ₂"),
        (r"$\hat{w}_{b}$", "w\u0302_b"),
    ],
)
def test_formulas_become_plain_text(text, plain):
    assert without_mathtext(text) == plain
