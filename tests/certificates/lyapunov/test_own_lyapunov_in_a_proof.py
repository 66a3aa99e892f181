"""Proofs for Lyapunov functions of authors: ``barbalat-check`` accepts them and rejects each false conclusion."""

from __future__ import annotations

import copy
import json
import re
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import pytest

import barbalat_check
from barbalat import ParameterBox, Plant, Problem, ReferenceModel, Simulation, certify
from barbalat.certificates.proof import proof
from barbalat.cli import main
from barbalat.interfaces import Lyapunov
from barbalat.plants import ParameterBall
from barbalat.regressors import Polynomial, Terms
from barbalat.signals import Sine
from certificates.lyapunov.own_laws import EXAMPLES, Own, State, a_problem, laws

SIMULATION = Simulation(t_end=8.0, dt=1e-3)
OF_V = {"lyapunov_decay", "error_bound", "estimates_error_bound", "error_limit"}
OVER_THE_SET = {"error_bound_worst", "error_bound_command"}
COMPOSITE, LEARNING, TUNER = "composite", "concurrent learning", "high-order tuner"


def document_of(problem, controllers):
    certificates = certify(problem, controllers, SIMULATION)
    return json.loads(json.dumps(proof("own", problem, controllers, SIMULATION, certificates), allow_nan=False))


def accepted(document):
    """The claims that the checker accepts, by controller."""
    barbalat_check.check(document)
    return {name: {line["key"] for line in one["lines"] if line["claimed"]} for name, one in document["controllers"].items()}


def test_three_laws_from_outside_are_accepted_from_the_command_line(tmp_path, capsys):
    file = tmp_path / "paper.json"
    assert main(["certify", "paper", "--controllers", str(EXAMPLES), "--proof", str(file)]) == 0
    capsys.readouterr()
    assert barbalat_check.main([str(file)]) == 0
    said = capsys.readouterr().out
    for law in laws.CONTROLLERS:
        (line,) = [one for one in said.splitlines() if one.startswith(f"{law.name}: accepted")]
        assert {one.split(" = ")[0] for one in re.split("[:,] ", line)[2:]} == OF_V | OVER_THE_SET
    assert "assumed, and not derived from numbers: the polynomials of the law" in said


def test_random_problems_are_accepted(sample):
    rng = np.random.default_rng(20)
    for _ in range(sample(3, 20)):
        problem = a_problem(rng, int(rng.integers(1, 4)), projected=bool(rng.random() < 0.7))
        if problem.uncertainty is not None and rng.random() < 0.4:
            center = np.zeros(len(problem.plant.theta))
            problem = replace(problem, uncertainty=ParameterBall(center=center, radius=2.0))
        wanted = OF_V | (OVER_THE_SET if problem.uncertainty is not None else set())
        found = accepted(document_of(problem, laws.CONTROLLERS))
        assert all(found[law.name] == wanted for law in laws.CONTROLLERS)


@pytest.mark.parametrize(
    "regressor", [Polynomial(degree=2), Terms(terms=("x1", "sin(x2)", "x1*exp(-x2)"))], ids=["powers", "terms"]
)
@pytest.mark.dear
def test_the_proof_holds_for_every_regressor(regressor):
    problem = a_problem(np.random.default_rng(10), projected=False)
    theta = np.full(regressor.size(2), 0.2)
    problem = replace(problem, plant=replace(problem.plant, theta=theta, regressor=regressor), uncertainty=None)
    document = document_of(problem, laws.CONTROLLERS)
    assert all(keys == OF_V for keys in accepted(document).values())
    other = copy.deepcopy(document)
    other["plant"]["regressor"] = {"kind": "gaussian"}
    assert accepted(other)


@dataclass(frozen=True, eq=False)
class PairedEquations:
    known: object

    def initial(self):
        return State(np.full(self.known.parameters, 0.25))

    def control(self, state, x, x_m, r):
        return np.dot(self.known.k_0, r) - self.known.matched.phi(x).T @ state.theta_hat

    def derivative(self, state, x, x_m, r, u):
        return State(4.0 * self.known.matched.phi(x) @ ((x - x_m) @ self.known.P @ self.known.b))

    def limit(self, state):
        return state

    def lyapunov(self, state, x, x_m, theta):
        e, off = x - x_m, state.theta_hat - theta
        return Lyapunov(V=e @ self.known.P @ e + off @ off / 4.0)


