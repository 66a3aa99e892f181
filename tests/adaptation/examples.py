"""Every law of the registry with every modification that it accepts, and random situations for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from barbalat import ParameterBox
from barbalat.adaptation.laws import LAWS, Estimation, integral_cost, least_squares
from barbalat.laws import DeadZone, EpsilonModification, FixedSigma, SwitchingSigma
from barbalat.plants import ParameterBall
from barbalat.problem.known_set import Gain

BOUND = 40.0
"""Bound on the covariance, in the Frobenius norm."""
RHO_0, RHO_1 = 20.0, 0.5
"""The eigenvalues of the covariance with resets are between these."""
M_0 = 6.0
"""M_0, which exceeds |theta| in every situation."""
G_0 = 0.05

MATRIX = np.array([[3.0, 1.0, 0.5], [1.0, 2.0, -0.4], [0.5, -0.4, 1.0]])


SIGMA, NU = 0.3, 0.5


@dataclass(frozen=True, kw_only=True)
class Modification:
    """What the tests need to know about one modification or several together."""

    settings: dict[str, object]
    """The law's keywords."""
    leaks: Callable[[float], float] | None = None
    """The leakage w of the modification as a function of epsilon m_s, given only if w theta_tilde'theta_hat < 0 is possible even
    for theta within M_0."""
    dead_zone: bool = False
    """Whether V does not grow with a modelling error of G_0."""
    implicit: bool = True
    """Whether an implicit step has the weight that the continuous law has at the step's end."""


FIXED, SWITCHING = FixedSigma(sigma=SIGMA), SwitchingSigma(sigma=SIGMA, M_0=M_0)
ZONE = DeadZone(g_0=G_0)
MODIFICATIONS = {
    "plain": Modification(settings={}),
    "sigma": Modification(settings={"leakage": FIXED}, leaks=lambda error: SIGMA),
    "switching sigma": Modification(settings={"leakage": SWITCHING}, implicit=False),
    "epsilon": Modification(
        settings={"leakage": EpsilonModification(nu=NU)}, leaks=lambda error: NU * abs(error), implicit=False
    ),
    "dead zone": Modification(settings={"dead_zone": ZONE}, dead_zone=True),
    "switching sigma and dead zone": Modification(
        settings={"leakage": SWITCHING, "dead_zone": ZONE}, dead_zone=True, implicit=False
    ),
    "sigma and dead zone": Modification(
        settings={"leakage": FIXED, "dead_zone": ZONE}, leaks=lambda error: SIGMA, dead_zone=True
    ),
}
WITHOUT_EPSILON = tuple(name for name in MODIFICATIONS if name != "epsilon")
SWITCHING_OR_DEAD_ZONE = ("plain", "switching sigma", "dead zone", "switching sigma and dead zone")


def random_gain(random: np.random.Generator, n: int) -> np.ndarray:
    root = random.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def no_memory(random: np.random.Generator, law, theta) -> tuple:
    return ()


def integrals_of_data(random: np.random.Generator, law, theta) -> integral_cost.Memory:
    """Memory of the integral cost: R from a few random regressors, and Q = R theta."""
    data = random.normal(size=(len(theta), random.integers(0, 4)))
    return integral_cost.Memory(data @ data.T, data @ data.T @ theta)


def any_covariance(random: np.random.Generator, law, theta) -> least_squares.Memory:
    """A covariance P, which is the gain of V."""
    return law.limit(least_squares.Memory(random_gain(random, len(theta))))


def covariance_within_its_bound(random: np.random.Generator, law, theta) -> least_squares.Memory:
    """A covariance P that is at its bound in half of the cases."""
    P = random_gain(random, len(theta))
    if random.uniform() < 0.5:
        P = P * (BOUND / np.linalg.norm(P))
    return law.limit(least_squares.Memory(P))


def keeps_its_norm(P: np.ndarray) -> bool:
    return np.linalg.norm(P) <= BOUND * (1 + 1e-12)


