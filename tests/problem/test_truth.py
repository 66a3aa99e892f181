"""The simulated plant if it differs from the design's, compared with SciPy's integration of the true plant with the same
controller."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from barbalat import InputError, Mrac, ParameterBox, Plant, Problem, ReferenceModel, Simulation, certify, simulate
from barbalat.cases.load import load_case, parse_case
from barbalat.certificates.certify import certified_case
from barbalat.plants import Disturbance, Friction, Labels, Parameter, PlantInput, Truth
from barbalat.problem.departures import departures, sets_and_truth
from barbalat.report.documents import run_document
from barbalat.signals import Sine, Step

A_m, b = np.array([[0.0, 1.0], [-4.0, -3.0]]), np.array([0.0, 2.0])
SIMULATION = Simulation(t_end=4.0, dt=1e-3)
LAW = Mrac(gamma=3.0, projection=False)


def designed(**more):
    plant = Plant(A_m=A_m, b=b, theta=[1.0, -0.5], x0=[0.3, 0.0])
    labels = Labels(names=("angle", "rate"))
    return Problem(
        plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Sine(amplitude=1.0, frequency=1.5), labels=labels, **more
    )


def by_scipy(problem, x0, rate, seen=lambda x: x):
    """e at the end for MRAC (3)-(4) with x' = rate(t, x, u), written by hand. ``seen`` is the controller's measurement."""
    P, N = problem.known.P, len(x0)

    def rates(t, z):
        x, x_m, theta_hat = z[:N], z[N : N + 2], z[N + 2 :]
        y, r = seen(x), np.sin(1.5 * t)
        u = -theta_hat @ y + 2.0 * r
        return [*rate(t, x, u), *(A_m @ x_m + b * 2.0 * r), *(LAW.gamma * ((y - x_m) @ P @ b) * y)]

    z = solve_ivp(rates, (0, 4), [*x0, *problem.plant.x0, 0, 0], rtol=1e-10, atol=1e-12).y[:, -1]
    return seen(z[:N]) - z[N : N + 2]


def final_error(problem):
    run = simulate(problem, [LAW], SIMULATION)["MRAC"]
    return run.x[-1] - run.x_m[-1]


A_TRUE = np.array([[0.0, 1.0], [-3.0, -1.0]])


def test_another_plant_friction_a_disturbance_and_terms():
    truth = Truth(
        A=A_TRUE,
        b=[0.1, 1.6],
        x0=[0.0, 0.5],
        disturbance=Sine(amplitude=0.2, frequency=3.0),
        unmatched=[Disturbance(direction=[1.0, 0.0], signal=Sine(amplitude=0.1, frequency=2.0))],
        friction=[Friction(state="rate", coulomb=0.4, width=0.2)],
        terms={"rate": "-0.3*x1**3 + 0.1*u*abs(x2)", "angle": "0.05*sin(x2)"},
    )

    def rate(t, x, u):
        v = u + 0.2 * np.sin(3 * t)
        added = np.array([0.05 * np.sin(x[1]), -0.3 * x[0] ** 3 + 0.1 * v * abs(x[1]) - 0.4 * np.tanh(x[1] / 0.2)])
        return A_TRUE @ x + np.array([0.1, 1.6]) * v + [0.1 * np.sin(2 * t), 0] + added

    problem = designed(truth=truth)
    np.testing.assert_allclose(final_error(problem), by_scipy(problem, [0.0, 0.5], rate), atol=1e-7)


@pytest.mark.parametrize(
    ("states", "S"),
    [
        (("rate", "motor", "angle"), [[0, 0, 1], [1, 0, 0]]),
        ([[0.0, 0.2, 1.0], [1.0, 0.0, 0.0]], [[0, 0.2, 1], [1, 0, 0]]),
    ],
    ids=["names", "matrix"],
)
def test_a_truth_with_a_further_state(states, S):
    """A motor's lag before the input, in a different order of states or with a combination of them as measurement."""
    A, B = np.array([[-1.0, 2.0, -3.0], [0.0, -20.0, 0.0], [1.0, 0.0, 0.0]]), np.array([0.0, 20.0, 0.0])
    problem = designed(truth=Truth(A=A, b=B, x0=[0.0, 0.1, 0.3], states=states))
    S = np.array(S, dtype=float)
    expected = by_scipy(problem, [0.0, 0.1, 0.3], lambda t, x, u: A @ x + B * u, lambda x: S @ x)
    np.testing.assert_allclose(final_error(problem), expected, atol=1e-7)
    assert simulate(problem, [LAW], SIMULATION)["MRAC"].x.shape[1] == 2
    assert "3 states, but the plant has 2" in departures(problem)[0].sentence


