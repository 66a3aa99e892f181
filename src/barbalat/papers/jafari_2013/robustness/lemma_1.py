"""Lemma 1 along runs of the adaptive law (15), with and without a modelling error eta.

With V = theta_tilde'P^-1 theta_tilde, (13) and (15) give V' = -(epsilon m_s)^2 + eta^2/m_s^2 between the projection's bounds, and
at most this at the bounds. Therefore the integral of (epsilon m_s)^2 from 0 is at most V(0) plus the integral of eta^2/m_s^2. The
constant of S(eta^2/m_s^2) is at most max(1, V(0)) for intervals that begin at 0 and max(1, V(t)) for those that begin at t. Pure
least squares does not bound V(t) under a lasting error. The constants are therefore measured, and ``scalar_lemma`` shows that
none is sufficient for all signals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from barbalat.adaptation.law import Estimation, Normalization
from barbalat.adaptation.laws import LeastSquares
from barbalat.controllers import RobustMrac
from barbalat.controllers.robust_mrac import Equations as RobustEquations
from barbalat.linear.systems import TransferFunction
from barbalat.papers.claim import Claim, Listing, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.robustness import scalar_lemma
from barbalat.papers.jafari_2013.section_v import variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED
from barbalat.problem.actuation import PlantInput
from barbalat.problem.state_feedback import Known, Problem
from barbalat.protocols import Value
from barbalat.roles import Role, roles_of
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

MUS = (0.0, 0.005, 0.02, 0.1)
"""Values of mu in Delta_m = -mu s/(0.001 s + 1): zero, and three values that the loop tolerates with tau = 0.5 s."""
LARGEST_GROWTH = 1.05
"""Largest admissible growth of a supremum from the first half of a run to the second."""
METHOD = f"robust MRAC of Figure 2, {MENDED}, with {{}}, RK4, h = 1e-4 s, 60 s; {{}}"


def claims() -> list[Claim]:
    """Measure all rows of this group."""
    runs = {mu: _run(mu) for mu in MUS}
    return [bounded(runs), without_error(runs[0.0]), with_error(runs)]


def bounded(runs: dict[float, Along]) -> Claim:
    """Test part (i). A finite run can only show that the suprema are reached early."""
    names = ("epsilon", "error", "theta_hat", "rate")
    halves = {name: np.array([_half_suprema(getattr(run, name)) for run in runs.values()]) for name in names}
    growth = {name: float((v[:, 1] / v[:, 0]).max()) for name, v in halves.items()}
    grown = max(growth.values())
    bounded = all(bool((np.isfinite(v).all(axis=1) & (v[:, 1] <= LARGEST_GROWTH * v[:, 0])).all()) for v in halves.values())
    sentence = SENTENCES["lemma-1-bounded"]
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(bounded, f"in the second half of a run the suprema are at most {grown:.3g} times those of the "
        f"first"),),
        shows=f"Along runs with mu up to {max(runs):g} s the suprema of the second half are at most {grown:.2f} times those of "
        f"the first.",
        measured=        f"for mu up to {max(runs):g} s the largest values are {halves['epsilon'].max():.3g} (|epsilon|), "
            f"{halves['error'].max():.3g} (|epsilon m_s|), {halves['theta_hat'].max():.3g} (|theta_hat_i|) and "
            f"{halves['rate'].max():.3g} (|theta_hat'|). In the second half of a run the supremum of theta_hat is at most "
            f"{growth['theta_hat']:.3g} times that of the first half, and those of the others at most "
            f"{max(value for name, value in growth.items() if name != 'theta_hat'):.2g} times",
        how=METHOD.format("Delta_m = -mu s/(0.001 s + 1)", "evaluated at 3000 instants; the reading is that no supremum "
            "grows in the second half"),
        listings=(_suprema(tuple(runs), halves),),
        would_change="a supremum that keeps growing along a run; a finite run can show no more than that",
    )  # fmt: skip


def without_error(run: Along) -> Claim:
    """Test part (ii) for eta = 0, where V decreases by exactly the integral."""
    V, spent = run.V, run.integrals["error"]
    gap = np.abs(V + spent - V[0]).max() / V[0]
    late = {name: 1 - part[3 * len(part) // 4] / part[-1] for name, part in run.integrals.items() if name != "eta"}
    falls = bool((np.diff(V) <= 1e-12 * V[0]).all() and spent[-1] <= V[0] and max(late.values()) < 0.01)
    sentence = SENTENCES["lemma-1-no-error"]
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(falls, f"V goes from {V[0]:.3g} to {V[-1]:.2g}, and the integral of (epsilon m_s)^2 is "
            f"{spent[-1]:.4g}. The last quarter adds at most a fraction {max(late.values()):.0e} of each integral"),),
        shows=f"V falls from {V[0]:.3g} to {V[-1]:.1g}; the integral of (epsilon m_s)^2 equals the decrease of V to within "
        f"{gap:.0e}.",
        measured=        f"V falls from {V[0]:.3g} to {V[-1]:.2g} and never rises. The sum of V and the integral of (epsilon "
            f"m_s)^2 equals V(0) to within a fraction of {gap:.0e}. The integrals of epsilon^2, (epsilon m_s)^2 and "
            f"|theta_hat'|^2 reach {run.integrals['epsilon'][-1]:.3g}, {spent[-1]:.4g} and {run.integrals['rate'][-1]:.3g}; the "
            f"last quarter adds at most a fraction {max(late.values()):.0e} of each",
        how=METHOD.format("Delta_m = 0", "the integrals are computed with the loop, and V at 3000 instants"),
        listings=(
            table(
                "Integrals over the run, and the fraction that its last quarter contributes",
                {
                    "of": ("epsilon^2", "(epsilon m_s)^2", "|theta_hat'|^2"),
                    "at the end": [run.integrals[name][-1] for name in ("epsilon", "error", "rate")],
                    "fraction from the last quarter": [late[name] for name in ("epsilon", "error", "rate")],
                },
            ),
        ),
        would_change="a V that rises without modelling error, or integrals that keep growing",
    )  # fmt: skip


def with_error(runs: dict[float, Along]) -> Claim:
    """Test part (ii) for a nonzero eta, by the constants of S(eta^2/m_s^2)."""
    mus = np.array([mu for mu in runs if mu])
    some = [runs[mu] for mu in mus]
    constants = {name: np.array([run.constant(name) for run in some]) for name in ("epsilon", "error", "rate")}
    gap = max(float(np.abs(run.V + run.integrals["error"] - run.integrals["eta"] - run.V[0]).max() / run.V[0]) for run in some)
    by_definition = {name: np.array([run.constant_of_largest(name) for run in some]) for name in constants}
    eta = np.array([np.abs(run.eta).max() for run in some])
    risen = np.array([run.V.max() / run.V[0] for run in some])
    taught, left = scalar_lemma.readings()
    readings = (
        taught,
        _along_runs("along Section V's runs with these sizes of mu, with a separate nu for each", by_definition),
        _along_runs("along these runs, with the integral of eta^2/m_s^2 over the same interval", constants),
        left,
    )
    return Claim(
        sentence=SENTENCES["lemma-1-small"],
        readings=readings,
        shows=f"The smallest nu for epsilon m_s is {by_definition['error'].max():.2g} along the runs; for any signals it "
        f"reaches {scalar_lemma.constants(scalar_lemma.ScalarLeastSquares()).max():.0f} with (15) and "
        f"{scalar_lemma.constants(scalar_lemma.ScalarGradient()).max():.2g} with the gradient law.",
        measured=        f"for mu = {span(mus)} s, |eta|/m_s up to {eta.max():.3g}: by the paper's definition "
        f"{_at_most(by_definition)}; with the integral "
        f"of eta^2/m_s^2 {_at_most(constants)}. Since V' = -(epsilon m_s)^2 + eta^2/m_s^2, the constants with the integral are "
        f"at most max(1, V) = 1, and for theta_hat' at most |P(0)|^2 = {section_v.COVARIANCE0**2:g}. Along the runs this "
        f"equation is satisfied to within {gap:.0e} V(0). V is not monotone: it rises to as much as {risen.max():.3g} V(0). The "
        f"readings show what holds for any signals",
        how=METHOD.format(
            "Delta_m = -mu s/(0.001 s + 1), alpha_0 = 1",
            "for every pair t, t + T of 3000 instants, nu is the smallest number for which the integral over [t, t + T] is at "
            "most nu (mu T + 1), or at most nu (the integral of eta^2/m_s^2 + 1)",
        )
        + "; for arbitrary signals: one parameter, piecewise constant phi and eta, closed form",
        listings=(
            _constants("with the paper's constant mu, the largest eta^2/m_s^2 of the run", mus, by_definition),
            _constants("with the integral of eta^2/m_s^2 over the same interval", mus, constants),
            table(
                "The modelling error along the runs, and the rise of V",
                {"mu [s]": mus, "largest |eta|/m_s": eta, "largest V/V(0)": risen},
            ),
            *scalar_lemma.listings(),
        ),
        would_change="a law whose gain is kept away from zero, such as the gradient law, with which both readings hold for any "
        "signals",
    )  # fmt: skip


def _along_runs(what: str, constants: dict[str, Array]) -> Reading:
    """Return the reading that the constants are at most the bounds that follow from V'. Every run has some
    constants; the question is their size."""
    bounds = {"epsilon": 1.0, "error": 1.0, "rate": section_v.COVARIANCE0**2}
    return Reading(
        what, all(bool((constants[name] <= bound).all()) for name, bound in bounds.items()), _at_most(constants), "beside"
    )


def _suprema(mus: tuple[float, ...], halves: dict[str, Array]) -> Listing:
    """Return the suprema over each half of each run."""
    return table(
        "The suprema along a run with Delta_m = -mu s/(0.001 s + 1), in its first and in its second half",
        {
            "mu [s]": np.repeat(mus, 2),
            "half": ["first", "second"] * len(mus),
            "|epsilon|": halves["epsilon"].ravel(),
            "|epsilon m_s|": halves["error"].ravel(),
            "|theta_hat_i|": halves["theta_hat"].ravel(),
            "|theta_hat'|": halves["rate"].ravel(),
        },
    )


def _constants(measure: str, mus: Array, found: dict[str, Array]) -> Listing:
    columns = {"nu for epsilon": found["epsilon"], "nu for epsilon m_s": found["error"], "nu for theta_hat'": found["rate"]}
    return table(f"The smallest nu along the runs, {measure}", {"mu [s]": mus, **columns})


def _at_most(found: dict[str, Array]) -> str:
    largest = {name: f"{values.max():.3g}" for name, values in found.items()}
    return (
        f"the smallest nu is at most {largest['epsilon']} for epsilon, {largest['error']} for epsilon m_s, "
        f"{largest['rate']} for theta_hat'"
    )


def _half_suprema(values: Array) -> tuple[float, float]:
    """Return the largest magnitude in the first and in the second half."""
    half = len(values) // 2
    return float(np.abs(values[:half]).max()), float(np.abs(values[half:]).max())


def _run(mu: float) -> Along:
    """Run Section V with the robust MRAC of Figure 2, with the dynamic normalising signal if the plant has a modelling error."""
    dynamics = TransferFunction([-mu, 0.0], [1e-3, 1.0])
    scheme = RobustMrac(
        c_0=section_v.C_0,
        tau=section_v.TAU,
        law=LeastSquares(covariance0=section_v.COVARIANCE0),
        normalization=Normalization(alpha_0=1.0 if mu else 0.0),
    )
    problem = variant(input=PlantInput(multiplicative=dynamics)) if mu else section_v.problem()
    return along(problem, scheme, Simulation(t_end=section_v.T_END, dt=1e-4, record_points=3000))


ROWS = (
    Measurement(
        claims,
        2.5,
        {
            "lemma-1-bounded": "what Lemma 1 (i) bounds",
            "lemma-1-no-error": "Lemma 1 (ii) without modelling error",
            "lemma-1-small": "Lemma 1 (ii) with a modelling error",
        },
        place=250,
    ),
)


class LemmaState(NamedTuple):
    """The scheme's own state, and integrals along the run."""

    scheme: Any
    eta: Value  # of eta^2/m_s^2
    error: Value  # of (epsilon m_s)^2
    epsilon: Value  # of epsilon^2
    rate: Value  # of |theta_hat'|^2

    @property
    def theta_hat(self) -> Value:
        return self.scheme.theta_hat


