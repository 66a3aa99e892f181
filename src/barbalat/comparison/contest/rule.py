"""The rule under which every scheme is tuned, and defaults for a missing delay margin or missing measurement noise."""

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
from barbalat.study.delay_margin import LARGEST_GAIN_ERROR
from barbalat.study.ideal_benchmark import SHORTEST_DELAY_STEPS, shortest_delay
from barbalat.study.reference_motion import ReferenceMotion
from barbalat.study.verdicts import Criterion
from barbalat.validate import InputError

DEFAULT_GAIN_MARGIN = 1.5
"""Default gain margin as a factor. Flight control systems require 6 dB, a factor of 2, which often excludes every scheme on the
plants of a known set. Many schemes can satisfy 3.5 dB."""
DEFAULT_PLANTS, DEFAULT_TRIALS = 4, 384
"""The defaults, which are the same as in ``tune``."""
OBJECTIVE_FIGURE = "rms_e"
DELAY_KEYS = {Criterion.ONSET: "delay_margin_measured", Criterion.LOSS: "delay_margin_simulated"}
GAIN_KEYS = {Criterion.ONSET: "gain_margin_measured", Criterion.LOSS: "gain_margin_simulated"}


@dataclass(frozen=True, kw_only=True, init=False)
class Rule(Settings):
    """The rule of a contest. The tuning of a scheme is the one with the smallest RMS |e| on the worst plant, among the tunings
    that keep both margins on all plants.

    delay_margin  additional delay at the plant's input [s]
    gain_margin   factor above 1 by which the input's effectiveness is multiplied and divided
    until         end of a margin: "onset", where the loop begins to oscillate, or "loss", where it loses the commanded motion
    plants        number of plants: the plant of the problem and others from its known set
    trials        number of tunings tried for each scheme
    seed          seed of the plants, the searches, the validation plants, commands and noise
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
        validate.positive("delay_margin", self.delay_margin)
        most = 1 + LARGEST_GAIN_ERROR
        if not 1 < validate.number("gain_margin", self.gain_margin) <= most:
            raise InputError(f"gain_margin must be a factor above 1 and at most {most:g}, such as 2, got {self.gain_margin:g}")
        validate.whole("plants", self.plants, least=1)
        validate.whole("seed", self.seed, least=0)
        validate.whole("trials", self.trials, least=least_trials(1))

    @property
    def constraints(self) -> tuple[Constraint, Constraint]:
        """The constraints on the delay and on the gain."""
        delay = Constraint.parse(f"{DELAY_KEYS[self.until]} >= {self.delay_margin!r}")
        return delay, Constraint.parse(f"{GAIN_KEYS[self.until]} >= {self.gain_margin!r}")

    @property
    def aim(self) -> Aim:
        """The rule as the aim of a tuning."""
        quantity = TunedQuantity(OBJECTIVE_FIGURE, larger_is_worse=True)
        constraints = (*self.constraints, *map(Constraint.parse, self.also))
        return Aim(quantity=quantity, constraints=constraints, plants=self.plants, seed=self.seed)

    def require_steps(self, simulation: Simulation, called: str = "delay_margin") -> None:
        """Raise InputError for a delay that cannot be simulated. ``called`` is its name in the user's input."""
        shortest, delay = SHORTEST_DELAY_STEPS * simulation.resolution, self.delay_margin
        if delay < shortest:
            raise InputError(f"{called} must be at least {shortest_delay(simulation)}, got {delay:g} s")
        if delay >= simulation.t_end:
            raise InputError(f"{called} must be shorter than simulation.t_end = {simulation.t_end:g} s, got {delay:g} s")

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
"""Largest number of corners of a known box that are checked."""


def default_delay_margin(problem: Problem, simulation: Simulation) -> float:
    """Return a tenth of the fastest time constant of the model and, for phi(x) = x, of the corners of the known set [s], rounded
    to two digits.

    This assumes that unmodelled dynamics begin a decade above the modelled dynamics. The result is at least four solver steps.
    """
    plant, known = problem.plant, problem.known.theta_set
    matrices = [plant.A_m]
    if plant.is_linear and known is not None:
        corners = list(product(*zip(*known.extent, strict=True)))[:MOST_CORNERS]
        b = plant.b.reshape(plant.n, -1)
        matrices += [plant.A_m + b @ np.reshape(corner, (plant.n, -1)).T for corner in corners]
    fastest = max(float(np.abs(np.linalg.eigvals(one)).max()) for one in matrices)
    return max(float(f"{0.1 / fastest:.2g}"), 4 * simulation.resolution)


DEFAULT_NOISE_SHARE = 1e-3
"""Default noise of each state as a fraction of the model's largest motion, about one bit of a 10-bit sensor."""


def with_noise(problem: Problem, share: float, simulation: Simulation, sample_time: float, seed: int) -> Problem:
    """Return the problem, with added Gaussian noise if it has neither noise nor a quantised measurement. A ``share`` of 0 adds no
    noise.

    sample_time  approximate time for which a value is held [s]: the nearest whole number of solver steps
    """
    sensor = problem.surroundings.sensor
    if problem.noise is not None or share == 0 or (sensor is not None and sensor.quantization is not None):
        return problem
    if not 0 < share < 1:
        raise InputError(f"noise must be a fraction of the model's range of motion, at least 0 and below 1, got {share:g}")
    held = simulation.resolution * max(round(sample_time / simulation.resolution), 1)
    noise = Noise(std=[share * each for each in ReferenceMotion.of(problem, simulation).of_each], sample_time=held, seed=seed)
    return problem.with_sensor(lambda own: Sensor(noise=noise) if own is None else replace(own, noise=noise))


def added_noise(problem: Problem, noisy: Problem, share: float) -> str | None:
    """Return a sentence on the noise that ``with_noise`` has added; None if the case already has noise, or none was requested."""
    if problem.noise is not None or noisy.noise is None:
        return None
    each = ", ".join(f"{float(std):.3g}" for std in np.atleast_1d(noisy.noise.std))
    names = ", ".join(problem.measured_names)
    return (
        f"the case has no measurement noise, so Gaussian noise of {100 * share:.3g} % of the largest motion of the model is "
        f"added (standard deviation of {names}: {each}; a new value every {noisy.noise.sample_time:.3g} s). If the sensor's "
        f"noise is known, declare it in [sensor.noise]"
    )
