"""Pictures of the loops whose margins are in a certificate, with marks at the margins."""

import pickle
import re

import numpy as np
import pytest
from matplotlib.figure import Figure

from barbalat import TransferFunction
from barbalat.certificates.picture import MarginLoop, Marked, figure_of
from barbalat.certificates.rows import up
from barbalat.results import Certificate
from barbalat.systems import margins
from independent import refusal


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_the_marks_are_where_the_margins_are(delay):
    """For L = 2/(s (s + 1)(s + 4)), |L| = 1 at one mark and L = -1/gain margin at the other."""
    loop = TransferFunction([2.0], [1.0, 5.0, 4.0, 0.0]).realise()
    found, drawn = margins(loop, delay), Marked.of(MarginLoop("L", loop, delay)).response(1e-3, 1e3)
    assert abs(drawn.value(drawn.at_phase)) == pytest.approx(1.0, rel=1e-6)
    assert np.angle(-drawn.value(drawn.at_phase)) == pytest.approx(found.phase, rel=1e-6)
    assert drawn.value(drawn.at_gain) == pytest.approx(-1 / found.gain_up, rel=1e-6)
    at = int(np.abs(drawn.w - drawn.at_phase).argmin())
    assert drawn.phase[at] == pytest.approx(-180 + np.degrees(found.phase), rel=1e-6)
    if delay == 0:  # Routh: 20/2
        assert found.gain_up == pytest.approx(10.0, rel=1e-9)


def test_several_certificates_are_a_dictionary_that_shows_itself(certified):
    """The dictionary prints on one line. In a notebook it shows five lines for each controller and every loop. Otherwise it
    behaves like a plain dictionary."""
    _, found = certified("paper")
    assert isinstance(found, dict) and found == dict(found) and pickle.loads(pickle.dumps(found)) == found
    text = repr(found)
    assert "\n" not in text and all(f"{name!r} {one.in_brief}" in text for name, one in found.items())
    html = found._repr_html_()
    assert html.count("<tr>") == 6 * len(found) and html.count("<img") == 1
    bound = up(found["L1"].values["error_bound_worst"])  # below error_bound
    assert f"guaranteed: {bound}" in html.replace("\N{NO-BREAK SPACE}", " ")
    assert isinstance(found.plot(), Figure)
    assert "no linear loop" in refusal(found.with_changed(dict.fromkeys(found, Certificate())).plot)


def test_many_loops_are_told_apart(certified):
    """Colour and dash together identify each line. The legend shows them and the widths."""
    loops = certified("paper")[1]["MRAC"].loops
    figure = figure_of([MarginLoop(f"loop {i}", loops[0].system, 0.001 * i) for i in range(9)], "", shown=False)
    lines = figure.legends[0].legend_handles[:9]
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 9


def test_a_certificate_plots_the_loops_whose_margins_it_has(certified):
    _, found = certified("paper")
    for certificate in found.values():
        assert len(repr(certificate)) < 200 and "guaranteed" in repr(certificate)
        assert isinstance(certificate.plot(), Figure)
        html = certificate._repr_html_()
        assert "<table>" in html and html.count("<img") == 1
        for key in {"nu_0", "error_bound"} & certificate.guaranteed:  # rounded outward
            printed = float(re.search(rf"<th scope=.row.>{key}</th><td>([^<]*)</td>", html)[1])
            assert certificate.values[key] <= printed <= 1.001 * certificate.values[key]
    loop = found["MRAC"].loops[0]
    assert margins(loop.system, loop.delay).delay == pytest.approx(found["MRAC"].values["delay_margin"], rel=1e-12)
    assert "no linear loop" in refusal(type(found["MRAC"])().plot)
