"""Table 1: its constants come from the certificate, and it claims a proof only if the assumptions hold."""

import json
import math
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barbalat import (
    L1Adaptive,
    LinearFeedback,
    Mrac,
    NormalizedMrac,
    RobustMrac,
    Sampled,
    Simulation,
    TransferFunction,
    input_filter,
)
from barbalat.adaptation.law import Normalization
from barbalat.adaptation.modifications import FixedSigma, SwitchingSigma
from barbalat.cases.bundled import bundled
from barbalat.cases.load import load_case
from barbalat.certificates.certificates import PROPERTIES, table_1
from barbalat.certificates.certify import certify_where_possible
from barbalat.certificates.rows import down, up
from barbalat.cli import main
from barbalat.laws import Gradient, LeastSquares
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.plants import PlantInput
from barbalat.signals import Constant

SIMULATION = Simulation(t_end=60.0, dt=1e-4)
DYNAMIC = Normalization(alpha_0=1.0)


def column(problem, controller):
    certificates = certify_where_possible(problem, [controller], SIMULATION)
    (found,) = table_1(problem, [controller], certificates).columns
    assert set(found.cells) == set(PROPERTIES)
    return found.cells, certificates[controller.name].values


@pytest.mark.parametrize("name", bundled())
def test_every_bundled_controller_has_a_column(name, certified):
    case, certificates = certified(name)
    assert not any("computation fails" in note for certificate in certificates.values() for note in certificate.notes)
    found = table_1(case.problem, case.controllers, certificates)
    assert [c.name for c in found.columns] == [c.name for c in case.controllers]
    for each in found.columns:
        assert set(each.cells) == set(PROPERTIES)
        assert all(cell.text for cell in each.cells.values())
        assert not any(
            "computation fails" in str(cell) for cell in each.cells.values()
        )  # only an error in the package would give this message


def test_the_constants_are_the_certificates():
    cells, values = column(variant(), Mrac(gamma=10.0))
    assert f"= {up(values['error_bound'])} at all times" in cells["transient"].text
    assert f"{up(values['error_bound_worst'])} for the worst" in cells["transient"].text
    cells, values = column(variant(), L1Adaptive(gamma=1e4, filter=input_filter(0.02)))
    assert f"|e| <= {up(values['error_bound'])}" in cells["transient"].text
    assert f"<= {up(values['condition']['value_upper'])} < 1" in cells["stability"].text
    assert f"kappa = {down(values['kappa_admissible'])} s" in cells["tuning"].text
    assert f"{values['margins_over_known_set'][0]['delay_margin']['value']:.4g} s" in cells["margins"].text


@pytest.mark.dear
def test_what_the_paper_says_of_the_two_schemes():
    """Theorem 1: MRAC converges for every r. L1-AC is only bounded, and only under the condition on C(s)."""
    mrac, _ = column(variant(), Mrac(gamma=10.0))
    l1, _ = column(variant(), L1Adaptive(gamma=1e4, filter=input_filter(0.02)))
    slow, _ = column(variant(), L1Adaptive(gamma=1e4, filter=input_filter(0.06)))
    free, _ = column(variant(), L1Adaptive(gamma=1e4, filter=input_filter(0.02), projection=False))
    one, _ = column(variant(), L1Adaptive(gamma=10.0, filter=None))
    assert mrac["tracking"].kind == one["tracking"].kind == "guaranteed"
    assert l1["stability"].kind == "guaranteed" and l1["tracking"].kind == "does not apply"
    for cells in (slow, free):
        assert cells["stability"].kind == cells["transient"].kind == "does not apply"
    assert mrac["modelling_error"].kind == l1["modelling_error"].kind == "does not apply"


def test_robustness_is_proven_only_with_its_ingredients():
    law = Gradient(gamma=10.0)
    assert column(variant(), NormalizedMrac(law=law, normalization=DYNAMIC))[0]["modelling_error"].kind == "guaranteed"
    for missing in (
        NormalizedMrac(law=law),  # alpha_0 = 0
        NormalizedMrac(law=law, normalization=DYNAMIC, projection=False),  # neither projection nor leakage
        Mrac(gamma=10.0),
    ):
        assert column(variant(), missing)[0]["modelling_error"].kind == "does not apply"
    leakages = ((SwitchingSigma(sigma=0.1, M_0=9.0), "guaranteed"), (FixedSigma(sigma=0.1), "does not apply"))
    for leakage, kind in leakages:  # a fixed sigma would have to be small enough, and M_0 bounds theta
        leaking = NormalizedMrac(law=Gradient(gamma=10.0, leakage=leakage), normalization=DYNAMIC, projection=False)
        cells, _ = column(variant(), leaking)
        assert cells["modelling_error"].kind == cells["tracking"].kind == kind


