"""The rule under which every scheme is tuned, and what a case lacks for it: a delay margin to ask for, measurement noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from barbalat import validate
from barbalat.comparison.search.aim import Aim
from barbalat.comparison.search.quantity import Constraint, TunedQuantity
from barbalat.comparison.search.search import least_trials
from barbalat.problem.measurement import Noise, Sensor
from barbalat.problem.state_feedback import Problem
from barbalat.settings import Settings
from barbalat.solvers.simulation import Simulation
from barbalat.study.delay_margin import LARGEST_GAIN_ERROR, LONGEST_DELAY
from barbalat.study.ideal_benchmark import SHORTEST_DELAY_STEPS
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.study.verdicts import Criterion
from barbalat.validate import InputError

DEFAULT_GAIN_MARGIN = 1.5
"""Factor: what is asked of flight control systems is 6 dB, a factor of 2, of which simulated plants of a known set often leave no
scheme at all; 3.5 dB is what many of them can be asked."""
DEFAULT_PLANTS, DEFAULT_TRIALS = 4, 384
"""As of ``tune``."""
OBJECTIVE_FIGURE = "rms_e"
DELAY_KEYS = {Criterion.ONSET: "delay_margin_measured", Criterion.LOSS: "delay_margin_simulated"}
GAIN_KEYS = {Criterion.ONSET: "gain_margin_measured", Criterion.LOSS: "gain_margin_simulated"}


@dataclass(frozen=True, kw_only=True, init=False)
class Rule(Settings):
    """A scheme's tuning is the one with the least RMS |e| on the worst of the plants among those that keep both margins there.

    delay_margin  added at the plant's input [s]
    gain_margin   factor above 1: the input's effectiveness multiplied by it, and divided by it
    until         what a loop that bears them does not do: "onset", begin to oscillate, or "loss", lose its motion
    plants        the problem's own and so many less one of its known set
    trials        tunings that are tried of each scheme
    seed          of the plants, the searches, the held-out plants, commands and noise
    also          further constraints of the tuning, such as "max_abs_u <= 10"
    """

    delay_margin: float
    gain_margin: float = DEFAULT_GAIN_MARGIN
    until: Criterion = Criterion.ONSET
    plants: int = DEFAULT_PLANTS
    trials: int = DEFAULT_TRIALS
    seed: int = 0
    also: tuple[str, ...] = ()

    def __init__(
        self,
        *,
        delay_margin: float,
        gain_margin: float = DEFAULT_GAIN_MARGIN,
        until: Criterion | str = Criterion.ONSET,
        plants: int = DEFAULT_PLANTS,
        trials: int = DEFAULT_TRIALS,
        seed: int = 0,
        also: tuple[str, ...] = (),
    ) -> None:
        validate.freeze(
            self, delay_margin=delay_margin, gain_margin=gain_margin, until=Criterion.accept("until", until), plants=plants,
            trials=trials, seed=seed, also=also,
        )  # fmt: skip
        self.__post_init__()

    def __post_init__(self) -> None:
        if not 0 < validate.number("delay_margin", self.delay_margin) <= LONGEST_DELAY:
            raise InputError(f"delay_margin must be above 0 and at most {LONGEST_DELAY:g} s, got {self.delay_margin:g} s")
        most = 1 + LARGEST_GAIN_ERROR
        if not 1 < validate.number("gain_margin", self.gain_margin) <= most:
            raise InputError(f"gain_margin must be a factor above 1 and at most {most:g}, such as 2, got {self.gain_margin:g}")
        validate.whole("plants", self.plants, least=1)
        validate.whole("seed", self.seed, least=0)
        validate.whole("trials", self.trials, least=least_trials(1))

    @property
    def constraints(self) -> tuple[Constraint, Constraint]:
        """On the delay, on the gain."""
        delay = Constraint.parse(f"{DELAY_KEYS[self.until]} >= {self.delay_margin!r}")
        return delay, Constraint.parse(f"{GAIN_KEYS[self.until]} >= {self.gain_margin!r}")

    @property
    def aim(self) -> Aim:
        """The rule as the aim of a tuning."""
        quantity = TunedQuantity(OBJECTIVE_FIGURE, larger_is_worse=True)
        constraints = (*self.constraints, *map(Constraint.parse, self.also))
        return Aim(quantity=quantity, constraints=constraints, plants=self.plants, seed=self.seed)

    def require_steps(self, simulation: Simulation) -> None:
        """InputError for a delay that can't be simulated."""
        shortest = SHORTEST_DELAY_STEPS * simulation.dt
        if self.delay_margin < shortest:
            raise InputError(f"delay_margin must be at least two solver steps, {shortest:g} s, got {self.delay_margin:g} s")

    def as_json(self) -> dict[str, object]:
        return {
            "delay_margin": self.delay_margin,
            "gain_margin": self.gain_margin,
            "until": self.until.value,
            "objective": OBJECTIVE_FIGURE,
            "plants": self.plants,
            "trials": self.trials,
            "seed": self.seed,
        }


MOST_CORNERS = 1024
"""Of a known box that are looked at."""


def default_delay_margin(problem: Problem, simulation: Simulation) -> float:
    """A tenth of the fastest time constant among the model and, where phi(x) = x, the corners of the known set [s]; two digits.

    What lies between controller and plant is then taken to begin a decade above what the equations describe. At least four
    solver steps.
    """
    plant, known = problem.plant, problem.known.theta_set
    matrices = [plant.A_m]
    if plant.is_linear and known is not None:
        corners = list(product(*zip(*known.extent, strict=True)))[:MOST_CORNERS]
        b = plant.b.reshape(plant.n, -1)
        matrices += [plant.A_m + b @ np.reshape(corner, (plant.n, -1)).T for corner in corners]
    fastest = max(float(np.abs(np.linalg.eigvals(one)).max()) for one in matrices)
    return max(float(f"{0.1 / fastest:.2g}"), 4 * simulation.dt)


DEFAULT_NOISE_SHARE = 1e-3
"""Of the model's largest motion, in each state: about one bit of ten, as of a plain sensor."""


def with_noise(problem: Problem, share: float, simulation: Simulation, sample_time: float, seed: int) -> Problem:
    """The problem, with Gaussian noise where it has none; ``share`` 0 leaves it without.

    sample_time  about how long a value is held [s]: the nearest whole number of solver steps
    """
    if problem.noise is not None or share == 0:
        return problem
    if not 0 < share < 1:
        raise InputError(f"noise must be a share of the model's motion, at least 0 and below 1, got {share:g}")
    steps = max(round(sample_time / simulation.dt), 1)
    held = simulation.dt * steps
    noise = Noise(std=[share * each for each in ReferenceMotion.of(problem, simulation).of_each], sample_time=held, seed=seed)
    return problem.with_sensor(lambda own: Sensor(noise=noise) if own is None else replace(own, noise=noise))
