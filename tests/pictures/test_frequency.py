"""How axes of frequency and magnitude are written."""

from barbalat.pictures.frequency import power_of_ten


def test_a_tick_below_the_smallest_number_has_no_name():
    """Axes of a loop with a gain of 1e-300 reach down to a zero, which is no power of ten."""
    assert [power_of_ten(value) for value in (0.0, 0.1, 1.0, 10.0)] == ["", "0.1", "1", "10"]