@dataclass(frozen=True, eq=False)
class LemmaEquations:
    """The robust MRAC's equations and the integrals of Lemma 1. theta, which no controller knows, enters only the integrals."""

    scheme: RobustEquations
    theta: Array

    @property
    def roles(self) -> dict[str, Role]:
        return {f"scheme.{path}": role for path, role in roles_of(self.scheme).items()}

    def initial(self) -> LemmaState:
        return LemmaState(self.scheme.initial(), *(np.zeros(()) for _ in range(4)))

    def control(self, state: LemmaState, x: Value, x_m: Value, r: Value) -> Value:
        return self.scheme.control(state.scheme, x, x_m, r)

    def eta(self, state: LemmaState, x: Value) -> Value:
        phi, m_s_squared, epsilon = self.scheme.estimation(state.scheme, x)
        return epsilon * m_s_squared + (state.theta_hat - self.theta) @ phi  # (13): z - theta'phi

    def derivative(self, state: LemmaState, x: Value, x_m: Value, r: Value, u: Value) -> LemmaState:
        rates = self.scheme.derivative(state.scheme, x, x_m, r, u)
        _, m_s_squared, epsilon = self.scheme.estimation(state.scheme, x)
        return LemmaState(
            scheme=rates,
            eta=self.eta(state, x) ** 2 / m_s_squared,
            error=epsilon * epsilon * m_s_squared,
            epsilon=epsilon * epsilon,
            rate=rates.theta_hat @ rates.theta_hat,
        )

    def limit(self, state: LemmaState) -> LemmaState:
        return state._replace(scheme=self.scheme.limit(state.scheme))


