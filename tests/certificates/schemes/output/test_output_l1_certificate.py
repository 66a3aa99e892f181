"""Certificates of L1-AC and of linear controllers for a measured output: false statements are not proven, and the bundled case is
correct."""

import pytest

from barbalat.cases.load import load_case
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.controllers.output.linear import LinearOutput
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.output_feedback import OutputPlant
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant
from certificates.output_problems import SIMULATION, TF, l1, problem

CANNOT = {
    "gamma too small for an unstable plant": (
        problem(OutputPlant(transfer_function=TF([2.0], [1.0, -1.0]))),
        l1(gamma=0.01, lipschitz=0.0),
    ),
    "f too steep": (problem(OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]), nonlinear="40*y")), l1()),
    "lipschitz contradicted": (
        problem(OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]), nonlinear="-0.2*y**3 + 60*y")),
        l1(lipschitz=0.5),
    ),
    "wrong sign": (
        problem(OutputPlant(transfer_function=TF([-2.0], [1.0, 1.0]))),
        l1(design_plant=TF([2.0], [1.0, 1.0])),
    ),
    "sigma bound too small": (problem(disturbance=Constant(5.0)), l1(sigma_bound=0.5)),
    "saturation": (problem(OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]), input=PlantInput(saturation=[-1, 1]))), l1()),
    "noise": (problem(sensor=Sensor(noise=Noise(std=0.1, sample_time=0.01))), l1()),
    "PI and a steep f": (
        problem(OutputPlant(transfer_function=TF([2.0], [1.0, 1.0]), nonlinear="60*y")),
        LinearOutput(loop=TF([5.0, 5.0], [1.0, 0.0])),
    ),
}


@pytest.mark.parametrize("case", CANNOT)
def test_what_is_not_shown_is_not_called_proven(case):
    given, controller = CANNOT[case]
    certificates = certify(given, [controller], SIMULATION)
    (certificate,) = certificates.values()
    assert "output_bound" not in certificate.values
    bound = certificate.entry("output_bound")
    assert bound.kind == "does not apply" and bound.why
    (column,) = table_1(given, [controller], certificates).columns
    assert {column.cells[key].kind for key in ("stability", "tracking", "transient")} == {"does not apply"}


def test_a_contradicted_lipschitz_constant_does_not_hold():
    given, controller = CANNOT["lipschitz contradicted"]
    (certificate,) = certify(given, [controller], SIMULATION).values()
    assert not certificate.values["condition"]["holds"]
    assert any("not a Lipschitz constant" in finding for finding in certificate.findings)


def test_the_bundled_case_is_proven_and_runs_within_its_bounds():
    case = load_case("l1-output")
    certificates = certify(case.problem, case.controllers, case.simulation)
    runs = simulate(case.problem, case.controllers, case.simulation)
    for name, certificate in certificates.items():
        assert {"output_bound", "error_bound"} <= certificate.guaranteed
        assert runs[name].figures["max_abs_e"][0] <= certificate.values["error_bound"]
        assert runs[name].figures["max_abs_y"] <= certificate.values["output_bound"]
    assert certificates["L1 output"].values["condition"]["holds"]
    assert not any("Lipschitz" in finding for finding in certificates["L1 output"].findings)
    assert certificates["L1 output"].values["error_bound"] == pytest.approx(
        certificates["Linear equivalent"].values["error_bound"]
    )