def test_the_auxiliary_input_decides():
    law = LeastSquares(covariance0=500.0)
    assert column(variant(), RobustMrac(tau=0.5, law=law))[0]["transient"].kind == "guaranteed"
    assert column(variant(), NormalizedMrac(law=law))[0]["transient"].kind == "does not apply"


def test_a_modified_law_loses_what_it_loses():
    cells, _ = column(variant(), Mrac(gamma=10.0, leakage=FixedSigma(sigma=0.1)))
    assert {key for key in ("tracking", "transient", "estimates") if cells[key].kind == "guaranteed"} == set()


@pytest.mark.dear
def test_sampling_takes_the_proofs_away_but_one():
    midpoint, _ = column(variant(), Sampled(controller=Mrac(gamma=10.0), sample_time=1e-3))
    euler, _ = column(variant(), Sampled(controller=Mrac(gamma=10.0), sample_time=1e-3, discretization="euler"))
    assert [key for key, cell in midpoint.items() if cell.kind == "guaranteed"] == ["estimates"]
    assert not any(cell.kind == "guaranteed" for cell in euler.values())
    leaking, _ = column(variant(), Sampled(controller=Mrac(gamma=10.0, leakage=FixedSigma(sigma=0.1)), sample_time=1e-3))
    assert leaking["estimates"].kind == "guaranteed" and "T w |theta|^2/2" in leaking["estimates"].text
    linear, _ = column(
        variant(), Sampled(controller=LinearFeedback(controller=TransferFunction([1.0], [1.0, 0.0])), sample_time=1e-3)
    )
    assert not any(cell.kind == "guaranteed" for cell in linear.values())


def test_a_normalised_law_claims_nothing_of_a_fast_growing_regressor():
    case = load_case("wing-rock")
    found = table_1(case.problem, case.controllers, certify_where_possible(case.problem, case.controllers, case.simulation))
    kinds = {c.name: c.cells["stability"].kind for c in found.columns}
    assert kinds == {"MRAC": "guaranteed", "L1": "does not apply", "Robust MRAC": "does not apply", "Network": "does not apply"}


def test_a_case_beyond_the_plant_is_said_to_violate_it():
    for given_case, word in (
        (replace(variant(), disturbance=Constant(1.0)), "disturbance"),
        (variant(input=PlantInput(delay=0.01)), "delay"),
        (variant(theta=[7.0, 0.0]), "outside the known set"),
    ):
        cells, values = column(given_case, Mrac(gamma=1.0))
        carried = word == "disturbance"  # V stays bounded with a bounded one
        for key in ("tracking", "estimates", *(() if carried else ("stability", "transient"))):
            assert cells[key].kind == "does not apply" and word in cells[key].why
        assert ("error_bound" in values) is carried


def test_what_cant_be_certified_says_why():
    class Unbounded:
        def __call__(self, t):
            return t

        before = __call__

    found = certify_where_possible(replace(variant(), reference=Unbounded()), [Mrac(gamma=1.0)], SIMULATION)["MRAC"]
    assert found.values == {} and "needs a reference with a known bound" in found.findings[0]


def test_json(capsys):
    assert main(["certify", "paper", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)["table_1"]
    assert [c["name"] for c in table["columns"]] == ["Robust MRAC", "L1", "MRAC"]
    tracking = table["columns"][2]["tracking"]
    assert tracking["kind"] == "guaranteed" and tracking["text"] == "converges to zero for every bounded r"
    assert "no disturbance acts" in tracking["assumptions"] and tracking["why"] == ""


@given(st.floats(min_value=1e-300, max_value=1e300), st.integers(2, 10))
def test_printed_bounds_are_bounds(value, digits):
    low, high = down(value, digits), up(value, digits)
    assert Decimal(low) <= Decimal(value) <= Decimal(high)
    assert float(high) - float(low) <= 10.0 ** (math.floor(math.log10(value)) - digits + 2)
    assert len(Decimal(high).normalize().as_tuple().digits) <= digits


def test_a_cell_names_all_that_contradicts_it():
    """The filter is too slow for the condition, and the input is also delayed and saturated."""
    given = variant(input=PlantInput(delay=0.3, saturation=[-3.0, 3.0]))
    cells, _ = column(given, L1Adaptive(gamma=100.0, filter=input_filter(0.3)))
    for key in ("stability", "tracking"):
        assert not cells[key].applies
        for reason in ("is only known to be <=", "delay 0.3 s", "saturation"):
            assert reason in cells[key].text, (key, reason)