@dataclass(frozen=True, eq=False)
class Observed:
    """A robust MRAC with Lemma 1's integrals."""

    scheme: RobustMrac
    theta: Array
    name: str = "observed"

    def bind(self, known: Known) -> LemmaEquations:
        bound = self.scheme.bind(known)
        assert isinstance(bound, RobustEquations)  # Section V has one input
        return LemmaEquations(bound, self.theta)


@dataclass(frozen=True, eq=False)
class Along:
    """The quantities of Lemma 1 at K instants of a run, (K, ...). The integrals start at 0."""

    t: Array
    epsilon: Array
    error: Array  # epsilon m_s
    rate: Array  # |theta_hat'|
    theta_hat: Array
    eta: Array  # over m_s
    V: Array
    integrals: dict[str, Array]

    def constant(self, name: str) -> float:
        """Return the smallest nu for which, for all pairs of instants, the integral over [t, t + T] is at most
        nu (integral of eta^2/m_s^2 over [t, t + T] + 1)."""
        return self._least(name, self.integrals["eta"])

    def constant_of_largest(self, name: str) -> float:
        """Return the smallest nu of the paper's definition, for which the integral over [t, t + T] is at most nu (mu T + 1) with
        mu the largest eta^2/m_s^2."""
        return self._least(name, (self.eta**2).max() * self.t)

    def _least(self, name: str, allowed: Array) -> float:
        part = self.integrals[name]
        return max(float(((part[i:] - part[i]) / (allowed[i:] - allowed[i] + 1)).max()) for i in range(len(part)))