def test_parameters_of_the_truth_move_the_simulated_plant_and_no_controller():
    k, J = Parameter("k", 1.0, between=(0.5, 2.0)), Parameter("J", 0.5, tolerance=0.2)
    plant = Plant(A=[[0, 1], [-k / J, -0.1]], b=[0, 1 / J], A_m=A_m, x0=[0.3, 0.0])
    nominal = Problem(plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Sine(amplitude=1.0, frequency=1.5))
    moved = replace(nominal, truth=Truth(parameters={"k": 1.7, "J": 0.45}))
    law = replace(LAW, theta_hat0=[0, 0, 1.0], gamma=0.1)  # so low that omega_hat stays inside its interval
    known, other = nominal.known, moved.known
    assert (known.A_m == other.A_m).all() and (known.b == other.b).all() and known.estimate_set.contains(moved.true_parameters)
    run = simulate(moved, [law], SIMULATION)["MRAC"]
    P = nominal.known.P

    def rates(t, z):
        x, x_m, theta, omega = z[:2], z[2:4], z[4:6], z[6]
        r = np.sin(1.5 * t)
        u = (2.0 * r - theta @ x) / omega
        s = (x - x_m) @ P @ [0, 2.0]
        return [
            x[1],
            -1.7 / 0.45 * x[0] - 0.1 * x[1] + u / 0.45,
            *(A_m @ x_m + b * 2 * r),
            *(law.gamma * s * x),
            law.gamma * s * u,
        ]

    z = solve_ivp(rates, (0, 4), [0.3, 0, 0.3, 0, 0, 0, 1], rtol=1e-10, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(run.x[-1] - run.x_m[-1], z[:2] - z[2:4], atol=1e-7)
    np.testing.assert_allclose(moved.true_parameters, [(4 - 1.7 / 0.45) / 2, (3 - 0.1) / 2, 0.5 / 0.45], rtol=1e-12)


def test_parameters_outside_their_ranges_are_reported_with_other_states_and_inside_the_box_of_theta():
    """J and K both 1.4 times nominal give the nominal gain, which the box of omega contains."""
    J, K = Parameter("J", 0.5, tolerance=0.2), Parameter("K", 1.0, tolerance=0.3)
    d = Parameter("d", 0.1)
    plant = Plant(A=[[0, 1], [0, -d]], b=[0, K / J], A_m=A_m)
    labels = Labels(names=("angle", "rate"))
    nominal = Problem(
        plant=plant, reference_model=ReferenceModel(k_0=2.0), reference=Sine(amplitude=1.0, frequency=1.5), labels=labels
    )
    more = {"A": np.zeros((3, 3)), "b": [0, 1, 1], "states": ("angle", "rate")}
    for further in ({}, more):
        found = departures(replace(nominal, truth=Truth(parameters={"J": 0.7, "K": 1.4}, **further)))
        said = {one.sentence: one.within for one in found}
        assert said["its J is 0.7, outside its range [0.4, 0.6]"] is said["its K is 1.4, outside its range [0.7, 1.3]"] is False
        found = departures(replace(nominal, truth=Truth(parameters={"J": 0.4, "d": 0.2}, **further)))
        said = {one.sentence: one.within for one in found}
        assert said["its d is 0.2, declared as 0.1"] is False and not any("outside its range" in one for one in said)
        assert ("its J is 0.4 (the plant's is 0.5) and lies in its range" in said) == bool(further)


def test_without_a_truth_nothing_changes_and_a_truth_that_is_the_plant_runs_alike():
    plain, same = designed(), designed(truth=Truth())
    assert plain.dynamics is plain.plant and departures(same) == []
    one, two = (simulate(problem, [LAW], SIMULATION)["MRAC"] for problem in (plain, same))
    np.testing.assert_allclose(one.x, two.x, rtol=0, atol=1e-12)


def test_a_truth_of_several_inputs_and_of_a_nonlinear_regressor():
    for name in ("mass-spring-damper", "wing-rock"):
        case = load_case(name)
        problem = case.problem
        one, two = (
            simulate(p, case.controllers[:1], Simulation(t_end=0.5, dt=1e-3)) for p in (problem, replace(problem, truth=Truth()))
        )
        for a, c in zip(one.values(), two.values(), strict=True):
            np.testing.assert_allclose(a.x, c.x, rtol=1e-9, atol=1e-12)


def voided(problem):
    found = certify(problem, [replace(LAW, name="kept", projection=True)], SIMULATION)
    return found.further_blocks["truth"]["voids"]


def test_what_a_truth_voids():
    """With theta elsewhere in the set, guarantees for the whole set remain. With theta outside or with a disturbance, no
    guarantee remains."""
    inside = designed(uncertainty=ParameterBox(lower=[-2.0, -2.0], upper=[2.0, 2.0]))
    own = inside.plant.A

    def at(theta):
        return replace(inside, truth=Truth(A=A_m + np.outer(b, theta)))

    assert voided(replace(inside, truth=Truth(A=own)))["kept"] == []
    kept = voided(at([1.5, 1.0]))["kept"]
    assert "error_bound" in kept and "error_bound_worst" not in kept
    assert {"error_bound", "error_bound_worst"} <= set(voided(at([3.0, 0.0]))["kept"])
    rest = np.array([[0.0, 0.1], [0.0, 0.0]])
    for truth in (
        Truth(A=own + rest),
        Truth(input=PlantInput(delay=0.01)),
        Truth(disturbance=Step(amplitude=1.0)),
        Truth(friction=[Friction(state="rate", coulomb=0.1, width=0.1)]),
        Truth(x0=[0.0, 0.0]),
    ):
        assert {"error_bound", "error_bound_worst"} <= set(voided(replace(inside, truth=truth))["kept"]), truth


def test_a_gain_of_a_plant_with_a_regressor_departs_too():
    problem = load_case("wing-rock").problem
    unknown = replace(problem, input_gain=(0.4, 2.5))
    for truth in (Truth(b=2 * problem.plant.b), Truth(input=PlantInput(gain=2.0))):
        (found,) = departures(replace(problem, truth=truth))
        assert "its input gain is 2 (the plant's is 1), but the gain is declared as known" in found.sentence and not found.within
        (found,) = departures(replace(unknown, truth=truth))
        assert found.within and replace(unknown, truth=truth).true_parameters[-1] == 2.0
    (found,) = departures(replace(problem, truth=Truth(b=[0.1, 1.0])))
    assert "b has an unmatched remainder" in found.sentence


def test_certificates_come_from_the_plant_and_the_declared_sets_alone():
    inside = designed(uncertainty=ParameterBox(lower=[-2.0, -2.0], upper=[2.0, 2.0]))
    truth = Truth(A=A_TRUE, b=[0.0, 1.0], input=PlantInput(delay=0.05, saturation=[-1, 1]), disturbance=Step(amplitude=1.0))
    one, two = (certify(p, [LAW], SIMULATION)["MRAC"] for p in (inside, replace(inside, truth=truth)))
    assert one.values == two.values and len(two.notes) > len(one.notes)
    assert [replace(entry, kind="") for entry in one.entries] == [replace(entry, kind="") for entry in two.entries]


def test_what_the_truth_voids_is_nowhere_called_guaranteed():
    """With theta elsewhere in the set, the bound for the whole set and boundedness remain. With another delay nothing remains."""
    inside = designed(uncertainty=ParameterBox(lower=[-2.0, -2.0], upper=[2.0, 2.0]))
    law = replace(LAW, projection=True)

    def kinds(truth):
        found = certify(replace(inside, truth=truth), [law], SIMULATION, keys=("error_bound", "error_bound_worst", "theta_max"))
        entries, cells = (
            {one.key: one.kind for one in part} for part in (found["MRAC"].entries, found.table.columns[0].cells.values())
        )
        return [entries[key] for key in ("error_bound", "error_bound_worst", "theta_max")], [
            cells["stability"],
            cells["transient"],
        ]

    yes, apart = "guaranteed", "guaranteed for the design"
    assert kinds(None) == ([yes, yes, yes], [yes, yes])
    assert kinds(Truth(A=A_m + np.outer(b, [1.5, 1.0]))) == ([apart, yes, yes], [yes, apart])
    assert kinds(Truth(input=PlantInput(delay=0.01))) == ([apart, apart, yes], [apart, apart])


CASE = """
name = "Joint"
[parameters]
k = { value = 1.3, between = [0.9, 1.7], unit = "N m/rad" }
J = { value = 0.2, tolerance = 0.1 }
[plant]
A = [[0, 1], ["-k/J", -0.5]]
b = [0, "1/J"]
[plant.input]
delay = "0.01*J/0.2"
actuator = { num = ["20*J"], den = [1, "20*J"] }
[sensor]
lag = "0.01*J"
[reference_model]
poles = [-3, -4]
follow = "angle"
[reference]
kind = "step"
amplitude = 1.0
[labels]
names = ["angle", "rate"]
[truth]
parameters = { k = 1.6 }
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
scheme = "mrac"
gamma = 1.0
"""


def test_a_case_file_says_all_that():
    problem = parse_case(CASE.replace("parameters = { k = 1.6 }", "parameters = { k = 1.6, J = 0.22 }")).problem
    np.testing.assert_allclose(problem.simulated.A, [[0, 1], [-1.6 / 0.22, -0.5]])
    np.testing.assert_allclose(problem.plant.A, [[0, 1], [-1.3 / 0.2, -0.5]], atol=1e-12)
    np.testing.assert_allclose([problem.plant.paths[0].delay, problem.delay], [0.01, 0.011])
    np.testing.assert_allclose(problem.surroundings.paths[0].actuator.num, [20 * 0.22])
    np.testing.assert_allclose([problem.sensor.lag, problem.surroundings.sensor.lag], [0.002, 0.0022])
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(problem.plant.A_m)), [-4, -3])
    assert problem.input_gain[0] == pytest.approx(1 / 1.1) and problem.input_gain[1] == pytest.approx(1 / 0.9)
    scale, x_m = problem.plant.scale, simulate(problem, [LAW], Simulation(t_end=1.0, dt=1e-3))["MRAC"].x_m
    np.testing.assert_allclose(scale, np.abs(x_m).max(axis=0), rtol=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"-k/J"', '"-K/J"', ["plant.A[1][0]", "K", "did you mean 'k'"]),
        ("parameters = { k = 1.6 }", "parameters = { K = 1.6 }", ["truth.parameters", "K", "the parameters are k, J"]),
        ("parameters = { k = 1.6 }", "parameter = { k = 1.6 }", ["truth.parameter", "did you mean"]),
        ("value = 1.3, between", "valeu = 1.3, between", ["parameters.k.valeu", "value"]),
        ("between = [0.9, 1.7]", "between = [1.7, 0.9]", ["parameters.k.between"]),
        (
            "[truth]",
            "[truth]\nA = [[0, 1, 0], [0, 0, 1], [0, 0, 0]]\nb = [0, 0, 1]",
            ["truth.states", "3 states", "the plant has 2"],
        ),
        (
            "[truth]",
            "[truth]\nfriction = [{ state = 'speed', coulomb = 1, width = 1 }]",
            ["friction.state", "speed", "angle, rate"],
        ),
        ("[truth]", "[truth]\nterms = { rate = 'x3' }", ["truth.terms.rate", "x3"]),
        ('b = [0, "1/J"]', "theta = [1, 2]\nb = [0, 1]", ["plant.theta", "parameters"]),
        ("A = [[0, 1]", "transfer_function = { num = [1], den = [1, 1] }\nA = [[0, 1]", ["state space"]),
        ("k = { value = 1.3,", "sin = { value = 1.3,", ["parameters", "sin"]),
        ("J = {", "m = { value = 1.0, tolerance = 0.5 }\nJ = {", ["parameters.m has a range", "no formula"]),
    ],
)
def test_bad_input_is_one_clear_sentence(old, new, words):
    assert old in CASE
    with pytest.raises(InputError) as caught:
        parse_case(CASE.replace(old, new, 1))
    assert all(word in str(caught.value) for word in words), caught.value


