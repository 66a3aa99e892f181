"""Every law of the registry with every modification that it takes, and random situations to put them in."""

from __future__ import annotations

import numpy as np

from barbalat import DeadZone, EpsilonModification, FixedSigma, ParameterBall, ParameterBox, SwitchingSigma
from barbalat.adaptation.laws import LAWS, Estimation
from barbalat.validate import InputError

BOUND = 40.0
"""Of the covariance, in the Frobenius norm; rho_0 of the law that resets."""
M_0 = 6.0
"""Above |theta| in every situation."""
G_0 = 0.05

MATRIX = np.array([[3.0, 1.0, 0.5], [1.0, 2.0, -0.4], [0.5, -0.4, 1.0]])


def plain(n: int) -> dict[str, list[dict]]:
    """Settings without modifications for n <= 3 parameters: a scalar, a diagonal and a matrix where a law takes them."""
    gains = [2.0, np.arange(1.0, n + 1), MATRIX[:n, :n]]
    forgetting = {"forgetting": 0.3, "covariance_bound": BOUND}
    return {
        "gradient": [{"gamma": gain} for gain in gains],
        "integral-cost": [{"gamma": gain, "forgetting": 0.4} for gain in gains],
        "least-squares": [{"covariance0": gain} for gain in gains],
        "least-squares-forgetting": [{"covariance0": gains[0], "forgetting": 0.3}],
        "least-squares-resetting": [{"rho_0": 20.0, "rho_1": 0.5}],
        "least-squares-bounded": [{"covariance0": gains[2], **forgetting}],
        "least-squares-bounded-gain": [{"covariance0": gains[2], **forgetting}],
    }


MODIFICATIONS = {
    "plain": {},
    "sigma": {"leakage": FixedSigma(sigma=0.3)},
    "switching sigma": {"leakage": SwitchingSigma(sigma=0.3, M_0=M_0)},
    "epsilon": {"leakage": EpsilonModification(nu=0.5)},
    "dead zone": {"dead_zone": DeadZone(g_0=G_0)},
    "switching sigma and dead zone": {"leakage": SwitchingSigma(sigma=0.3, M_0=M_0), "dead_zone": DeadZone(g_0=G_0)},
    "sigma and dead zone": {"leakage": FixedSigma(sigma=0.3), "dead_zone": DeadZone(g_0=G_0)},
}


def laws(n: int) -> list[tuple[str, object]]:
    """(name, law) for all that can be built; the refused combinations are tested elsewhere."""
    found = []
    for kind, variants in plain(n).items():
        for i, settings in enumerate(variants):
            for modification, extra in MODIFICATIONS.items():
                try:
                    found.append((f"{kind} {i}, {modification}", LAWS[kind](**settings, **extra)))
                except (InputError, TypeError):
                    continue
    return found


def random_gain(random: np.random.Generator, n: int) -> np.ndarray:
    root = random.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


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
