"""If a command is too fast for the whole run's panel, its first and last periods are shown. Otherwise nothing is added."""

import numpy as np
import pytest

from barbalat.pictures.close_ups import PERIODS, close_ups
from barbalat.pictures.panel_drawing import SHADE_AMONG_OTHERS, draw
from barbalat.pictures.panels import Panel, Series

T = np.linspace(0, 80, 40001)


def sine(omega, amplitude=1.0, label="r"):
    return Series(t=T, value=amplitude * np.sin(omega * T), label=label)


@pytest.mark.parametrize(("omega", "close"), [(1.0, False), (16.1, True)])
def test_the_first_and_the_last_periods(omega, close):
    command = sine(omega)
    panel = Panel(title="Output", series=[command], whole_row=True)
    found = close_ups(panel, [command], 80.0)
    assert len(found) == (2 if close else 0)
    for part, middle in zip(found, (found[0].times[1] / 2, 80 - found[0].times[1] / 2) if close else (), strict=True):
        start, end = part.times
        assert (start + end) / 2 == pytest.approx(middle)
        assert end - start == pytest.approx(PERIODS * 2 * np.pi / omega, rel=0.01)
        (axes,) = draw([part], 80.0).axes
        (line,) = axes.lines  # nothing is enveloped there
        x, y = line.get_data()
        assert axes.get_xlim() == pytest.approx(part.times)
        np.testing.assert_allclose(y, np.sin(omega * x), atol=0.02)


def test_a_part_of_a_series_keeps_its_extrema():
    whole = Series(t=np.arange(5.0), value=np.arange(5.0), label="", low=np.arange(4.0) - 1, high=np.arange(4.0) + 2)
    part = whole.within(1.5, 2.5)
    assert part.t.tolist() == [1, 2, 3] and part.low.tolist() == [0, 1] and part.high.tolist() == [3, 4]
    assert whole.within(9.0, 10.0).t.tolist() == [3, 4]


def test_envelopes_over_one_another_are_told_apart_by_their_edges():
    panel = Panel(title="Control", series=[sine(200, 2.0, "a"), sine(300, 1.0, "b")], whole_row=True)
    (axes,) = draw([panel], 80.0).axes
    assert {band.get_alpha() for band in axes.collections} == {SHADE_AMONG_OTHERS}
    edges = {round(abs(float(np.median(line.get_ydata()))), 1) for line in axes.lines if np.isfinite(line.get_ydata()).all()}
    assert edges == {1.0, 2.0}
    inside = [line.get_ydata() for line in axes.lines if not np.isfinite(line.get_ydata()).all()]
    assert len(inside) == 2  # no middle parts, which would overlap


def test_a_short_logarithmic_axis_has_plain_numbers():
    drawn = draw([Panel(title="e", series=[Series(t=T, value=0.3 + 0.1 * np.sin(T / 20), label="e")], scale="log")], 80.0)
    drawn.draw_without_rendering()
    texts = [label.get_text() for label in drawn.axes[0].get_yticklabels(which="both") if label.get_text()]
    assert texts and not any("times" in text or "10^" in text for text in texts)