@dataclass(frozen=True)
class Paired:
    """MRAC for several inputs."""

    name: str = "paired"

    def bind(self, known):
        return PairedEquations(known)


@pytest.mark.parametrize("regressor", [None, Terms(terms=("x1*x2", "cos(x1)", "x2"))], ids=["x", "terms"])
def test_two_inputs(regressor):
    rng = np.random.default_rng(21)
    theta = rng.normal(size=(2 if regressor is None else 3, 2))
    own = {} if regressor is None else {"regressor": regressor}
    plant = Plant(A_m=[[-1.0, 1.0], [0.0, -2.0]], b=[[1.0, 0.5], [0.0, 1.0]], theta=theta, x0=[1.0, -1.0], **own)
    commands = (Sine(amplitude=1.0, frequency=1.0), Sine(amplitude=2.0, frequency=0.5))
    problem = Problem(plant=plant, reference_model=ReferenceModel(k_0=np.eye(2)), reference=commands)
    document = document_of(problem, [Paired()])
    assert accepted(document)["paired"] == OF_V
    document["plant"]["b"][1][1] = 1.5
    with pytest.raises(barbalat_check.Refused, match="add up"):
        barbalat_check.check(document)


def over_cells():
    """V is guaranteed to fall only for theta in the known set, so this law, with phi(x_m), needs one; the proof uses cells."""
    rng = np.random.default_rng(7)
    problem = a_problem(rng, size=0.3)
    known = ParameterBox(lower=[-0.02] * 2, upper=[0.02] * 2)
    problem = replace(problem, plant=replace(problem.plant, theta=[0.01] * 2), uncertainty=known)
    return document_of(problem, [Own(regressor="x_m", projects=True, claimed=0.0)])


def test_a_proof_over_the_known_set():
    document = over_cells()
    assert {"lyapunov_decay", "error_bound"} <= accepted(document)["own"]
    (line,) = [one for one in document["controllers"]["own"]["lines"] if one["key"] == "lyapunov_decay"]
    leaf = line["witness"]["decay"]["cells"]
    assert "squares" in leaf and line["value"] == "-V' is a sum of squares over the known set"
    for wrong, reason in (
        (leaf | {"squares": leaf["squares"][:-1]}, "can't be read"),
        ({"side": 0, "at": "5p0", "low": leaf, "high": leaf}, "must be cut between its ends"),
        ({"side": 0, "at": "0p0", "low": leaf, "high": leaf}, "add up"),
    ):
        line["witness"]["decay"]["cells"] = wrong
        with pytest.raises(barbalat_check.Refused, match=reason):
            barbalat_check.check(document)
    document = over_cells()
    document["plant"]["uncertainty"]["upper"] = [3.0, 3.0]
    with pytest.raises(barbalat_check.Refused, match="add up"):
        barbalat_check.check(document)


def value_of(terms, at):
    total = Fraction(0)
    for monomial, factor in terms.items():
        one = Fraction(factor)
        for part in monomial.split() if monomial != "1" else ():
            name, _, power = part.partition("^")
            one *= at[name] ** int(power or 1)
        total += one
    return total


@pytest.mark.parametrize("law", laws.CONTROLLERS, ids=lambda law: law.name)
def test_the_file_has_the_polynomials_of_the_law(law):
    """The rates and u of the file equal those of the law's lines at a random state."""
    problem, rng = a_problem(np.random.default_rng(22), projected=False), np.random.default_rng(23)
    facts = document_of(problem, [law])["controllers"][law.name]["facts"]["law"]
    equations = law.bind(problem.known)
    x, x_m, r = rng.normal(size=2), rng.normal(size=2), rng.normal()
    shaped = type(equations.initial())(*(rng.normal(size=np.shape(part)) for part in equations.initial()))
    flat = np.concatenate([np.ravel(part) for part in shaped])
    assert len(facts["state"]) == len(flat)
    values = {"r_1": r} | dict(zip(facts["state"], flat.tolist(), strict=True))
    values |= {f"{name}_{i + 1}": one for name, part in (("x", x), ("e", x - x_m)) for i, one in enumerate(part.tolist())}
    at = {name: Fraction(value) for name, value in values.items()}
    u = equations.control(shaped, x, x_m, r)
    rates = np.concatenate([np.ravel(part) for part in equations.derivative(shaped, x, x_m, r, u)])
    written = [*facts["rates"].values(), *facts["control"]]
    found = [float(value_of(one["above"], at) / value_of(one.get("below", {"1": "1"}), at)) for one in written]
    assert found == pytest.approx([*rates, u], rel=1e-9, abs=1e-9)


