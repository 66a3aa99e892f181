"""The basis of the SISO row: the degrees and laws of its runs, which its condition names."""

import numpy as np
import pytest

from barbalat.papers.jafari_2013.output_feedback import relative_degree


def test_the_plants_and_models_have_their_degree():
    for degree, (plant, model) in relative_degree.DEGREES.items():
        assert plant.relative_degree == model.relative_degree == degree
        assert model.poles.real.max() < 0
    plant, model = relative_degree.DEGREES[4]
    np.testing.assert_allclose(np.sort(plant.poles.real), [-2, -1.5, -1, -0.5], rtol=1e-6)
    np.testing.assert_allclose(np.sort(model.poles.real), [-2, -1.5, -1, -1], rtol=1e-3)


@pytest.mark.parametrize("full", [False, True])
def test_what_was_run_is_said(full, monkeypatch):
    """There is no counterexample among the runs that the row names. A single one would refute the sentence."""
    asked = []
    monkeypatch.setattr(relative_degree, "_peaks", lambda degree, law, taus: asked.append((degree, law)) or taus)
    monkeypatch.setattr(relative_degree, "_last_quarters", lambda degree, law: (1.0, 1.0))
    claim = relative_degree.claim(full=full)
    assert len(asked) == (8 if full else 3)
    assert claim.finding == "holds" and f"degrees 1 to {4 if full else 3} with law (15)" in claim.shows
    assert "least squares" in claim.readings[0].measured and (len(claim.readings) == 3) == full
    monkeypatch.setattr(relative_degree, "_last_quarters", lambda degree, law: (1.0, 2.0 if degree == 3 else 1.0))
    assert relative_degree.claim(full=full).finding == "mixed"


@pytest.mark.full
def test_the_error_shrinks_for_relative_degree_4_too():
    peaks = relative_degree._peaks(4, relative_degree.LAWS["gradient"], np.array([0.1, 0.025]))
    assert peaks[1] < peaks[0] / 2
