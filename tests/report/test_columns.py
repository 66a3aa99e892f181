"""What a picture draws of a record: nothing that happened is left out, and a line is one where a signal is resolved."""

import numpy as np
import pytest

from barbalat.report.columns import COLUMNS, drawn, largest
from barbalat.report.write import MOST_ROWS, kept_rows


def record(signal, count, steps=20):
    """Instants, values, and the extrema of ``steps`` steps between them."""
    fine = np.linspace(0.0, 60.0, (count - 1) * steps + 1)
    values = signal(fine)
    inside = np.stack([values[k : len(fine) - steps + k : steps] for k in range(steps + 1)])
    return fine[::steps], values[::steps], inside.min(axis=0), inside.max(axis=0)


@pytest.mark.parametrize("count", [2, 3, 50, COLUMNS, COLUMNS + 2, 2001, 8001])
@pytest.mark.parametrize("omega", [0.5, 3.0, 40.0, 3000.0])
def test_no_extremum_is_left_out(count, omega):
    t, value, low, high = record(lambda t: np.exp(-t / 20) * np.sin(omega * t), count)
    shown = drawn(t, value, low, high)
    assert len(shown.t) == len(shown.value) == len(shown.low) == len(shown.high) <= COLUMNS + 2
    assert shown.t[0] == 0 and shown.t[-1] == 60
    assert shown.low.min() == low.min() and shown.high.max() == high.max()
    starts, most = largest(t, np.maximum(-low, high))
    assert most.max() == max(-low.min(), high.max()) and len(starts) == len(most)


def test_a_slow_signal_is_a_line_and_a_fast_one_an_envelope():
    slow, fast = (drawn(*record(lambda t, omega=omega: np.sin(omega * t), 2001)) for omega in (1.0, 60.0))
    assert np.isfinite(slow.value).all()
    assert np.isnan(fast.value).all()
    np.testing.assert_allclose(fast.high, 1.0, atol=1e-2)  # 60 rad/s is sampled 5 times a period between the steps
    steep = drawn(*record(lambda t: np.sign(t - 30), 2001))
    assert np.isfinite(steep.value).all()  # a jump is no oscillation


@pytest.mark.parametrize("count", [1, 2, MOST_ROWS, MOST_ROWS + 1, 2001, 8001])
def test_a_csv_has_the_first_the_last_and_evenly_spaced_instants(count):
    rows = kept_rows(count)
    assert rows[0] == 0 and rows[-1] == count - 1 and len(rows) <= MOST_ROWS + 2
    assert len(rows) == count or len(set(np.diff(rows[:-1]))) == 1