def keeps_its_eigenvalues(P: np.ndarray) -> bool:
    smallest, *_, largest = np.linalg.eigvalsh(P)
    return smallest > RHO_1 and largest <= RHO_0 * (1 + 1e-12)


@dataclass(frozen=True, kw_only=True)
class Example:
    """What the family's tests need to know about a law. A new law is added only here.

    ``fastest_rate``, ``takes`` and ``unexcited`` are derived by hand from the law's source; the tests compare the law with them.
    """

    numbers: dict[str, float]
    """The settings of the law, each a single number. The registry's test also reads them in a case file."""
    fastest_rate: float | None
    """The fastest rate of the law with these settings [1/s]; None if the rate has no bound."""
    strong: dict[str, float]
    """The settings that are larger if the law is to learn within a minute."""
    memory: Callable[..., tuple]
    """A function that draws a random memory that the law can have."""
    gain: str = ""
    """The setting that may also be a diagonal or a matrix."""
    has_covariance: bool = True
    """Whether the gain of V is the memory's covariance. Otherwise it is the setting ``gain``."""
    kept: Callable[[np.ndarray], bool] | None = None
    """The condition that the covariance satisfies at every step, together with the gain from the settings. None if any gain is
    possible."""
    shapes: tuple[str, ...] = ("number",)
    """The shapes of the gain in the tests."""
    takes: tuple[str, ...] = tuple(MODIFICATIONS)
    """The modifications that the law accepts according to the table in docs/laws.md."""
    unexcited: bool = True
    """Whether the estimates stay bounded without excitation, a known set and modifications."""

    def gain_of_V(self, law, memory, n: int) -> np.ndarray:
        """The matrix Gamma (n, n) of V = theta_tilde'Gamma^-1 theta_tilde."""
        return memory.covariance if self.has_covariance else Gain(vars(law)[self.gain]).as_matrix(n)

    def scaled(self, law, factor: float):
        """The law with ``factor`` times its gain, unless its covariance has a bound."""
        return law if self.kept is not None else replace(law, **{self.gain: factor * vars(law)[self.gain]})


BOUNDED_COVARIANCE = {
    "fastest_rate": 2 * BOUND + 0.3,  # 2 P <= 2 bound, plus the forgetting
    "gain": "covariance0",
    "memory": covariance_within_its_bound,
    "kept": keeps_its_norm,
}
CONSTANT_GAIN = {"gain": "gamma", "has_covariance": False}
FORGETTING = {"covariance0": 2.0, "forgetting": 0.3, "covariance_bound": BOUND}
STRONG_AND_BOUNDED = {"covariance0": 2000.0, "covariance_bound": 4000.0}
EVERY_SHAPE = ("number", "diagonal", "matrix")
LAW_EXAMPLES = {
    "gradient": Example(
        numbers={"gamma": 2.0}, fastest_rate=2.0, strong={"gamma": 2000.0}, memory=no_memory, shapes=EVERY_SHAPE, **CONSTANT_GAIN
    ),
    "integral-cost": Example(
        numbers={"gamma": 2.0, "forgetting": 0.4},
        fastest_rate=5.0,  # Gamma/beta
        strong={"gamma": 2000.0},
        memory=integrals_of_data,
        shapes=EVERY_SHAPE,
        takes=("plain", "sigma", "switching sigma"),
        **CONSTANT_GAIN,
    ),
    "least-squares": Example(
        numbers={"covariance0": 2.0},
        fastest_rate=4.0,
        strong={"covariance0": 2000.0},
        memory=any_covariance,
        gain="covariance0",
        shapes=EVERY_SHAPE,
        takes=SWITCHING_OR_DEAD_ZONE,
    ),
    "least-squares-forgetting": Example(
        numbers={"covariance0": 2.0, "forgetting": 0.3},
        fastest_rate=None,
        strong={"covariance0": 2000.0},
        memory=any_covariance,
        gain="covariance0",
        takes=("plain", "switching sigma"),
        unexcited=False,
    ),
    "least-squares-resetting": Example(
        numbers={"rho_0": RHO_0, "rho_1": RHO_1},
        fastest_rate=2 * RHO_0,
        strong={"rho_0": 2000.0},
        memory=any_covariance,
        kept=keeps_its_eigenvalues,
        takes=WITHOUT_EPSILON,
    ),
    "least-squares-bounded": Example(
        numbers=FORGETTING, strong=STRONG_AND_BOUNDED, shapes=("matrix",), takes=WITHOUT_EPSILON, **BOUNDED_COVARIANCE
    ),
    "least-squares-bounded-gain": Example(
        numbers=FORGETTING, strong=STRONG_AND_BOUNDED, shapes=("matrix",), takes=SWITCHING_OR_DEAD_ZONE, **BOUNDED_COVARIANCE
    ),
}