def along(problem: Problem, controller: RobustMrac, simulation: Simulation) -> Along:
    """Simulate a run and evaluate the quantities at the recorded instants."""
    (run,) = simulate(problem, [Observed(controller, problem.plant.theta)], simulation).values()
    equations, loop = controller.bind(problem.known), run.loop
    rows = [loop.unpack(flat) for flat in run.states]
    states = [row.controller for row in rows]
    found = [equations.estimation(state.scheme, row.x) for state, row in zip(states, rows, strict=True)]
    phi, m_s_squared, epsilon = (np.array([getattr(f, name) for f in found]) for name in Estimation._fields)
    covariance, theta_tilde = np.array([s.scheme.memory.covariance for s in states]), run.theta_hat - problem.plant.theta
    pairs = zip((state.scheme for state in states), found, strict=True)
    rates = [equations.law.rates(scheme.theta_hat, scheme.memory, f, equations.estimate_set).theta_hat for scheme, f in pairs]
    m_s = np.sqrt(m_s_squared)
    return Along(
        t=run.t,
        epsilon=epsilon,
        error=epsilon * m_s,
        theta_hat=run.theta_hat,
        rate=np.linalg.norm(rates, axis=1),
        eta=(epsilon * m_s_squared + (theta_tilde * phi).sum(axis=1)) / m_s,
        V=(theta_tilde * np.linalg.solve(covariance, theta_tilde[..., None])[..., 0]).sum(axis=1),
        integrals={name: np.array([getattr(s, name) for s in states]) for name in ("eta", "error", "epsilon", "rate")},
    )
