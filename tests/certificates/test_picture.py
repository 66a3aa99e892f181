"""Pictures of the loops whose margins a certificate gives: the marks stand where the margins are."""

import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from barbalat import TransferFunction, certify, load_case, margins
from barbalat.certificates.picture import MarginLoop, Marked
from independent import refusal


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_the_marks_are_where_the_margins_are(delay):
    """L = 2/(s (s + 1)(s + 4)): |L| = 1 at the one mark, L = -1/gain margin at the other."""
    loop = TransferFunction([2.0], [1.0, 5.0, 4.0, 0.0]).realise()
    found, drawn = margins(loop, delay), Marked.of(MarginLoop("L", loop, delay)).response(1e-3, 1e3)
    assert abs(drawn.value(drawn.at_phase)) == pytest.approx(1.0, rel=1e-6)
    assert np.angle(-drawn.value(drawn.at_phase)) == pytest.approx(found.phase, rel=1e-6)
    assert drawn.value(drawn.at_gain) == pytest.approx(-1 / found.gain_up, rel=1e-6)
    at = int(np.abs(drawn.w - drawn.at_phase).argmin())
    assert drawn.phase[at] == pytest.approx(-180 + np.degrees(found.phase), rel=1e-6)
    if delay == 0:  # Routh: 20/2
        assert found.gain_up == pytest.approx(10.0, rel=1e-9)


def test_a_notebook_shows_of_a_bound_digits_that_are_one():
    """Four digits: below the value where it is a bound from below, above it otherwise; of an enclosure each end outward."""
    case = load_case("paper")
    for certificate in certify(case.problem, case.controllers, case.simulation).values():
        shown = dict(re.findall(r'<tr><th scope="row">(.*?)</th><td>(.*?)</td>', certificate._repr_html_()))
        for entry in (one for one in certificate.entries if one.kind == "guaranteed"):
            if isinstance(entry.value, float):
                assert float(shown[entry.key]) <= entry.value if entry.quantity.below else float(shown[entry.key]) >= entry.value
            ends = dict(re.findall(r"(lower|upper|value_upper|r|x_m) ([\d.e+-]+)", shown[entry.key]))
            if entry.key == "bounds":
                assert all(float(ends[name]) >= bound for name, bound in entry.value.items())
            if entry.key == "norms":
                pairs = re.findall(r"lower ([\d.e+-]+), upper ([\d.e+-]+)", shown["norms"])
                assert len(pairs) == len(entry.value)
                for (lower, upper), norm in zip(pairs, entry.value.values(), strict=True):
                    assert float(lower) <= norm["lower"] and float(upper) >= norm["upper"]


def test_a_certificate_plots_the_loops_whose_margins_it_has():
    case = load_case("paper")
    found = certify(case.problem, case.controllers, case.simulation)
    for certificate in found.values():
        assert len(repr(certificate)) < 200 and "guaranteed" in repr(certificate)
        assert isinstance(certificate.plot(), Figure)
        assert "<table>" in certificate._repr_html_()
    loop = found["MRAC"].loops[0]
    assert margins(loop.system, loop.delay).delay == pytest.approx(found["MRAC"].values["delay_margin"], rel=1e-12)
    assert "no linear loop" in refusal(type(found["MRAC"])().plot)
