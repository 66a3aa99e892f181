"""The spectrum at instants of a run, which shows whether the run stays inside the stability region of the solver, and the damping
of the method.

Source: docs/numerics.md.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import continuous_twin, jacobian_function, sampled_jacobian_function
from barbalat.protocols import DiscretizedEquations
from barbalat.solvers import Tableau
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

if TYPE_CHECKING:
    import casadi as ca

RESOLVED_TURN = 1.0
"""Largest h omega [rad] that causes no remark. It means six steps per period, with which RK4 damps by 0.6 % per radian, and Heun
and Euler amplify."""


@dataclass(frozen=True)
class SolverDamping:
    """The method's damping of an oscillation of the loop that the step does not resolve and that the equations may not damp.

    per_radian  the fraction of an undamped oscillation's amplitude that the method removes per radian, at the worst instant
    h_omega     the step times the frequency there [rad]
    solver      the method's name
    """

    per_radian: float
    h_omega: float
    solver: str

    @property
    def sentence(self) -> str:
        """The finding as a sentence."""
        return (
            f"{self.solver} at this step adds damping of up to {100 * self.per_radian:.2g} % per radian to an oscillation as "
            f"fast as the loop's (h omega = {self.h_omega:.3g}). A finer step may show more of that oscillation"
        )

    def as_json(self) -> dict[str, Any]:
        return asdict(self) | {"sentence": self.sentence}


def damping_of(solver: Tableau, h_omega: Array) -> Array:
    """1 - |R(i h omega)|^(1/(h omega)), for h omega > 0 of any shape; below 0 if the method amplifies."""
    growth = solver.growth(1j * h_omega)  # |R|^2 - 1
    with np.errstate(divide="ignore"):  # R may vanish: complete damping
        return np.asarray(-np.expm1(np.log1p(np.maximum(growth, -1.0)) / (2 * h_omega)))


def worst_damping(solver: Tableau, z: Array) -> SolverDamping | None:
    """The strongest damping of modes h lambda, of any shape, that oscillate, |Im| >= |Re|, and that the step does not resolve."""
    h_omega = np.abs(z.imag)
    h_omega = h_omega[(h_omega > RESOLVED_TURN) & (h_omega >= np.abs(z.real)) & np.isfinite(h_omega)]
    if len(h_omega) == 0:
        return None
    damped = damping_of(solver, h_omega)
    worst = int(damped.argmax())
    if damped[worst] <= 0:
        return None
    return SolverDamping(float(damped[worst]), float(h_omega[worst]), solver.name)


@dataclass(frozen=True)
class Stiffness:
    """Whether a run stayed inside its solver's region of stability, and for how long.

    h_lambda_max   the largest h |eigenvalue| of the exact Jacobian at the examined instants; NaN if no instant was examined
    unstable_from  the first step [s] at which the solver, or a law sampled by Euler steps, amplified a mode that the equations
                   don't; None if none was found
    looks          number of instants at which the spectrum was computed
    damping        the method's damping of an oscillation at these instants; None if it hides nothing
    radius_max     for a law sampled by Euler steps, the largest spectral radius of its discrete-time map; otherwise None
    """

    h_lambda_max: float
    unstable_from: float | None
    looks: int
    radius_max: float | None = None
    damping: SolverDamping | None = None


class Looks(NamedTuple):
    """The results at K instants, each (K,)."""

    h_lambda: Array  # the largest h |eigenvalue|; infinite if the Jacobian is not finite
    outside: Array  # whether the method amplifies a mode that the equations don't amplify
    radius: Array | None  # spectral radius of the discrete-time map; infinite if the map is not finite
    damping: SolverDamping | None  # the strongest one

    def stiffness(self, unstable_from: float | None) -> Stiffness:
        """The maxima over all instants."""
        radii = None if self.radius is None else self.radius[np.isfinite(self.radius)]
        return Stiffness(
            h_lambda_max=float(self.h_lambda[np.isfinite(self.h_lambda)].max(initial=0.0)),
            unstable_from=unstable_from,
            looks=len(self.h_lambda),
            radius_max=None if radii is None or not len(radii) else float(radii.max()),
            damping=self.damping,
        )


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The frozen linear system of a loop at instants of its run.

    A mode is amplified by the solver alone when |R(h lambda)| exceeds max(1, |e^(h lambda)|). The mode counts if this growth
    would reach a factor of e over the whole run. A fixed threshold would also count the harmless growth of slow modes with
    Euler's method.
    """

    loop: ClosedLoop
    simulation: Simulation
    jacobian: ca.Function
    law: FrozenSampledLaw | None

    @classmethod
    def of(cls, loop: ClosedLoop, simulation: Simulation) -> Spectrum:
        equations, law = loop.equations, None
        if isinstance(equations, DiscretizedEquations) and equations.explicit:
            law = FrozenSampledLaw.of(loop, simulation, equations.sample_time)
        return cls(loop, simulation, jacobian_function(loop.following_within(simulation.dt)), law)

    def at(self, states: Array, signals: Array) -> Looks:
        """states (K, size), signals (K, channels)."""
        matrices = evaluated(self.jacobian, states, signals)
        finite = np.isfinite(matrices).all(axis=(1, 2))  # matrices that overflow count as being far outside
        h_lambda, outside = np.full(len(states), np.inf), ~finite
        z = self.simulation.dt * _eigenvalues(matrices[finite])
        with np.errstate(divide="ignore"):  # R may vanish, which means no growth at all
            spurious = np.log(np.abs(self.simulation.solver.amplification(z))) - np.maximum(z.real, 0)
        h_lambda[finite] = np.abs(z).max(axis=1, initial=0.0)
        outside[finite] = (spurious * self.simulation.steps > 1).any(axis=1)
        damping = worst_damping(self.simulation.solver, z)
        if self.law is None:
            return Looks(h_lambda, outside, None, damping)
        radius = np.full(len(states), np.inf)
        radius[finite], amplified = self.law.at(states[finite], signals[finite], matrices[finite])
        outside[finite] |= amplified
        return Looks(h_lambda, outside, radius, damping)

    def coupling(self, states: Array, signals: Array) -> Array:
        """(K,) the value of ``coupling_function``, including constant terms, for loops that are too large to be monitored."""
        found = []
        for state, given in zip(states, signals, strict=True):  # one matrix at a time: a thousand states make 8 MB
            (J,) = evaluated(self.jacobian, state[None], given[None])
            own = np.sum(np.diag(J) ** 2)
            found.append(own + abs(np.sum(J * J.T) - own))
        return np.nan_to_num(np.array(found), nan=np.inf)