def test_ranges_of_delay_sensor_and_start_leave_guarantees_for_the_declared_values_alone():
    """Within its range the lag makes e exceed the bound for the whole set, which does not include a lag."""
    matched = CASE.replace('delay = "0.01*J/0.2"\nactuator = { num = ["20*J"], den = [1, "20*J"] }\n', "")
    matched = matched.replace("k = 1.6", "").replace("J = { value = 0.2, tolerance = 0.1 }", "J = 0.2\nT = VALUE")
    for lag, where, said in (
        ("{ value = 0.0, between = [0.0, 0.4] }", '[sensor]\nlag = "T"', "sensor.lag (0 to 0.4 at their corners)"),
        ("{ value = 0.0, between = [0.0, 0.4] }", '[plant.input]\ndelay = "T"', "plant.input.delay (0 to 0.4 at their corners)"),
        ("{ value = 0.0, between = [0.0, 2.0] }", "", "plant.x0"),
        ("0.0", '[sensor]\nlag = "T"', ""),
    ):
        text = matched.replace('[plant.input]\n[sensor]\nlag = "0.01*J"', where).replace("VALUE", lag)
        case = parse_case(text if where else text.replace("[plant]\n", '[plant]\nx0 = ["T", 0]\n'))
        (certificate,) = certify(case.problem, case.controllers, case.simulation).values()
        assert certificate.entry("error_bound").kind == ("guaranteed for the design" if said else "guaranteed")
        assert bool(case.problem.derived.around) == bool(said) and said in " ".join(case.problem.derived.sentences)
    slow = parse_case(
        matched.replace('lag = "0.01*J"', 'lag = "T"')
        .replace("VALUE", "{ value = 0.0, between = [0.0, 0.4] }")
        .replace("parameters = {  }", "parameters = { T = 0.4 }")
        .replace("t_end = 1.0", "t_end = 10.0")
    )
    bound = certify(slow.problem, slow.controllers, slow.simulation)["MRAC"].values["error_bound"]
    assert max(simulate(slow.problem, slow.controllers, slow.simulation)["MRAC"].figures["max_abs_e"]) > bound


