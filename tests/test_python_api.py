"""What the README shows in Python runs, and the certificates' names are the same objects in whatever order they are imported."""

import re
import subprocess
import sys
from pathlib import Path

import control
import numpy as np
import pytest

import barbalat
from barbalat import InputError, StateSpace, TransferFunction, certify, l1_norm, margins
from barbalat.cases.load import load_case
from independent import refusal


def test_the_examples_of_the_readme_run(capsys):
    blocks = re.findall(r"```python\n(.*?)```", Path(__file__).parents[1].joinpath("README.md").read_text(), re.DOTALL)
    assert len(blocks) >= 3
    exec("\n".join(blocks), {})
    shown = capsys.readouterr().out
    assert "'holds': True" in shown and "Margins(gain_up=" in shown


@pytest.mark.parametrize("before", ["", "import barbalat.certificates.certify", "from barbalat import *"])
def test_certify_can_be_called_whatever_was_imported_before(before):
    code = f"""
{before}
from barbalat import certify
import barbalat.linear.margins
import barbalat
assert callable(certify) and barbalat.certify is certify
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_certify_gives_a_certificate_for_each_controller():
    case = load_case("first-order")
    found = certify(case.problem, list(case.controllers), case.simulation)
    assert list(found) == [controller.name for controller in case.controllers]
    assert all(isinstance(one, barbalat.Certificate) for one in found.values())


def test_the_norm_of_a_system_in_every_form():
    """The standard second order's closed form: the step response's total variation (1 + q)/(1 - q), q its overshoot."""
    zeta = 0.3
    q = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    exact = (1 + q) / (1 - q)
    ours = TransferFunction([4.0], [1.0, 4 * zeta, 4.0])
    theirs = control.tf([4.0], [1.0, 4 * zeta, 4.0])
    for system in (ours, ours.realise(), theirs, control.ss(theirs)):
        found = l1_norm(system)
        assert found.lower <= exact * (1 + 1e-14) and found.upper >= exact * (1 - 1e-14)
        assert found.relative_width < 1e-9
    A, B, C, D = np.diag([-1.0, -2.0]), np.eye(2), np.array([[1.0, 2.0]]), np.array([[0.5, 0.0]])
    several = l1_norm(control.ss(A, B, C, D))
    assert several == l1_norm(A, B, C, D)
    assert several.midpoint == pytest.approx(1 + 1 + 0.5, rel=1e-9)


def test_what_is_no_system_is_refused():
    assert "l1_norm takes the matrices" in refusal(lambda: l1_norm("s"))
    with pytest.raises(ValueError, match="not given: C, D"):
        l1_norm([[-1.0]], [[1.0]])
    assert "proper" in refusal(lambda: l1_norm(TransferFunction([1.0, 0.0, 0.0], [1.0, 1.0])))
    assert "sample time 0.1" in refusal(lambda: l1_norm(control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1)))
    with pytest.raises(ValueError, match="Hurwitz"):
        l1_norm(TransferFunction([1.0], [1.0, -1.0]))


def test_margins_of_a_loop_in_every_form():
    ours = TransferFunction([2.0], [1.0, 3.0, 3.0, 1.0])
    for loop in (ours, ours.realise(), control.tf([2.0], [1.0, 3.0, 3.0, 1.0])):
        assert margins(loop).gain_up == pytest.approx(4, rel=1e-9)
    assert "delay" in refusal(lambda: margins(ours, -1.0))
    assert "loop" in refusal(lambda: margins([[1.0]]))
    assert isinstance(ours.realise(), StateSpace) and issubclass(InputError, ValueError)