def _eigenvalues(matrices: Array) -> Array:
    """Eigenvalues (K, size), computed one matrix after another, so that Ctrl-C is handled in between."""
    return np.array([np.linalg.eigvals(matrix) for matrix in matrices]) if len(matrices) else np.linalg.eigvals(matrices)


@dataclass(frozen=True, eq=False)
class FrozenSampledLaw:
    """The frozen discrete-time map of a law that takes Euler steps: the flow of the plant followed by the action of the
    controller.

    The law counts as unstable if its amplification over the whole run exceeds the fastest growth of the continuous equations by a
    factor of e.
    """

    sample: ca.Function  # Jacobian of the controller's action
    twin: ca.Function  # Jacobian of the continuous loop
    sample_time: float
    samples: float  # in the whole run

    @classmethod
    def of(cls, loop: ClosedLoop, simulation: Simulation, sample_time: float) -> FrozenSampledLaw:
        twin = jacobian_function(continuous_twin(loop).following_within(simulation.dt))
        return cls(sampled_jacobian_function(loop), twin, sample_time, simulation.t_end / sample_time)

    def at(self, states: Array, signals: Array, flow: Array) -> tuple[Array, Array]:
        """Return the spectral radii (K,) and whether they are too large; ``flow`` contains the Jacobians of the loop between two
        samples."""
        from scipy.linalg import expm

        different, which = _different(flow)
        T, size = self.sample_time, self.twin.size1_out(0)
        with np.errstate(all="ignore"):  # e^(T A) may overflow
            maps = evaluated(self.sample, states, signals) @ expm(T * different)[which]
        twins = evaluated(self.twin, states[:, :size], signals)
        # a matrix that overflows is taken to amplify too much
        finite = np.isfinite(maps).all(axis=(1, 2)) & np.isfinite(twins).all(axis=(1, 2))
        radius, amplified = np.full(len(states), np.inf), ~finite
        radius[finite] = np.abs(np.linalg.eigvals(maps[finite])).max(axis=1, initial=0.0)
        growth = np.linalg.eigvals(twins[finite]).real.max(axis=1, initial=0.0)
        with np.errstate(divide="ignore"):
            amplified[finite] = (np.log(radius[finite]) - T * growth) * self.samples > 1
        return radius, amplified


def _different(matrices: Array) -> tuple[Array, Array]:
    """The distinct matrices among (K, size, size), and the index of each; the single matrix of a linear plant is found without
    sorting."""
    if len(matrices) and (matrices == matrices[0]).all():
        return matrices[:1], np.zeros(len(matrices), dtype=int)
    found, which = np.unique(matrices, axis=0, return_inverse=True)
    return found, which.reshape(-1)


def evaluated(function: ca.Function, states: Array, signals: Array) -> Array:
    """Matrices (K, size, size) of a CasADi function at K instants."""
    size = function.size1_out(0)
    if len(states) == 0:  # CasADi interprets an empty argument as one column
        return np.zeros((0, size, size))
    flat = np.asarray(function(states.T, signals.T))
    return flat.reshape(size, len(states), size).transpose(1, 0, 2)
