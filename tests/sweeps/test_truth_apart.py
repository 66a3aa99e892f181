"""A sweep varies the simulated plant and keeps the design. With --redesign both are computed again."""

import json

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat import InputError, certify, simulate
from barbalat.cases.load import CaseText, parse_case
from barbalat.cli import main
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase, VariedObjects
from barbalat.studies import sweep
from barbalat.sweeps.known_set_draws import sampled

CASE = """
name = "spring"
[parameters]
k = { value = 1.3, between = [0.9, 1.7], distribution = "normal" }
m = { value = 0.5, tolerance = 0.1 }
d = 0.05
[plant]
A = [[0, 1], ["-k/m", "-d/m"]]
b = [0, 2.0]
x0 = [1.0, 0.0]
[plant.input]
gain = 0.9
[reference_model]
poles = [-3, -4]
k_0 = 6.0
[reference]
kind = "constant"
value = 0.0
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 1e-9
theta_hat0 = [4.5, 3.45]
"""
"""A controller whose estimates keep their initial values, so the loop is linear and known by an exponential."""
PLAIN = CASE.replace('["-k/m", "-d/m"]', "[-2.6, -0.1]").split("[parameters]")
PLAIN = PLAIN[0] + PLAIN[1][PLAIN[1].index("[plant]") :].replace("poles = [-3, -4]", "A_m = [[0, 1], [-12, -7]]")
PLAIN += "[uncertainty]\nlower = [3.0, 3.0]\nupper = [6.0, 4.0]\n"


def varied(text, path, **how):
    return VariedCase(CaseText(text), (FieldPath.parse(path),), **how)


def at_the_end(A, gain, theta_hat, b=(0.0, 2.0)):
    """x(1) of x' = A x + gain b u under u = -theta_hat'x."""
    return expm(np.asarray(A) - gain * np.outer(b, theta_hat)) @ [1.0, 0.0]


def simulated_end(case):
    return simulate(case.problem, case.controllers, case.simulation)["MRAC"].x[-1]