def test_a_parameter_with_the_name_of_a_state_is_refused_where_a_term_uses_it():
    """x1 is the first state in a term, so the formula would be ambiguous."""
    both = CASE.replace("[plant]\n", "x1 = { value = 2.0 }\n[plant]\n", 1)
    parse_case(both)
    with pytest.raises(InputError, match=r"truth\.terms\.rate uses x1, which is a parameter and also the name of a state"):
        parse_case(both.replace("[truth]", "[truth]\nterms = { rate = '-x1**3' }"))


def test_documents_of_runs_and_certificates_name_the_differences():
    """The documents of a design without any guarantee of the motion name the differences too, and call no guarantee void."""
    case = load_case("flexible-joint")
    certified = certified_case(case.problem, case.controllers, case.simulation)
    of_certify, of_run = certified.as_json(), sets_and_truth(case.problem)
    assert of_run["truth"]["departures"] == of_certify["truth"]["departures"] and of_run["derived"] == of_certify["derived"]
    assert any("friction" in one["sentence"] for one in of_run["truth"]["departures"])
    (result,) = simulate(case.problem, case.controllers[:1], replace(case.simulation, t_end=0.1)).values()
    document = run_document(case.name, [result], None)
    assert document["truth"] == of_run["truth"]
    notes = [note for one in certified.certificates.values() for note in one.notes]
    assert any("([truth]) differs from the design" in note for note in notes) and not any("invalidates" in note for note in notes)