def example_of(law) -> Example:
    """The example of the law's class."""
    (kind,) = (kind for kind, made in LAWS.items() if made is type(law))
    return LAW_EXAMPLES[kind]


def plain(kind: str, n: int) -> list[dict]:
    """Laws without modifications for n <= 3 parameters, one for each shape of the gain."""
    example, values = LAW_EXAMPLES[kind], {"diagonal": np.arange(1.0, n + 1), "matrix": MATRIX[:n, :n]}
    return [example.numbers | {example.gain: values[shape]} if shape in values else example.numbers for shape in example.shapes]


@dataclass(frozen=True, eq=False)
class ModifiedLaw:
    """A law with a modification, and what is known about both."""

    name: str
    law: object
    example: Example
    modification: Modification


def laws(n: int) -> list[ModifiedLaw]:
    """All accepted combinations. Another test checks that the rest are rejected."""
    return [
        ModifiedLaw(f"{kind} {i}, {name}", LAWS[kind](**settings, **modification.settings), example, modification)
        for kind, example in LAW_EXAMPLES.items()
        for i, settings in enumerate(plain(kind, n))
        for name, modification in MODIFICATIONS.items()
        if name in example.takes
    ]


def known_sets(random: np.random.Generator, n: int) -> list:
    """No set, a box and a ball. Each point of the box and the ball has |theta| < M_0 for n <= 3."""
    lower = random.uniform(-2, 0, n)
    ball = ParameterBall(center=random.uniform(-1, 1, n), radius=random.uniform(0.5, 3.0))
    return [None, ParameterBox(lower=lower, upper=lower + random.uniform(0.5, 3.0, n)), ball]


def inside(random: np.random.Generator, known_set, n: int, *, on_the_border: bool) -> np.ndarray:
    """A point of the set, in its interior or on a face, an edge, a corner or the sphere."""
    if known_set is None:
        return random.uniform(-3, 3, n)
    if isinstance(known_set, ParameterBox):
        point = random.uniform(known_set.lower, known_set.upper)
        if on_the_border:
            side = random.choice([-1, 0, 1], n)
            point = np.where(side < 0, known_set.lower, np.where(side > 0, known_set.upper, point))
        return point
    direction = random.normal(size=n)
    direction /= np.linalg.norm(direction)
    return known_set.center + known_set.radius * direction * (1.0 if on_the_border else random.uniform() ** (1 / n))


def estimation(random: np.random.Generator, theta, theta_hat, eta_over_m: float = 0.0) -> Estimation:
    """The parametric model at a random regressor, with the modelling error given relative to m_s."""
    phi = random.normal(size=len(theta)) * 10.0 ** random.uniform(-1, 1)
    m_s_squared = 1 + phi @ phi + random.uniform(0, 2)
    eta = eta_over_m * np.sqrt(m_s_squared)
    return Estimation(phi, m_s_squared, ((theta - theta_hat) @ phi + eta) / m_s_squared)
