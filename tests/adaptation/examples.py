"""Every law of the registry with every modification that it takes, and random situations to put them in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from barbalat import DeadZone, EpsilonModification, FixedSigma, ParameterBall, ParameterBox, SwitchingSigma
from barbalat.adaptation.laws import LAWS, Estimation, covariance, integral_cost
from barbalat.problem.known_set import Gain

BOUND = 40.0
"""Of the covariance, in the Frobenius norm; rho_0 of the law that resets."""
M_0 = 6.0
"""Above |theta| in every situation."""
G_0 = 0.05

MATRIX = np.array([[3.0, 1.0, 0.5], [1.0, 2.0, -0.4], [0.5, -0.4, 1.0]])


MODIFICATIONS = {
    "plain": {},
    "sigma": {"leakage": FixedSigma(sigma=0.3)},
    "switching sigma": {"leakage": SwitchingSigma(sigma=0.3, M_0=M_0)},
    "epsilon": {"leakage": EpsilonModification(nu=0.5)},
    "dead zone": {"dead_zone": DeadZone(g_0=G_0)},
    "switching sigma and dead zone": {"leakage": SwitchingSigma(sigma=0.3, M_0=M_0), "dead_zone": DeadZone(g_0=G_0)},
    "sigma and dead zone": {"leakage": FixedSigma(sigma=0.3), "dead_zone": DeadZone(g_0=G_0)},
}
WITHOUT_EPSILON = tuple(name for name in MODIFICATIONS if name != "epsilon")
SWITCHING_OR_DEAD_ZONE = ("plain", "switching sigma", "dead zone", "switching sigma and dead zone")


def random_gain(random: np.random.Generator, n: int) -> np.ndarray:
    root = random.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


def gain_alone(random: np.random.Generator, law, theta) -> tuple:
    """No memory, and the constant gain of V."""
    return (), Gain(law.gamma).as_matrix(len(theta))


def integrals_of_data(random: np.random.Generator, law, theta) -> tuple:
    """Of the cost: R of a few random regressors and Q = R theta."""
    data = random.normal(size=(len(theta), random.integers(0, 4)))
    return integral_cost.Memory(data @ data.T, data @ data.T @ theta), Gain(law.gamma).as_matrix(len(theta))


def covariance_within_its_bound(random: np.random.Generator, law, theta) -> tuple:
    """P, which is the gain of V; half of the time at the bound where the law has one."""
    P = random_gain(random, len(theta))
    bound = getattr(law, "covariance_bound", None)
    if bound is not None and random.uniform() < 0.5:
        P = P * (bound / np.linalg.norm(P))
    return law.limit(covariance.Memory(P)), None


@dataclass(frozen=True, kw_only=True)
class Example:
    """What the tests of the family need to know of a law: the one place where a new one is entered.

    ``fastest_rate``, ``takes`` and ``unexcited`` are by hand, from the law's source: the tests hold the law against them.
    """

    numbers: dict[str, float]
    """Its settings, a number each; the registry's own test reads them in a case file too."""
    fastest_rate: float | None
    """With these numbers, [1/s]; None where nothing bounds it."""
    strong: dict[str, float]
    """What of the settings is larger where the law is to learn within a minute."""
    memory: Callable[..., tuple]
    """A random memory that the law can have, and the gain of its Lyapunov function, None where the memory's covariance is."""
    gain: str = ""
    """The setting that takes a diagonal or a matrix as well."""
    shapes: tuple[str, ...] = ("number",)
    """Those of the gain that the tests go through."""
    takes: tuple[str, ...] = tuple(MODIFICATIONS)
    """The modifications that it bears: the table in docs/laws.md."""
    unexcited: bool = True
    """Whether its estimates stay bounded without excitation, set and modifications."""


COVARIANCE = {"fastest_rate": 2 * BOUND + 0.3, "gain": "covariance0", "memory": covariance_within_its_bound}
"""2 P <= 2 bound, and the forgetting."""
FORGETTING = {"covariance0": 2.0, "forgetting": 0.3, "covariance_bound": BOUND}
STRONG_AND_BOUNDED = {"covariance0": 2000.0, "covariance_bound": 4000.0}
EVERY_SHAPE = ("number", "diagonal", "matrix")
LAW_EXAMPLES = {
    "gradient": Example(
        numbers={"gamma": 2.0}, fastest_rate=2.0, strong={"gamma": 2000.0}, memory=gain_alone, gain="gamma", shapes=EVERY_SHAPE
    ),
    "integral-cost": Example(
        numbers={"gamma": 2.0, "forgetting": 0.4},
        fastest_rate=5.0,  # Gamma/beta
        strong={"gamma": 2000.0},
        memory=integrals_of_data,
        gain="gamma",
        shapes=EVERY_SHAPE,
        takes=("plain", "sigma", "switching sigma"),
    ),
    "least-squares": Example(
        numbers={"covariance0": 2.0},
        fastest_rate=4.0,
        strong={"covariance0": 2000.0},
        memory=covariance_within_its_bound,
        gain="covariance0",
        shapes=EVERY_SHAPE,
        takes=SWITCHING_OR_DEAD_ZONE,
    ),
    "least-squares-forgetting": Example(
        numbers={"covariance0": 2.0, "forgetting": 0.3},
        fastest_rate=None,
        strong={"covariance0": 2000.0},
        memory=covariance_within_its_bound,
        gain="covariance0",
        takes=("plain", "switching sigma"),
        unexcited=False,
    ),
    "least-squares-resetting": Example(
        numbers={"rho_0": 20.0, "rho_1": 0.5},
        fastest_rate=40.0,
        strong={"rho_0": 2000.0},
        memory=covariance_within_its_bound,
        takes=WITHOUT_EPSILON,
    ),
    "least-squares-bounded": Example(
        numbers=FORGETTING, strong=STRONG_AND_BOUNDED, shapes=("matrix",), takes=WITHOUT_EPSILON, **COVARIANCE
    ),
    "least-squares-bounded-gain": Example(
        numbers=FORGETTING, strong=STRONG_AND_BOUNDED, shapes=("matrix",), takes=SWITCHING_OR_DEAD_ZONE, **COVARIANCE
    ),
}


def plain(kind: str, n: int) -> list[dict]:
    """Settings without modifications for n <= 3 parameters, one for each shape of the gain."""
    example, values = LAW_EXAMPLES[kind], {"diagonal": np.arange(1.0, n + 1), "matrix": MATRIX[:n, :n]}
    return [example.numbers | {example.gain: values[shape]} if shape in values else example.numbers for shape in example.shapes]


def laws(n: int) -> list[tuple[str, object]]:
    """(name, law) for all that is borne; that the other combinations are refused is tested too."""
    return [
        (f"{kind} {i}, {modification}", LAWS[kind](**settings, **MODIFICATIONS[modification]))
        for kind, example in LAW_EXAMPLES.items()
        for i, settings in enumerate(plain(kind, n))
        for modification in MODIFICATIONS
        if modification in example.takes
    ]


def known_sets(random: np.random.Generator, n: int) -> list:
    """No set, a box and a ball; each point of the latter has |theta| < M_0 for n <= 3."""
    lower = random.uniform(-2, 0, n)
    ball = ParameterBall(center=random.uniform(-1, 1, n), radius=random.uniform(0.5, 3.0))
    return [None, ParameterBox(lower=lower, upper=lower + random.uniform(0.5, 3.0, n)), ball]


def inside(random: np.random.Generator, known_set, n: int, *, on_the_border: bool) -> np.ndarray:
    """A point of the set: in its interior, or on faces, edges, corners, the sphere."""
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
