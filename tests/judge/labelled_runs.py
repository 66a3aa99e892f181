"""Runs with a known label: limit cycles in closed form, and runs that must not be taken for one."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from barbalat import Plant, Problem, ReferenceModel, Simulation
from barbalat.plants import Noise, PlantInput, Sensor
from barbalat.signals import Chirp, Constant, Sine, Sines, Square


class Nothing(NamedTuple):
    theta_hat: np.ndarray


@dataclass(frozen=True)
class Law:
    """A feedback without memory."""

    name: str = "law"

    def bind(self, known: Any) -> Any:
        return self

    def initial(self) -> Nothing:
        return Nothing(np.zeros(0))

    def derivative(self, state: Any, x: Any, x_m: Any, r: Any, u: Any) -> Nothing:
        return Nothing(np.zeros(0))

    def limit(self, state: Any) -> Any:
        return state


@dataclass(frozen=True)
class VanDerPol(Law):
    """A law that makes x1'' = -x1 + u van der Pol's oscillator x1'' - mu (1 - x1^2) x1' + x1 = r."""

    mu: float = 1.0

    def control(self, state: Any, x: Any, x_m: Any, r: Any) -> Any:
        return self.mu * (1 - x[0] * x[0]) * x[1] + r


@dataclass(frozen=True)
class Gain(Law):
    """The feedback u = k'(x_m - x) + r."""

    k: np.ndarray = field(default_factory=lambda: np.ones(1))

    def control(self, state: Any, x: Any, x_m: Any, r: Any) -> Any:
        return self.k @ (x_m - x) + r


class Labelled(NamedTuple):
    """Members of one structure and whether they are limit cycles."""

    members: list
    simulation: Simulation
    cycle: bool


def oscillator(damping: float, x0: list[float], reference: Any = None, **more: Any) -> Problem:
    """The plant x1'' + 2 damping x1' + x1 = u."""
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-1.0, -1.4]], b=[0.0, 1.0], theta=[0.0, 1.4 - 2 * damping], x0=x0, **more),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Constant(0.0) if reference is None else reference,
    )


def relay_problem(a: float, delay: float, noise: float = 0.0, reference: Any = None, limit: float = 1.0) -> Problem:
    """The plant x' = -a x + sat(u(t - delay)), with the limit 1 by default. With a high gain the limits act as a relay."""
    return Problem(
        plant=Plant(A_m=[[-1.0]], b=[1.0], theta=[1.0 - a], x0=[0.1], input=PlantInput(saturation=[-limit, limit], delay=delay)),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Constant(0.0) if reference is None else reference,
        sensor=Sensor(noise=Noise(std=[noise], sample_time=0.01, seed=1)) if noise else None,
    )


RELAY_GAIN = 1e4


def relay_cycle(a: float, delay: float) -> tuple[float, float]:
    """Exact amplitude of x and frequency [rad/s] of a relay of +-1 with a delay before 1/(s + a).

    From x = 0 the old control acts for the delay and moves x to (1 - e^(-a delay))/a. The other one returns it to 0 in ln(2 -
    e^(-a delay))/a. Both times together are half a period.
    """
    amplitude = -np.expm1(-a * delay) / a
    return amplitude, np.pi / (delay + np.log(2 - np.exp(-a * delay)) / a)


def describing_function_cycle(a: float, delay: float) -> tuple[float, float]:
    """The limit cycle by harmonic balance: arctan(w/a) + w delay = pi, and the amplitude 4/(pi |j w + a|)."""
    from scipy.optimize import brentq

    w = brentq(lambda w: np.arctan(w / a) + w * delay - np.pi, 1e-6, np.pi / delay)
    return 4 / (np.pi * np.hypot(w, a)), w


