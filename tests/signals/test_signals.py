from __future__ import annotations

import numpy as np
import pytest
from scipy import signal as scipy_signal

from barbalat.run.kernel.grid import signal_table
from barbalat.signals import Chirp, Constant, Recorded, Sine, Sines, Square, Step, Steps
from barbalat.solvers import EULER, HEUN, RK4
from barbalat.solvers.simulation import Simulation
from barbalat.validate import signal_values
from independent import refusal

T = np.linspace(0, 20, 401)


def test_the_bound_is_guaranteed_to_the_last_bit():
    """In doubles (0.1 + 0.2) + 0.3 > 0.1 + (0.2 + 0.3), and an interpolated value may exceed both ends by a rounding."""
    sines = Sines((0.2, 0.3), (1.0, 2.0), (np.pi / 2, np.pi / 2), constant=0.1)
    assert sines(np.array(0.0)) <= sines.bound
    falling = Recorded(
        [0.16966673157626005, 0.7770079014050029, 1.5696248933280392], [0.910665863793143] + 2 * [-0.9106658637931431]
    )
    t = np.append(np.linspace(0.17, 1.57, 400), np.nextafter(falling.times, 0))
    assert np.abs(falling(t)).max() <= falling.bound


def test_constant():
    assert Constant(-2)(T).tolist() == [-2.0] * len(T)


def test_sine_solves_its_differential_equation():
    """r(0) = constant + amplitude sin(phase), and r^2 + (r'/w)^2 = amplitude^2 for the oscillation."""
    r, w = Sine(50.0, 0.5, phase=0.3, constant=7.0), 0.5
    h = 1e-5
    slope = (r(T + h) - r(T - h)) / (2 * h)
    assert r(np.array(0.0)) == pytest.approx(7 + 50 * np.sin(0.3), rel=1e-15)
    np.testing.assert_allclose((r(T) - 7) ** 2 + (slope / w) ** 2, 2500, rtol=1e-7)  # differences: h^2 and eps/h, both 1e-10


def test_sines_is_a_sum_of_sines():
    total = Sines((1.0, -2.0), (0.5, 3.0), (0.1, 0.2), constant=4.0)(T)
    np.testing.assert_allclose(total, 4 + Sine(1.0, 0.5, 0.1)(T) + Sine(-2.0, 3.0, 0.2)(T), atol=1e-14)


def test_sines_needs_one_frequency_for_each_amplitude():
    assert "frequencies" in refusal(lambda: Sines((1.0, 2.0), (0.5,)))
    assert "phases" in refusal(lambda: Sines((1.0, 2.0), (0.5, 1.0), (0.1,)))
    assert "-1" in refusal(lambda: Sines((1.0,), (-1.0,)))


def test_chirp_against_scipy():
    """scipy.signal.chirp has frequencies in Hz and starts with a cosine, so its phase is -90 degrees."""
    ours = Chirp(2.0, 1.0, 9.0, 20.0)(T)
    np.testing.assert_allclose(
        ours, 2 * scipy_signal.chirp(T, 1 / (2 * np.pi), 20.0, 9 / (2 * np.pi), phi=-90), atol=1e-11
    )  # atol: the phase reaches 100 rad, of which a rounding is 1e-14


def test_chirp_goes_on_at_its_last_frequency():
    """After ``duration`` it has the period 2 pi / frequency_end, without a jump at ``duration``."""
    chirp = Chirp(1.0, 1.0, 4.0, 5.0)
    np.testing.assert_allclose(chirp(T[T > 5]), chirp(T[T > 5] + 2 * np.pi / 4), atol=1e-12)
    assert abs(chirp(np.array(5 + 1e-9)) - chirp(np.array(5 - 1e-9))) < 1e-8


def test_step_jumps_at_start_to_the_right():
    step = Step(amplitude=2.0, start=5.0, constant=-1.0)
    t = np.array([0.0, 5 - 1e-9, 5.0, 6.0])
    assert step(t).tolist() == [-1, -1, 1, 1]
    assert step.before(t).tolist() == [-1, -1, -1, 1]


def test_steps():
    steps = Steps(times=(1.0, 2.0), values=(3.0, 4.0), initial=9.0)
    t = np.array([0.0, 1.0, 1.5, 2.0, 3.0])
    assert steps(t).tolist() == [9, 3, 3, 4, 4]
    assert steps.before(t).tolist() == [9, 9, 3, 3, 4]


@pytest.mark.parametrize("times", [(1.0, 1.0), (2.0, 1.0)])
def test_times_must_increase(times):
    assert "increasing" in refusal(lambda: Steps(times, (1.0, 2.0)))
    assert "increasing" in refusal(lambda: Recorded(times, (1.0, 2.0)))


@pytest.mark.parametrize("period", [0.2, 0.6, 1.4, 2 * np.pi])
def test_square_jumps_on_every_half_period(period):
    """On a grid of half periods the level alternates from the first to the 10 000th, and its left limit is the previous level."""
    square = Square(amplitude=3.0, frequency=2 * np.pi / period, constant=1.0)
    t = np.arange(10_001) * (period / 2)
    expected = np.where(np.arange(10_001) % 2 == 0, 4.0, -2.0)
    assert (square(t) == expected).all()
    assert (square.before(t)[1:] == expected[:-1]).all()
    assert (square(t + period / 4) == expected).all()


def test_square_with_a_phase_against_scipy():
    ours = Square(1.0, 2.0, phase=0.7)(T)
    assert (ours == scipy_signal.square(2 * T + 0.7)).all()


