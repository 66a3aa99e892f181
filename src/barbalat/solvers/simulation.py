"""How to simulate: the method, its step, the horizon."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field

import numpy as np

from barbalat import validate
from barbalat.settings import Settings, one_line
from barbalat.solvers import RK4, SOLVERS, Tableau
from barbalat.validate import Array, InputError

MOST_RECORDED = 1_000_000
"""Points of a trajectory: 1 GB for each controller, at some 1 kB for the state of an adaptive loop and its envelope."""


@dataclass(frozen=True)
class Simulation(Settings):
    """How to simulate: fixed steps of ``dt`` [s] from 0 to ``t_end`` [s].

    t_end          horizon [s]
    dt             step [s]; it divides t_end
    solver         the method, a Tableau such as RK4
    record_points  about how many instants of a trajectory are kept; figures are over every step all the same
    fused          fused multiply-adds; without them a step takes longer, and has the same bits in exported C and in pages

    Raises InputError where dt does not divide t_end.
    """

    t_end: float
    dt: float
    _: KW_ONLY
    solver: Tableau = RK4
    record_points: int = 2000
    fused: bool = True
    steps: int = field(init=False)

    __repr__ = one_line

    def __post_init__(self) -> None:
        t_end = validate.positive("simulation.t_end", self.t_end)
        dt = validate.positive("simulation.dt", self.dt)
        validate.instance("simulation.solver", self.solver, Tableau, such_as=" or ".join(name.upper() for name in SOLVERS))
        if not isinstance(self.fused, (bool, np.bool_)):
            raise InputError.of("simulation.fused", f"must be true or false, got {validate.show(self.fused)}")
        record_points = validate.whole("simulation.record_points", self.record_points, least=2)
        ratio = t_end / dt
        if ratio > 1e12:  # a day of computing on one core: surely a slip of the pen
            raise InputError.of(
                "simulation.dt", f"= {dt:g} makes {ratio:.3g} steps up to t_end = {t_end:g}; at most 1e12 are possible"
            )
        steps = round(ratio)
        if steps < 1 or abs(steps * dt - t_end) > 1e-9 * t_end:
            nearest = t_end / max(steps, 1)
            raise InputError.of(
                "simulation.dt", f"must divide simulation.t_end, but {t_end:g} / {dt:g} = {ratio:.9g}; {nearest!r} would"
            )
        if min(steps, record_points) > MOST_RECORDED:
            raise InputError.of(
                "simulation.record_points",
                f"must be at most {MOST_RECORDED}, got {record_points}: each point of each controller "
                "takes some 1 kB of memory; figures are over every step all the same",
            )
        object.__setattr__(self, "t_end", t_end)
        object.__setattr__(self, "dt", dt)
        object.__setattr__(self, "record_points", record_points)
        object.__setattr__(self, "fused", bool(self.fused))
        object.__setattr__(self, "steps", steps)

    def as_json(self) -> dict[str, str | float | bool]:
        """The JSON contract's block for it; ``fused`` stands in it only where it is false."""
        said: dict[str, str | float | bool] = {"t_end": self.t_end, "dt": self.dt, "solver": self.solver.name}
        return said if self.fused else said | {"fused": False}

    def time(self, step: Array | float) -> Array:
        """The instant of a step, or of a fraction between two; exact where t_end is a whole number of seconds."""
        return np.asarray(step) * self.t_end / self.steps

    @property
    def tail_start(self) -> int:
        """The step at which the tail, the last quarter of [0, t_end], begins."""
        return self.steps - self.steps // 4