def labelled(rng: np.random.Generator, count: int) -> dict[str, Labelled]:
    """``count`` members of each kind."""

    def each(make: Any) -> list:
        return [make() for _ in range(count)]

    def rotated(largest: float = 2.0) -> list[float]:
        return rng.uniform(-largest, largest, 2).tolist()

    usual = Simulation(t_end=60.0, dt=0.01)
    fine, short = Simulation(t_end=20.0, dt=0.002), Simulation(t_end=8.0, dt=0.002)
    square, chirp, sine = Square(1.0, 0.7), Chirp(1.0, 0.2, 4.0, 60.0), Sine(1.0, 2.0)

    def hidden(reference: Any) -> tuple:
        """A run that follows within its band, whose command reverses about as often as it oscillates."""
        return relay_problem(rng.uniform(0.8, 1.2), rng.uniform(0.008, 0.012), reference=reference, limit=1.3), fast

    fast, rippling = Gain(k=np.array([1e3])), Sines(amplitudes=[1.0, 0.06], frequencies=[0.3, 100.0])
    faster = Simulation(t_end=40.0, dt=1e-3)

    def pd(reference: Any, noise: float = 0.0) -> tuple:
        problem = Problem(
            plant=Plant(
                A_m=[[0.0, 1.0], [-1.0, -1.4]],
                b=[0.0, 1.0],
                theta=rng.uniform(-1, 1, 2),
                x0=rotated(0.5),
                input=PlantInput(saturation=[-3.0, 3.0]),
            ),
            reference_model=ReferenceModel(k_0=1.0),
            reference=reference,
            sensor=Sensor(noise=Noise(std=[noise, noise], sample_time=0.02, seed=3)) if noise else None,
        )
        return problem, Gain(k=rng.uniform([2, 1], [8, 5]))

    return {
        "van der Pol": Labelled(each(lambda: (oscillator(0.0, rotated()), VanDerPol(mu=rng.uniform(0.2, 3)))), usual, True),
        "van der Pol, a large start": Labelled(
            each(lambda: (oscillator(0.0, rotated(6.0)), VanDerPol(mu=rng.uniform(0.2, 1.2)))), usual, True
        ),
        "relay, fast command": Labelled(each(lambda: hidden(Square(0.8, 60.0))), faster, True),
        "relay, rippling command": Labelled(each(lambda: hidden(rippling)), faster, True),
        "relay with delay": Labelled(
            each(lambda: (relay_problem(rng.uniform(0.3, 3), rng.uniform(0.05, 0.5)), Gain(k=np.array([RELAY_GAIN])))), fine, True
        ),
        "relay with delay and noise": Labelled(
            each(lambda: (relay_problem(rng.uniform(0.3, 3), rng.uniform(0.1, 0.5), 0.002), Gain(k=np.array([300.0])))),
            fine,
            True,
        ),
        "relay with delay, square command": Labelled(
            each(
                lambda: (
                    relay_problem(rng.uniform(0.3, 3), rng.uniform(0.05, 0.3), reference=Square(0.2, 0.7)),
                    Gain(k=np.array([300.0])),
                )
            ),
            fine,
            True,
        ),
        "one to three periods in the tail": Labelled(
            each(lambda: (relay_problem(rng.uniform(0.3, 3), rng.uniform(0.2, 0.5)), Gain(k=np.array([300.0])))), short, True
        ),
        "square command": Labelled(each(lambda: pd(square)), usual, False),
        "square command and noise": Labelled(each(lambda: pd(square, 0.05)), usual, False),
        "chirp": Labelled(each(lambda: pd(chirp)), usual, False),
        "sine": Labelled(each(lambda: pd(sine)), usual, False),
        "sine and ripple": Labelled(each(lambda: pd(Sines(amplitudes=[1.0, 0.06], frequencies=[0.3, 20.0]))), usual, False),
        "noise alone": Labelled(each(lambda: pd(Constant(0.0), 0.1)), usual, False),
        "faintly damped": Labelled(
            each(lambda: (oscillator(rng.uniform(0.01, 0.05), rotated(), square), Gain(k=np.array([0.3, 0.0])))), usual, False
        ),
        "faintly damped, at rest": Labelled(
            each(lambda: (oscillator(rng.uniform(0.003, 0.05), rotated()), Gain(k=np.array([0.3, 0.0])))), usual, False
        ),
        "slow divergence": Labelled(
            each(lambda: (oscillator(-rng.uniform(0.01, 0.05), rotated()), Gain(k=np.array([0.3, 0.0])))), usual, False
        ),
        "drift": Labelled(
            each(lambda: (oscillator(0.7, rotated()), Gain(k=np.array([-1.0 - rng.uniform(0.01, 0.03), 0.0])))), usual, False
        ),
    }