@pytest.fixture(scope="module")
def whole():
    document = document_of(a_problem(np.random.default_rng(3)), laws.CONTROLLERS)
    assert all(keys == OF_V | OVER_THE_SET for keys in accepted(document).values())
    return document


def line_of(document, name, key):
    (line,) = [one for one in document["controllers"][name]["lines"] if one["key"] == key]
    return line


def times(terms, monomial, factor):
    terms[monomial] = str(Fraction(terms[monomial]) * Fraction(factor))


def tightened(name, key, factor=1 - 1e-9):
    def change(document):
        line_of(document, name, key)["value"] *= factor

    return change


def of_line(name, key, change):
    return lambda document: change(line_of(document, name, key))


def of_facts(name, change):
    return lambda document: change(document["controllers"][name]["facts"])


def of_plant(**changes):
    return lambda document: document["plant"].update(changes)


def without(name, key):
    def change(document):
        found = document["controllers"][name]
        found["lines"] = [one for one in found["lines"] if one["key"] != key]

    return change


def indefinite(line):
    """The squares still add up, but one of them has a negative weight."""
    witness = line["witness"]["decay"]
    size = len(witness["basis"])
    witness["basis"] += [{"e_1": "1"}, {"e_1": "1"}]
    witness["G"] = [[*row, "0", "0"] for row in witness["G"]] + [["0"] * size + ["1", "0"], ["0"] * size + ["0", "-1"]]


def escaping(facts):
    facts["law"]["state"]["q"] = "0"
    facts["law"]["rates"]["q"] = {"above": {"q^2": "1"}}


def growing_with_the_projection(facts):
    facts["law"]["state"]["q"] = "1"
    facts["law"]["rates"]["q"] = {"above": {"q n_1": "1"}}


def unprojected(facts):
    law = facts["law"]
    law["normals"] = []
    for rate in law["rates"].values():
        for monomial in [one for one in rate["above"] if "n_" in one]:
            del rate["above"][monomial]


def hidden(name):
    return lambda facts: facts["law"]["rates"]["theta_hat_1"]["above"].update({name: "1"})


def growing_u(facts):
    """V' <= -W still holds, because q stays zero; but u is not shown to be bounded, since zeta is not."""
    facts["law"]["state"]["q"] = "0"
    facts["law"]["rates"]["q"] = {"above": {"q": "-1"}}
    facts["law"]["functions"]["sin_1"] = ["zeta"]
    facts["law"]["control"][0]["above"]["q sin_1"] = "1"
    facts["zero"].append({"q": "1"})


def of_state(part, value):
    return lambda facts: facts["law"]["state"].update({part: value})


def of_rate(part, monomial, factor):
    return lambda facts: times(facts["law"]["rates"][part]["above"], monomial, factor)


