"""Settings of a simulation: the method, its step or its tolerance, the horizon."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate
from barbalat.settings import Settings, one_line
from barbalat.solvers.registry import solver_of
from barbalat.solvers.tableau import AUTO, RK4, Tableau
from barbalat.validate import Array, InputError

POINT = Estimate(memory=1000.0)
"""The cost of a recorded instant of a small adaptive loop, for several copies of its state and envelope."""
STEP = Estimate(seconds=1e-7)
"""The cost of a step of the smallest loop, with one state, in a single run."""

LEAST_TOLERANCE, LARGEST_TOLERANCE = 1e-12, 1e-2
"""The range of tolerances: below it, rounding errors of the states are no longer small compared with the tolerance; above it,
the error estimate is meaningless."""


def _require_steps(t_end: float, dt: float) -> None:
    """Raise InputError for more steps than any run can have within the budget; each run checks its own cost later."""
    steps = t_end / dt
    budget.require(
        "simulation.dt", int(min(steps, 1e30)), STEP.times,
        given=f"= {dt:g} makes {steps:.3g} steps up to t_end = {t_end:g}, which",
        fits=lambda most: (
            f"a t_end of {dt * _round_number(most):g} s with this step, or a step of {t_end / _round_number(most)!r} s,"
        ),
    )  # fmt: skip


def _round_number(most: int) -> int:
    """The largest of 1, 2, 5, 10, 20, ... up to ``most``."""
    power = 10 ** (len(str(most)) - 1)
    return int(power * max(digit for digit in (1, 2, 5) if digit * power <= most))


@dataclass(frozen=True, init=False)
class Simulation(Settings):
    """Settings of a simulation: fixed steps of ``dt`` [s] from 0 to ``t_end`` [s], or steps that follow from a ``tolerance``.

    t_end          horizon [s]
    dt             step [s]; it divides t_end
    solver         the name of the method; in Python also a Tableau. rk4 by default; with a tolerance only auto is possible
    tolerance      instead of dt: the error allowed per step in each state, relative to the largest magnitude of the state so far
    record_points  approximate number of recorded instants of a trajectory; metrics are computed over every step
    fused          use fused multiply-adds; without them steps take longer, but exported C and pages agree with the run bit for
                   bit

    Raises InputError if dt does not divide t_end, or unless exactly one of dt and tolerance is given. With a tolerance ``dt`` is
    None, and only ``grid`` has a number of steps.
    """

    t_end: float
    dt: float = None  # type: ignore[assignment]  # None only with a tolerance; ``require_steps`` checks it
    _: KW_ONLY
    solver: Tableau = RK4
    tolerance: float | None = None
    record_points: int = 2000
    fused: bool = True
    steps: int = field(init=False)

    __repr__ = one_line

    def __init__(
        self,
        t_end: float,
        dt: float | None = None,
        *,
        solver: Tableau | str | None = None,
        tolerance: float | None = None,
        record_points: int = 2000,
        fused: bool = True,
    ) -> None:
        automatic = isinstance(solver, (str, Tableau)) and solver in (AUTO.name, AUTO)
        if tolerance is not None and not (solver is None or automatic):
            raise InputError.of(
                "simulation.solver", f"must be auto if a tolerance is given, got {getattr(solver, 'name', solver)}"
            )
        if tolerance is None and automatic:
            raise InputError.of(
                "simulation.solver", "auto needs simulation.tolerance, but dt is given: choose a different method"
            )
        method = AUTO if tolerance is not None else RK4 if solver is None else solver_of("simulation.solver", solver)
        validate.freeze(self, t_end=t_end, dt=dt, solver=method, tolerance=tolerance, record_points=record_points, fused=fused)
        self.__post_init__()

    def __post_init__(self) -> None:
        t_end = validate.positive("simulation.t_end", self.t_end)
        if self.tolerance is not None:
            self._by_tolerance(t_end)
            return
        if self.dt is None:
            raise InputError.of("simulation", "needs dt, the step [s], or a tolerance, such as 1e-6")
        dt = validate.positive("simulation.dt", self.dt)
        if not isinstance(self.fused, (bool, np.bool_)):
            raise InputError.of("simulation.fused", f"must be true or false, got {validate.show(self.fused)}")
        record_points = validate.whole("simulation.record_points", self.record_points, least=2)
        ratio = t_end / dt
        _require_steps(t_end, dt)
        steps = round(ratio)
        if steps < 1 or abs(steps * dt - t_end) > 1e-9 * t_end:
            nearest = t_end / max(steps, 1)
            raise InputError.of(
                "simulation.dt", f"must divide simulation.t_end, but {t_end:g} / {dt:g} = {ratio:.9g}; {nearest!r} would"
            )
        if record_points < steps:
            budget.require("simulation.record_points", record_points, POINT.times, least=2)
        else:
            budget.require(
                "simulation.record_points", steps, POINT.times, least=2, given=f"= {record_points}, for {steps} steps,"
            )
        object.__setattr__(self, "t_end", t_end)
        object.__setattr__(self, "dt", dt)
        object.__setattr__(self, "record_points", record_points)
        object.__setattr__(self, "fused", bool(self.fused))
        object.__setattr__(self, "steps", steps)

    def _by_tolerance(self, t_end: float) -> None:
        tolerance = validate.number("simulation.tolerance", self.tolerance)
        dt: float | None = self.dt
        if dt is not None:
            raise InputError.of("simulation.tolerance", f"replaces dt, but dt = {validate.show(self.dt)} is given too")
        if not LEAST_TOLERANCE <= tolerance <= LARGEST_TOLERANCE:
            raise InputError.of(
                "simulation.tolerance", f"must be from {LEAST_TOLERANCE:g} to {LARGEST_TOLERANCE:g}, got {tolerance:g}"
            )
        if not isinstance(self.fused, (bool, np.bool_)):
            raise InputError.of("simulation.fused", f"must be true or false, got {validate.show(self.fused)}")
        points = validate.whole("simulation.record_points", self.record_points, least=2)
        budget.require("simulation.record_points", points, POINT.times, least=2)
        validate.freeze(
            self, t_end=t_end, tolerance=tolerance, record_points=points, fused=bool(self.fused), steps=4 * -(-points // 4)
        )

    def require_steps(self, what: str) -> None:
        """Raise InputError if there are no fixed steps; the message says that ``what`` needs them."""
        if self.tolerance is not None:
            raise InputError.of(
                "simulation.tolerance",
                f"= {self.tolerance:g} does not determine a fixed step, but {what} needs one: give simulation.dt",
            )

    @property
    def grid(self) -> Simulation:
        """For a variable-step run, the recorded instants as a grid of fixed steps; the tail begins at one of them."""
        return Simulation(self.t_end, self.t_end / self.steps, record_points=self.steps, fused=self.fused)

    @property
    def resolution(self) -> float:
        """The step [s]; with a tolerance, a tenth of the time between two recorded instants, which studies use as the step."""
        return self.dt if self.tolerance is None else self.t_end / (10 * self.steps)

    @property
    def stepped(self) -> Simulation:
        """The settings with fixed steps; with a tolerance, RK4 at the ``resolution``."""
        return self if self.tolerance is None else Simulation(self.t_end, self.resolution, fused=self.fused)

    @property
    def how(self) -> str:
        """Method and step, or tolerance, in a few words."""
        return self.in_brief if self.tolerance is not None else f"{self.solver.name} {self.in_brief}"

    @property
    def step(self) -> str:
        """The step, or the tolerance, in a few words."""
        return f"h = {self.dt:g} s" if self.tolerance is None else f"a tolerance of {self.tolerance:g}"

    @property
    def in_brief(self) -> str:
        """The step, or the tolerance."""
        return f"with {self.step}"

    @property
    def refined_by(self) -> str:
        """The field of the case with which a run becomes more accurate."""
        return "simulation.dt" if self.tolerance is None else "simulation.tolerance"

    def step_as_json(self) -> dict[str, float | None]:
        """The step as in ``as_json``."""
        return {"dt": self.dt} if self.tolerance is None else {"dt": None, "tolerance": self.tolerance}

    def as_json(self) -> dict[str, str | float | bool | None]:
        """The settings as a block of the JSON contract; ``tolerance`` and ``fused`` appear only if they are given."""
        said: dict[str, str | float | bool | None] = {"t_end": self.t_end, "dt": self.dt, "solver": self.solver.name}
        if self.tolerance is not None:
            said |= {"tolerance": self.tolerance}
        return said if self.fused else said | {"fused": False}

    def time(self, step: Array | float) -> Array:
        """The instant of a step, or of a fraction between two steps; exact where t_end is a whole number of seconds."""
        return np.asarray(step) * self.t_end / self.steps

    @property
    def tail_start(self) -> int:
        """The step at which the tail, the last quarter of [0, t_end], begins."""
        return self.steps - self.steps // 4
