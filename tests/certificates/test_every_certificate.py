"""Every scheme's certificate: its keys have a meaning, Table 1 has all rows, and no run contradicts it."""

from dataclasses import replace

import pytest
from contradictions import exceeded, judged

from barbalat import (
    KnownParameters,
    Mrac,
    OutputPlant,
    OutputProblem,
    OutputReferenceModel,
    Problem,
    Sampled,
    TransferFunction,
    simulate,
)
from barbalat.certificates.cells import PROPERTIES
from barbalat.certificates.certificate import Draft
from barbalat.controllers import SCHEMES
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.loop.binding import bound
from barbalat.problem.regressors import Terms
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from barbalat.validate import InputError
from independent import example_controllers, example_output_controllers

SIMULATION = Simulation(t_end=5.0, dt=2.0**-10)


def certificates_of(problem, controllers):
    """Each controller's certificate and column with a run, in continuous time and in its sampled forms."""
    forms = [None, "midpoint", "euler"]
    for controller, form in ((controller, form) for controller in controllers for form in forms):
        given = controller if form is None else Sampled(controller=controller, sample_time=2.0**-5, discretization=form)
        try:
            bound(problem, given)
        except InputError:
            assert form is not None
            continue
        (run,) = simulate(problem, [given], SIMULATION).values()
        yield *judged(problem, given, SIMULATION), run


def check(problem, controllers):
    for certificate, column, run in certificates_of(problem, controllers):
        assert list(column.cells) == list(PROPERTIES), f"{column.name}: Table 1 has these rows, in this order"
        assert [one for one in map(str, (*column.cells.values(), *certificate.notes)) if "computation fails" in one] == []
        for entry in certificate.entries:
            assert entry.meaning, f"{column.name}: {entry.key} has no meaning"
            assert entry.assumptions or entry.kind != "guaranteed", f"{column.name}: {entry.key} rests on nothing"
            assert [one.sentence for one in entry.rests_on] == list(entry.assumptions) or entry.kind != "guaranteed"
        assert certificate.rows or not certificate.entries
        assert exceeded(certificate, column, run) == []


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_scheme_for_measured_states(scheme, problems):
    check(problems[2], example_controllers(2)[scheme])


@pytest.mark.parametrize("scheme", OUTPUT_SCHEMES)
def test_a_scheme_for_a_measured_output(scheme):
    problem = OutputProblem(
        plant=OutputPlant(transfer_function=TransferFunction([2.0, 3.0], [1.0, 1.0, -0.5])),
        reference_model=OutputReferenceModel(transfer_function=TransferFunction([2.0], [1.0, 2.0])),
        reference=Sine(1.0, 1.0),
    )
    check(problem, example_output_controllers(2)[scheme])


def test_a_bound_rests_on_something():
    with pytest.raises(TypeError, match="error_bound is guaranteed without assumptions"):
        Draft().guarantee("error_bound", 1.0)


@pytest.mark.parametrize("formula", ["1/x1", "sqrt(x1)"])
def test_nothing_is_known_where_the_regressor_is_no_number(formula, problems):
    """1/x1 has no value at x = 0, so no scheme's loop has a solution, not even with known parameters."""
    given = problems[1]
    plant = replace(given.plant, theta=[1.0], regressor=Terms(terms=[formula]), x0=[0.0])
    problem = Problem(plant=plant, reference_model=given.reference_model, reference=given.reference)
    for controller in (KnownParameters(theta=[1.0]), Mrac(gamma=1.0)):
        _, column = judged(problem, controller, SIMULATION)
        claimed = [key for key, cell in column.cells.items() if cell.kind == "guaranteed"]
        assert claimed == [], (controller.name, claimed)