FALSE = {
    "a tightened bound": (tightened(COMPOSITE, "error_bound"), "the bound of .e. must be at least"),
    "a tightened bound over the set": (tightened(TUNER, "error_bound_worst"), "the bound of .e_i. must be at least"),
    "a tightened bound for the command": (tightened(LEARNING, "error_bound_command"), "the bound of .e_i. must be at least"),
    "a tightened bound of estimates": (tightened(TUNER, "estimates_error_bound"), "the bound of the estimates must be"),
    "a negative limit": (of_line(TUNER, "error_limit", lambda line: line.update(value=-1e-9)), "the limit of .e. must be"),
    "another sentence": (
        of_line(TUNER, "lyapunov_decay", lambda line: line.update(value="V' = -W identically")), "it is shown that -V'",
    ),
    "a changed coefficient of the law": (of_facts(TUNER, of_rate("ahead_1", "e_1 x_1", "1.01")), "do not add up"),
    "the law with the opposite sign": (of_facts(TUNER, of_rate("ahead_2", "e_1 x_2", "-1")), "do not add up"),
    "a slower filter": (of_facts(TUNER, of_rate("theta_hat_1", "x_1^2 ahead_1", "1/2")), "do not add up"),
    "a changed coefficient of W": (of_facts(COMPOSITE, lambda facts: times(facts["V"]["W"], "e_1^2", "1.01")), "do not add up"),
    "a negative W": (of_facts(COMPOSITE, lambda facts: times(facts["V"]["W"], "e_1^2", "-1")), "do not add up"),
    "squares that do not add up": (
        of_line(TUNER, "lyapunov_decay", lambda line: line["witness"]["decay"]["G"][0].__setitem__(0, "100")), "do not add up",
    ),
    "an indefinite matrix": (of_line(TUNER, "lyapunov_decay", indefinite), "must be positive semidefinite"),
    "another share of W": (
        of_line(COMPOSITE, "lyapunov_decay", lambda line: line["witness"]["decay"].update(share="2")), "the share of W is 1",
    ),
    "V' = -W where it is not": (
        of_line(TUNER, "lyapunov_decay", lambda line: line["witness"].update(decay=None)), "V' must be -W identically",
    ),
    "a V that is not positive definite": (
        of_facts(TUNER, lambda facts: facts["V"]["M"][2].__setitem__(2, "-1/10")), "V must be positive definite",
    ),
    "a V that is zero elsewhere": (
        of_facts(COMPOSITE, lambda facts: facts["V"]["L"][0].__setitem__(0, "2")), "the projection must lower V",
    ),
    "V with another P": (of_facts(TUNER, lambda facts: facts["V"]["M"][0].__setitem__(0, "100")), "do not add up"),
    "a smaller known set": (of_plant(uncertainty={"lower": [-1e-3] * 2, "upper": [1e-3] * 2}), "theta must lie in the known set"),
    "a larger known set": (of_plant(uncertainty={"lower": [-2.0] * 2, "upper": [2.0] * 2}), "the bound of .e_i. must be"),
    "no known set": (of_plant(uncertainty=None), "theta must lie in the known set"),
    "estimates that start outside": (of_facts(COMPOSITE, of_state("theta_hat_1", "5")), r"theta_hat\(0\) must lie in the set"),
    "a filter that starts elsewhere": (of_facts(COMPOSITE, of_state("zeta", "100")), "is not zero at t = 0"),
    "a filter of another time constant": (of_facts(COMPOSITE, of_rate("phi_f_1", "x_1", "1.01")), "must vanish with these"),
    "a relation that is not the law's": (
        of_facts(COMPOSITE, lambda facts: times(facts["zero"][0], "theta_1 phi_f_1", "2")), "must vanish with these",
    ),
    "a memory that starts elsewhere": (of_facts(LEARNING, of_state("R_1", "-1")), "is not zero at t = 0"),
    "a memory that is not symmetric": (
        of_facts(LEARNING, lambda facts: facts["nonnegative"][0].update(R=[["R_1", "Q_1"], ["R_3", "R_4"]])),
        "R must stay symmetric",
    ),
    "a memory that no witness keeps": (
        of_line(LEARNING, "lyapunov_decay", lambda line: line["witness"]["nonnegative"][0].update(basis=[])), "do not add up",
    ),
    "a law with a hidden variable": (of_facts(LEARNING, hidden("v_1")), "must not depend on theta or on the variables"),
    "a law that knows theta": (of_facts(COMPOSITE, hidden("theta_1")), "must not depend on theta"),
    "estimates that are only kept inside": (of_facts(COMPOSITE, unprojected), "must be projected"),
    "a state that escapes": (of_facts(TUNER, escaping), "may escape in finite time"),
    "a state that grows with the projection": (of_facts(COMPOSITE, growing_with_the_projection), "may escape in finite time"),
    "a denominator with a root": (
        of_facts(LEARNING, lambda facts: facts["law"]["rates"]["R_1"]["below"].update({"1": "-1"})), "a denominator must be",
    ),
    "two variables of one name": (
        of_facts(LEARNING, lambda facts: facts["nonnegative"][0].update(v=["F_1", "F_2"])), "needs a name of its own",
    ),
    "no estimates": (of_facts(TUNER, lambda facts: facts["law"].update(estimates=[])), "V must contain estimates"),
    "no share of |e|^2": (
        of_line(TUNER, "error_limit", lambda line: line["witness"].update(share="0")), r"the share of \|e\|\^2 must be positive",
    ),
    "a u that may grow": (of_facts(COMPOSITE, growing_u), "u must depend only on"),
    "no decay": (without(COMPOSITE, "lyapunov_decay"), "needs an earlier line on lyapunov_decay"),
    "a model that is not shown to be stable": (without(LEARNING, "lyapunov"), "needs an earlier line on lyapunov"),
    "another model": (lambda document: document["plant"]["A_m"][0].__setitem__(0, 1.0), "do not add up"),
    "another b": (lambda document: document["plant"]["b"][0].__setitem__(0, 3.0), "do not add up|must vanish"),
    "another k_0": (lambda document: document["plant"]["k_0"][0].__setitem__(0, 2.0), "do not add up|must vanish"),
    "another theta": (of_plant(theta=[1.0, -1.0]), "must be at least"),
    "another gain of the input": (of_plant(gain=[1.5]), "its input has a gain other than 1"),
    "an unknown gain": (of_plant(input_gain={"lower": [0.5], "upper": [2.0]}), "the input's gain must be known"),
    "a delay": (lambda document: document["plant"]["inputs"][0].update(delay=0.1), "its input has a delay"),
    "a limit": (lambda document: document["plant"]["inputs"][0].update(saturation=[-9.0, 9.0]), "its input has saturation"),
    "a disturbance": (of_plant(disturbance={"kind": "constant", "amplitudes": [1.0]}), "the case has: disturbance"),
    "a baseline": (of_plant(baseline={"theta_0": [0.0, 0.0], "enters": [[0.0], [0.0]]}), "there is no baseline"),
    "an unbounded command": (of_plant(reference=[{"kind": "unbounded", "name": "r"}]), "the command has no bound"),
    "a sampled law": (of_facts(TUNER, lambda facts: facts.update(sample_time=0.01)), "must act continuously"),
}  # fmt: skip