def test_a_parameter_moves_the_simulated_plant_alone():
    case = varied(CASE, "parameters.k", redesign=False).at([1.6])
    base = parse_case(CASE)
    assert np.array_equal(case.problem.known.A_m, base.problem.known.A_m)
    assert np.array_equal(case.problem.uncertainty.lower, base.problem.uncertainty.lower)
    A = [[0, 1], [-1.6 / 0.5, -0.1]]
    np.testing.assert_allclose(simulated_end(case), at_the_end(A, 0.9, [4.5, 3.45]), rtol=1e-6)
    anew = varied(CASE, "parameters.k", redesign=True).at([1.6]).problem
    assert anew.plant.physical.nominal["k"] == 1.6
    np.testing.assert_allclose(anew.plant.theta - base.problem.plant.theta, [-(1.6 - 1.3) / 0.5 / 2, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("path", "value", "A", "b"),
    [
        ("plant.A[1][0]", -4.0, [[0, 1], [-4.0, -0.1]], (0, 2)),
        ("plant.A[0][0]", -0.5, [[-0.5, 1], [-2.6, -0.1]], (0, 2)),  # unmatched
        ("plant.b[0]", 0.3, [[0, 1], [-2.6, -0.1]], (0.3, 2)),
    ],
)
def test_the_plant_s_own_numbers_too_and_nothing_is_refused_as_unmatched(path, value, A, b):
    for case in (
        varied(PLAIN, path, redesign=False).at([value]),
        VariedObjects(parse_case(PLAIN), (FieldPath.parse(path),), redesign=False).at([value]),
    ):
        assert np.array_equal(case.problem.known.b, [0, 2]) and np.array_equal(case.problem.known.A_m, [[0, 1], [-12, -7]])
        np.testing.assert_allclose(simulated_end(case), at_the_end(A, 0.9, [4.5, 3.45], b), rtol=1e-6)


def test_what_stands_before_the_input_is_the_truth_s_where_the_gain_s_interval_follows_from_it():
    text = CASE.replace("b = [0, 2.0]", 'b = [0, "1/m"]').replace("[4.5, 3.45]", "[4.5, 3.45, 0.9]")
    one, two = (varied(text, "plant.input.gain").at([gain]) for gain in (0.85, 0.95))
    assert one.problem.input_gain == two.problem.input_gain
    assert [case.problem.surroundings.paths[0].gain for case in (one, two)] == [0.85, 0.95]


def test_draws_between_the_ends_of_a_range():
    (k,) = sampled(CaseText(CASE), [("parameters.k", "between")]).values()
    shares = np.linspace(0, 1, 1001)
    values = k.at(shares)
    assert values[0] == pytest.approx(0.9) and values[-1] == pytest.approx(1.7) and values[500] == pytest.approx(1.3)
    assert np.interp(1.3 + 0.8 / 6, values, shares) == pytest.approx((0.8413447 - 0.00135) / 0.9973002, abs=1e-3)
    assert [str(path) for path in sampled(CaseText(CASE), [("parameters", "between")])] == ["parameters.k", "parameters.m"]


def test_a_sweep_over_all_ranges_stays_below_the_bound_for_the_whole_set():
    text = CASE.replace("gain = 0.9", "gain = 1.0").replace("gamma = 1e-9", "gamma = 5.0")
    case = parse_case(text)
    found = sweep(case, sample={"parameters": "between"}, members=40, audit=0)
    document = found.as_json()
    assert document["redesign"] is False and document["redesigned"] == {}
    worst = certify(case.problem, case.controllers, case.simulation)["MRAC"].values["error_bound_worst"]
    largest = max(found.column(f"MRAC/max_abs_e[{i}]").max() for i in (0, 1))
    assert largest <= worst and (found.column("MRAC/error_bound") == worst).all()


def test_both_paths_to_a_parameter_have_the_same_members_and_bounds():
    case = parse_case(CASE.replace("gain = 0.9", "gain = 1.0").replace("gamma = 1e-9", "gamma = 5.0"))
    one, other = (sweep(case, vary={path: "0.9:1.7:3"}) for path in ("parameters.k", "truth.parameters.k"))
    for column in ("MRAC/max_abs_e[0]", "MRAC/error_bound"):
        np.testing.assert_array_equal(one.column(column), other.column(column))
    assert np.isfinite(other.column("MRAC/error_bound")).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--sample", "parameters.K=between"], "the parameters are k, m, d; did you mean 'k'?"),
        (["--sample", "parameters.d=between"], "known exactly"),
        (["--sample", "plant.theta=known-set"], "theta follows from the parameters"),
        (["--sample", "plant.input.gain=between"], "needs a physical parameter"),
        (["--vary", "plant.A[1][0]=1:2:3"], "plant.A[1][0] is '-k/m', a formula: vary the parameters in it"),
    ],
)
def test_bad_input_is_one_clear_sentence(tmp_path, capsys, options, words):
    (tmp_path / "case.toml").write_text(CASE)
    assert main(["sweep", str(tmp_path / "case.toml"), *options, "--json"]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("asked", [[], ["--redesign"]])
def test_the_command_says_whether_it_redesigned(tmp_path, capsys, asked):
    (tmp_path / "case.toml").write_text(CASE)
    options = ["--vary", "parameters.k=1:1.6:3", "--audit", "0", "--no-bounds", "--json", *asked]
    assert main(["sweep", str(tmp_path / "case.toml"), *options]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["redesign"] is bool(asked)


WITH_A_LAG = """
name = "motor"
[plant]
A = [[0, 1], [2, -0.5]]
b = [0, 1.0]
x0 = [0.1, 0]
[labels]
names = ["angle", "rate"]
[reference_model]
poles = [-3, -4]
follow = "angle"
[reference]
kind = "sine"
amplitude = 0.5
frequency = 1
[truth]
states = ["lag", "angle", "rate"]
A = [[-40, 0, 0], [0, 0, 1], [1, 2.5, -0.4]]
b = [40, 0, 0]
x0 = [0, 0.1, 0]
[simulation]
t_end = 1
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 2
"""
"""A truth with different parameters, whose states have a different order than the plant's."""


@pytest.mark.parametrize(
    ("path", "instead"),
    [
        ("plant.A[1][0]", "gives A; vary truth.A[2][1], or vary the design with --redesign"),
        ("plant.b[1]", "gives b; vary truth.b[2], or vary the design with --redesign"),
        ("plant.x0[0]", "gives x0; vary truth.x0[1]"),
        ("plant.theta[0]", "gives the matrix A; vary truth.A"),
    ],
)
def test_a_number_that_the_truth_gives_itself_is_varied_there(path, instead):
    for varied_case in (
        varied(WITH_A_LAG, path, redesign=False),
        VariedObjects(parse_case(WITH_A_LAG), (FieldPath.parse(path),), redesign=False),
    ):
        with pytest.raises(InputError) as refused:
            varied_case.at([0.3])
        assert str(refused.value) == f"{path} is not simulated, because [truth] {instead}"


def test_the_design_s_own_number_leaves_the_truth_as_it_is():
    """The truth stays as it is with --redesign, and on an explorer's page."""
    own = parse_case(WITH_A_LAG).problem
    for redesign in (True, None):
        problem = varied(WITH_A_LAG, "plant.A[1][0]", redesign=redesign).at([3.0]).problem
        np.testing.assert_array_equal(problem.simulated.A, own.simulated.A)
        np.testing.assert_allclose(problem.plant.theta, own.plant.theta + np.array([1.0, 0.0]), rtol=1e-12)


def test_several_numbers_of_a_matrix_that_the_truth_does_not_give():
    text = WITH_A_LAG[: WITH_A_LAG.index("[truth]")] + "[truth]\nx0 = [0.2, 0]\n" + WITH_A_LAG[WITH_A_LAG.index("[simulation]") :]
    paths = tuple(FieldPath.parse(one) for one in ("plant.A[1][0]", "plant.A[1][1]"))
    for case in (VariedCase(CaseText(text), paths, redesign=False), VariedObjects(parse_case(text), paths, redesign=False)):
        np.testing.assert_array_equal(case.at([3.0, -0.7]).problem.simulated.A, [[0, 1], [3.0, -0.7]])


WITHOUT_J = WITH_A_LAG.replace(
    "[plant]\nA = [[0, 1], [2, -0.5]]",
    '[parameters]\nJ = { value = 0.5, between = [0.4, 0.6] }\n[plant]\nA = [[0, 1], ["1/J", -0.5]]',
)
"""A range that only the design contains."""


@pytest.mark.parametrize("path", ["parameters.J", "truth.parameters.J"])
def test_a_parameter_that_the_truth_does_not_contain_is_not_a_range_of_plants(path):
    paths = (FieldPath.parse(path), FieldPath.parse("controller[0].gamma"))
    for some in (paths[:1], paths):
        numbers = [0.45, 3.0][: len(some)]
        objects = VariedObjects(parse_case(WITHOUT_J), some, redesign=False)
        for case in (VariedCase(CaseText(WITHOUT_J), some, redesign=False), objects):
            with pytest.raises(InputError, match=f"{path} is not simulated: no formula of the simulated plant contains J;"):
                case.at(numbers)
    designed = varied(WITHOUT_J, "parameters.J", redesign=True).at([0.45]).problem
    assert designed.plant.physical.nominal["J"] == 0.45
    inside = WITHOUT_J.replace("[1, 2.5, -0.4]]", '["2*J", 2.5, -0.4]]')
    assert varied(inside, path, redesign=False).at([0.45]).problem.simulated.A[2, 0] == 0.9


def test_designs_for_one_truth_are_not_said_to_have_their_own_plants(tmp_path):
    path = tmp_path / "case.toml"
    in_b = WITHOUT_J.replace("b = [0, 1.0]", 'b = [0, "1/J"]')
    for text, name in ((WITH_A_LAG, "plant.b[1]"), (in_b, "parameters.J")):
        path.write_text(text)
        axes = {name: "0.4:0.6:2"}
        one = sweep(path, vary=axes, redesign=True, bounds=False, audit=0)
        several = sweep(path, vary={**axes, "truth.A[2][1]": "2:3:2"}, redesign=True, bounds=False, audit=0)
        for found, on in ((one, "the one plant of [truth]"), (several, "the plant of [truth]")):
            (note,) = found.redesign_notes
            assert note.endswith(f"from its own {name}: this sweep tries many designs, each on {on}")
    path.write_text(in_b.replace("[1, 2.5, -0.4]]", '["2*J", 2.5, -0.4]]'))
    (note,) = sweep(path, vary={"parameters.J": "0.4:0.6:2"}, redesign=True, bounds=False, audit=0).redesign_notes
    assert "each on its own plant" in note