@pytest.mark.parametrize("t_end", [0.3, 0.7, 1.1, 2.4, 2.8, 3.0, 5.6, 60.0])
@pytest.mark.parametrize("kind", [Step, Steps, Square])
def test_a_jump_on_the_grid_belongs_wholly_to_the_next_step(t_end, kind):
    """For a jump at k dt in decimal notation, all stages of step k - 1 have the old level and all of step k the new one, for
    every k."""
    dt = 0.1
    simulation = Simulation(t_end=t_end, dt=dt)
    for k in range(1, min(simulation.steps, 30)):
        start = round(k * dt, 10)
        signal = {
            Step: Step(amplitude=-2.0, start=start, constant=1.0),
            Steps: Steps(times=(start,), values=(-1.0,), initial=1.0),
            Square: Square(amplitude=1.0, frequency=np.pi / start),
        }[kind]
        table = signal_table((signal,), simulation, k - 1, 2)
        assert table.tolist() == [[1.0] * 3, [-1.0] * 3], f"jump at {start} s"


@pytest.mark.parametrize(("solver", "nodes"), [(EULER, [0]), (HEUN, [0, 1]), (RK4, [0, 0.5, 1])])
def test_the_table_holds_the_signals_at_each_stage(solver, nodes):
    signals = (Sine(2.0, 3.0), Constant(7.0))
    table = signal_table(signals, Simulation(t_end=2.0, dt=0.25, solver=solver), start=3, steps=4)
    expected = [[v for node in nodes for v in (2 * np.sin(3 * 0.25 * (k + node)), 7.0)] for k in (3, 4, 5, 6)]
    np.testing.assert_allclose(table, expected, rtol=1e-14)


class TwoForOne:
    """A signal that returns too many values."""

    def __call__(self, t):
        return np.zeros((*np.shape(t), 2))

    before = __call__


class Hole:
    """A signal with a gap in its data."""

    def __call__(self, t):
        return np.where(np.abs(t - 1) < 1e-9, np.nan, 1.0)

    before = __call__


def test_a_signal_of_the_wrong_shape_or_with_a_hole_is_refused():
    simulation = Simulation(t_end=2.0, dt=0.25)
    assert "one value for each time" in refusal(lambda: signal_table((TwoForOne(),), simulation, 0, 8))
    assert "t = 1 s" in refusal(lambda: signal_table((Hole(),), simulation, 0, 8))


@pytest.mark.parametrize("value", ["1.0", 1.0 + 2.0j, None, [1.0, [2.0]]], ids=["text", "complex", "nothing", "ragged"])
def test_a_signal_that_returns_no_real_numbers_is_refused(value):
    """A complex value is not reduced to its real part."""

    def signal(t):
        return value if isinstance(value, list) else np.full(t.shape, value)

    assert "real numbers" in refusal(lambda: signal_values(signal, np.arange(3.0)))
    assert signal_values(lambda t: t > 1, np.arange(3.0)).tolist() == [0.0, 0.0, 1.0]


# --- recorded data ---


def test_recorded_interpolates_and_holds_its_ends():
    recorded = Recorded([1.0, 2.0, 4.0], [10.0, 20.0, 0.0])
    assert recorded(np.array([0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 9.0])).tolist() == [10, 10, 15, 20, 10, 0, 0]


def written(tmp_path, content):
    file = tmp_path / "data.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


@pytest.mark.parametrize(
    "content",
    [
        "0,1\n0.5,-2e1\n",
        "time,r\n0,1\n0.5,-20\n",
        "\ufefftime [s],r\r\n0,1\r\n0.5,-20\r\n",
        " 0 , 1 \n\n0.5,-20",
        '"t","r"\n0.0,1.0\n0.5,-20.0\n\n',
    ],
    ids=["plain", "header", "byte-order mark", "blanks", "quoted header"],
)
def test_csv(tmp_path, content):
    recorded = Recorded.from_csv(written(tmp_path, content))
    assert (recorded.times.tolist(), recorded.values.tolist()) == ([0.0, 0.5], [1.0, -20.0])


@pytest.mark.parametrize(
    ("content", "fragment"),
    [
        ("", "no rows"),
        ("t,r\n", "no rows"),
        ("t,r\n0,1\n1,x\n", "line 3"),
        ("0,1\n1\n", "line 2"),
        ("0,1\n1,2,3\n", "line 2"),
        ("0|1\n1|2\n", "line"),
        ("t,r\n0,1\n1,nan\n", "finite"),
        ("0,1\n1,1e999\n", "finite"),
        ("0,1\n0,2\n", "increasing"),
        ("0,1\n2,1\n1,1\n", "1 after 2"),
        ("0,1\n1,2\n0.5.5,3\n", "0.5.5"),
        (b"\xff\xfe0\x00,\x001\x00", "cannot be read"),
        (b"\x00\x01\x02\n\x80\x81", "cannot be read"),
        ("0,1.O\n1,2\n", "line 1"),
    ],
)
def test_bad_csv_names_the_file_and_the_line(tmp_path, content, fragment):
    message = refusal(lambda: Recorded.from_csv(written(tmp_path, content)))
    assert "data.csv" in message
    assert fragment in message


def test_a_missing_file_and_a_folder(tmp_path):
    assert "nowhere.csv" in refusal(lambda: Recorded.from_csv(tmp_path / "nowhere.csv"))
    assert str(tmp_path) in refusal(lambda: Recorded.from_csv(tmp_path))
