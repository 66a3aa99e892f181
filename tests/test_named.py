"""Dictionaries with typed names: an unknown name is reported with the most similar one."""

from __future__ import annotations

import copy
import pickle

import pytest

from barbalat import Mrac, ParameterBox, Simulation, certify, simulate
from barbalat.plants import ParameterBall
from barbalat.studies import check_numerics, delay_margins
from barbalat.validate import Named
from independent import refusal

SIMULATION = Simulation(t_end=1.0, dt=1e-2)


def said(mapping, name) -> str:
    with pytest.raises(KeyError) as raised:
        mapping[name]
    return str(raised.value)


def test_the_results_of_several_controllers(problems):
    found = simulate(problems[2], [Mrac(gamma=5.0)], SIMULATION)
    result = found["MRAC"]
    assert said(found, "mrac") == "there is no controller 'mrac'; did you mean 'MRAC'?"
    assert said(check_numerics(found), "mrac") == said(found, "mrac")
    assert said(found, "L1") == "there is no controller 'L1'; known here: 'MRAC'"
    assert "did you mean 'max_abs_e'?" in said(result.figures, "max_abs_ee")
    assert "did you mean 'theta_hat_1'?" in said(result.columns(), "theta_hat1")
    assert said(result.reported, "k_r_hat") == "there is no reported quantity 'k_r_hat'; there is none"
    margins = delay_margins(problems[2], [Mrac(gamma=5.0)], SIMULATION, scan=2, resolution=0.5)
    assert said(margins, "mrac") == said(found, "mrac")


def test_certificates(problems):
    found = certify(problems[2], [Mrac(gamma=5.0)], SIMULATION)
    values = found["MRAC"].values
    assert said(found, "MRAC2") == "there is no controller 'MRAC2'; did you mean 'MRAC'?"
    assert said(values, "error_bond") == "there is no value 'error_bond'; did you mean 'error_bound'?"
    entries = [entry for entry in found["MRAC"].entries if not entry.applies]
    assert all(said(values, entry.key) == f"{entry.key} does not apply to this case: {entry.why}" for entry in entries)
    (column,) = found.table.columns
    assert "did you mean 'tracking'?" in said(column.cells, "traking")


def test_what_does_not_apply_says_why(problems):
    """A controller without estimates has no adaptation, and no bound is known for a user-defined class."""
    from foreign import Plain

    values = certify(problems[2], [Plain(5.0)], SIMULATION)["plain"].values
    assert said(values, "error_bound") == "error_bound does not apply to this case: no proof is known for this controller"
    assert values.get("error_bound") is None and "error_bound" not in values


def test_a_named_dictionary_is_one():
    """A named dictionary is copied, pickled and compared like a plain one, and keeps its messages."""
    named = Named.of("figure", {"max |e|": 1.0}, {"RMS e": "is not computed"})
    for same in (copy.copy(named), copy.deepcopy(named), pickle.loads(pickle.dumps(named))):
        assert same == {"max |e|": 1.0} == named
        assert said(same, "max|e|") == "there is no figure 'max|e|'; did you mean 'max |e|'?"
        assert said(same, "RMS e") == "RMS e is not computed"


def test_a_known_set_takes_matrices_as_theta_does():
    """The ends of a set are given by rows, as in files. The two ends of a box must have the same shape."""
    box = ParameterBox(lower=[[-1, -2], [-3, -4], [-5, -6]], upper=[[1, 2], [3, 4], [5, 6]])
    assert box.lower.tolist() == [-1, -2, -3, -4, -5, -6] and box.upper.tolist() == [1, 2, 3, 4, 5, 6]
    assert ParameterBall(center=[[1, 2], [3, 4]], radius=1.0).center.tolist() == [1, 2, 3, 4]
    message = refusal(lambda: ParameterBox(lower=[[0, 0], [0, 0], [0, 0]], upper=[[1, 1, 1], [1, 1, 1]]))
    assert "uncertainty.upper must have shape 3 x 2, got 2 x 3" in message