def test_a_remainder_is_judged_in_any_unit():
    """The second state of the plant is in units 10,000 times smaller, so the deviating entry of A is 1e-5."""
    rest = np.array([[0.0, 0.1], [0.0, 0.0]])
    for scale in (1.0, 1e4):
        T = np.diag([1.0, scale])
        A, A_model = (T @ one @ np.linalg.inv(T) for one in (A_m + rest, A_m))
        plant = Plant(A_m=A_model, b=T @ b, theta=[0.0, 0.0])
        model, reference = ReferenceModel(k_0=2.0), Sine(amplitude=1.0, frequency=1.5)
        problem = Problem(plant=plant, reference_model=model, reference=reference, truth=Truth(A=A, b=T @ b))
        assert any("A has an unmatched remainder" in one.sentence for one in departures(problem)), scale


@pytest.mark.parametrize(
    ("own", "true", "said"),
    [
        (PlantInput(delay=0.1), PlantInput(delay=0.1 * 1.1), "delay 0.11, not 0.1"),
        (PlantInput(saturation=(-1, 1)), PlantInput(saturation=(-0.1 * 3, 0.1 * 3)), "saturation [-0.3, 0.3], not [-1, 1]"),
        (PlantInput(rate_limit=2.0), PlantInput(rate_limit=2.0000001), "rate_limit 2.0000001, not 2.0"),
        (PlantInput(), PlantInput(quantization=1 / 3), "quantization 0.3333, not none"),
    ],
)
def test_another_input_path_is_told_in_the_digits_that_it_needs(own, true, said):
    problem = designed(truth=Truth(input=true))
    problem = replace(problem, plant=replace(problem.plant, input=own))
    assert f"the path before its input differs: {said}" in [one.sentence for one in departures(problem)]


def test_the_plant_s_theta_outside_the_known_set_is_said_with_a_truth_too():
    """With other states the truth has no theta, and with friction it has the plant's."""
    known = ParameterBox(lower=[-1.0, -1.0], upper=[0.5, 1.0])
    more = Truth(A=np.diag([-1.0, -1.0, -20.0]), b=[0.0, 0.0, 20.0], states=("angle", "rate", "motor"))
    friction = Truth(friction=[Friction(state="rate", coulomb=0.1, width=0.1)])
    for truth in (more, friction):
        said = designed(truth=truth, uncertainty=known).outside_known_set
        assert said is not None and said.startswith("the plant's theta [1.0, -0.5] lies outside the known set, between [-1.0")
        inside = ParameterBox(lower=[-1.0, -1.0], upper=[2.0, 1.0])
        assert designed(truth=truth, uncertainty=inside).outside_known_set is None
    problem = designed(truth=Truth(A=A_TRUE), uncertainty=ParameterBox(lower=[-1.0, -1.0], upper=[0.4, 1.0]))
    assert problem.outside_known_set is None and "outside the known set" in departures(problem)[0].sentence