@pytest.mark.parametrize("what", FALSE)
def test_a_false_conclusion_is_refused(whole, what):
    change, reason = FALSE[what]
    document = copy.deepcopy(whole)
    change(document)
    with pytest.raises(barbalat_check.Refused, match=reason):
        barbalat_check.check(document)


@pytest.mark.parametrize("rate", [{"sin_1": "1"}, {"q": "1", "x_1": "1", "sin_1 q": "1"}], ids=["driven", "coupled"])
def test_functions_of_a_state_outside_V(whole, rate):
    """A rate that is linear in q is accepted if its factors depend on x only; a function of q itself is not."""
    document = copy.deepcopy(whole)
    law = document["controllers"][TUNER]["facts"]["law"]
    law["state"]["q"], law["rates"]["q"], law["functions"]["sin_1"] = "1", {"above": rate}, ["x_1"]
    assert accepted(document)
    law["functions"]["sin_1"] = ["q"]
    with pytest.raises(barbalat_check.Refused, match="may escape in finite time"):
        barbalat_check.check(document)


def test_a_matrix_stays_nonnegative_only_if_it_starts_so(whole):
    document = copy.deepcopy(whole)
    facts = document["controllers"][TUNER]["facts"]
    facts["law"]["state"]["q"], facts["law"]["rates"]["q"] = "1/3", {"above": {"q": "-1"}}
    facts["nonnegative"] = [{"R": [["q"]], "v": ["v"], "F": [["F"]]}]
    line_of(document, TUNER, "lyapunov_decay")["witness"]["nonnegative"] = [{"basis": [], "G": []}]
    assert accepted(document)
    facts["law"]["state"]["q"] = "-1/3"
    with pytest.raises(barbalat_check.Refused, match="R must be positive semidefinite at t = 0"):
        barbalat_check.check(document)


def test_what_is_weaker_follows_too(whole):
    document = copy.deepcopy(whole)
    theta = document["plant"]["theta"]
    document["plant"]["uncertainty"] = {"lower": [min(-0.001, one) for one in theta], "upper": [max(0.001, one) for one in theta]}
    for key in ("error_bound", "error_limit"):
        line_of(document, TUNER, key)["value"] += 1.0
    assert accepted(document)
