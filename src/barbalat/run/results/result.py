"""The results of ``simulate`` by controller name, each with series, metrics and numerics."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat import validate
from barbalat.judge.settings import Judge
from barbalat.judge.verdict import Class, Verdict
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.true_values import estimate_names, not_the_parameters, true_values
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Assuming, BreakingSignal, Controller
from barbalat.roles import StatePart, column_names, entry_names
from barbalat.run.kernel.breaks import LostOrder
from barbalat.run.kernel.metrics import Metrics
from barbalat.run.results.accuracy import Accuracy, MeasuredError
from barbalat.run.results.adapting import Adapting, adapting, observed_along, regressor_along
from barbalat.run.results.findings import Finding, behind_the_delay, lost_when_held, of_problem, shaking
from barbalat.run.results.half_step import HalfStep
from barbalat.run.results.missed import MissedSamples
from barbalat.run.results.outcome import html_of, outcome, outcome_in_brief
from barbalat.run.results.spectrum import SolverDamping, Stiffness
from barbalat.run.results.step_comparison import FinerStep, label
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError, Named, show

if TYPE_CHECKING:
    import control
    import pandas
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from barbalat.run.engine.engine import Blocks

SERIES = ("x", "x_m", "e", "theta_hat", "u", "r", "y")
"""The signals of every result, by the names of its fields and columns."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Envelope:
    """The smallest and largest values over the steps from t[k] to t[k+1], which a decimated trajectory does not show. (K - 1,
    ...)."""

    e_min: Array
    e_max: Array
    u_min: Array
    u_max: Array
    theta_hat_min: Array
    theta_hat_max: Array
    theta_hat_path: Array  # sum of |change| over the steps

    @classmethod
    def of(cls, blocks: Blocks, intervals: int) -> Envelope:
        """The first member's extrema between the recorded instants."""
        extrema = [(quantity, side) for quantity in ("e", "u", "theta_hat") for side in ("min", "max")]
        return cls(
            **{f"{quantity}_{side}": blocks.figure(quantity, side)[:intervals, :, 0] for quantity, side in extrema},
            theta_hat_path=blocks.figure("variation", "sum")[:intervals, :, 0],
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Result:
    """One controller's run.

    t                 (K,) recorded instants [s], from 0 to t_end, or to the divergence
    x, x_m, e         (K, n) plant, model, tracking error x - x_m
    y                 (K,) measured output; None if the state is measured
    u                 (K,) control, or (K, m) with m inputs
    r                 (K,) command, or (K, q) if k_0 is a matrix
    theta_hat         (K, n) estimates
    states            (K, size) all integrated states; ``loop.unpack`` names the parts of a row
    envelope          extrema between the recorded instants
    figures           metrics over every solver step (see Metrics); ``diverged_at`` is in s, or None
    stiffness         the largest h |eigenvalue| found along the run, and the time from which the solver was unstable
    lost              the effect of jumps and corners inside steps that can't be split, including those of the trajectory; None
                      without any
    check             the result with a finer step for a run that left its region of stability, from ``check_numerics``
    judged            the verdict before the solver is checked; None for a run without a judge
    judge             the judge's settings
    finer_by          the factor by which the step must be smaller to resolve all oscillations of the run; 1 if the step of the
                      run resolves them, NaN if unknown
    finer_kind        the judge's class with such a step, from ``settle``
    half_step         the error at half the step, from ``halved``
    accuracy          for a variable-step run, its error measured by a second run
    measured_error    for a fixed-step run, its error measured by a variable-step run, from ``check_numerics``
    missed            for a sampled controller with a shell or faults, the samples that it missed, from
                      ``with_missed_samples``
    """

    problem: TrackingProblem
    controller: Controller
    simulation: Simulation
    t: Array
    x: Array
    x_m: Array
    y: Array | None
    e: Array
    u: Array
    r: Array
    theta_hat: Array
    states: Array
    envelope: Envelope
    metrics: Metrics
    stiffness: Stiffness
    lost: LostOrder | None = None
    check: FinerStep | None = None
    judged: Verdict | None = None
    judge: Judge | None = None
    finer_by: float = np.nan
    finer_kind: Class | None = None
    half_step: HalfStep | None = None
    accuracy: Accuracy | None = None
    measured_error: MeasuredError | None = None
    missed: MissedSamples | None = None

    @property
    def name(self) -> str:
        return self.controller.name

    @cached_property
    def loop(self) -> ClosedLoop:
        """The equations of the run."""
        return ClosedLoop.of(self.problem, self.controller)

    @property
    def figures(self) -> dict[str, float | list[float] | None]:
        """The metrics by name, with ``None`` where there is no finite value. This is the block for a controller in the JSON
        contract."""
        last = {f"{name}_final": value[-1] for name, value in self.reported.items()}
        more = {name: v.tolist() if np.isfinite(v).all() else None for name, v in last.items()}
        return Named.of("figure", self.metrics.of_member(0) | more)

    @cached_property
    def reported(self) -> dict[str, Array]:
        """(K, q) by name, the estimates that a scheme reports in addition to theta_hat; empty for most schemes."""
        return Named.of("reported quantity", {part.name: self.states[:, part.rows] for part in self.loop.other_estimates})

    @property
    def true_values(self) -> Array | None:
        """(p,) the values to which the estimates should converge: the parameters, or the ideal gains; None if the values are
        unknown."""
        return true_values(self.problem, self.loop)

    @property
    def diverged_at(self) -> float | None:
        """The time [s] at which the run diverged, that is, at which x, x_m or theta_hat (with output feedback y or e) exceeded
        1e12, or a state became NaN or infinite."""
        return self.metrics.end_of(0)

    @property
    def label(self) -> str | None:
        """The label of a run that left the stability region of its solver or of its sampled law; None for any other run.

        The label is "numerically unstable from t = ..." if the ``check``, with a finer step, does not show the same behaviour,
        and None if it does. Without a check the label says that this is not settled.
        """
        kind = None if self.judged is None else self.judged.kind
        return label(self.stiffness.unstable_from, self.diverged_at, kind, self.check)

    @property
    def verdict(self) -> Verdict | None:
        """The class of the run from its signals: lost, limit cycle, off or follows; None for a run without a judge.

        The verdict is settled if the run stayed inside the stability region of its solver and the damping of the solver hides no
        oscillation. It is also settled if a finer step with these properties gives the same class (see ``check_numerics`` and
        ``settle``). It is not settled if half the step gives a different class (see ``halved``).
        """
        if self.judged is None:
            return None
        settled: bool | None = True
        if self.stiffness.unstable_from is not None:
            settled = None if self.check is None else self.check.kind is self.judged.kind
        elif not self.finer_by <= 1:
            settled = None if self.finer_kind is None else self.finer_kind is self.judged.kind
        if self.half_step is not None and self.half_step.decides:
            settled = False
        shown = self.stiffness.unstable_from is not None and self.check is not None and self.check.origin == "solver"
        return replace(self.judged, settled=settled, of_the_solver=shown and settled is True)

    @property
    def damping(self) -> SolverDamping | None:
        """Numerical damping by the method that may hide oscillations of the loop; None if there is none, or outside the region of
        stability."""
        return None if self.stiffness.unstable_from is not None else self.stiffness.damping

    @property
    def numerics(self) -> str:
        """Solver, step and stiffness in one line."""
        s = self.simulation
        if s.tolerance is not None:
            return f"tolerance {s.tolerance:g}: error not measured" if self.accuracy is None else self.accuracy.sentence
        found = self.stiffness
        limit = f"{s.solver.imaginary_limit:.3g} on the imaginary axis, {s.solver.real_limit:.3g} on the real one"
        seen = f"h |lambda| up to {found.h_lambda_max:.3g} at the {validate.counted(found.looks, 'instant')} checked"
        how = "" if s.fused else ", without fused multiply-adds"
        parts = [f"{s.solver.name}, h = {s.dt:g} s{how}, {seen}; the solver's limit is {limit}"]
        if found.radius_max is not None:
            parts.append(f"the discrete-time map of the sampled law has a spectral radius of up to {found.radius_max:.4g}")
        found_beside = self.damping, self.lost, self.check, self.measured_error
        sentences = [said.sentence for said in found_beside if said is not None]
        return "; ".join([*parts, *([self.label] if self.label else []), *sentences])

    @cached_property
    def adapting(self) -> Adapting | None:
        """Excitation, path, time on the bounds, warnings; ``None`` without estimates or without two instants."""
        if self.theta_hat.shape[1] == 0 or len(self.t) < 2:
            return None
        envelope, loop = self.envelope, self.loop
        extrema = envelope.theta_hat_min, envelope.theta_hat_max
        phi = regressor_along(loop, self.states, self.x if self.y is None else self.y, self.u)
        names = estimate_names(self.problem, loop)
        found = adapting(loop, names, self.t, self.theta_hat, extrema, envelope.theta_hat_path, phi, self.true_values)
        others = not_the_parameters(self.problem, loop)
        return found if others is None else replace(found, findings=(Finding("true values", others), *found.findings))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about the numerics, the problem and this run."""
        own = self.check is None or (self.label is None and self.check.origin == "loop")  # a finer step shows the same
        outside = "; ".join(filter(None, (self.label, None if own or self.check is None else self.check.sentence)))
        settled = self.verdict is not None and self.verdict.settled
        numeric = {
            "solver": outside or self._unexamined,
            "damping": None if self.damping is None or settled else self.damping.sentence,
            "order": None if self.lost is None or self.half_step is not None else self.lost.sentence,
            "half step": None if self.half_step is None else self.half_step.sentence,
        }
        found = [Finding(kind, sentence) for kind, sentence in numeric.items() if sentence is not None]
        return (*found, *self._others)

    @property
    def _unexamined(self) -> str | None:
        """A sentence if no finer step has shown whether the plant or the solver causes the verdict."""
        if self.verdict is None or self.verdict.settled is not None or self.stiffness.unstable_from is not None:
            return None
        if np.isnan(self.finer_by):
            return None
        if np.isinf(self.finer_by):
            return "no step tried resolves every oscillation, so it is not settled whether this is due to the plant or the solver"
        finer = f"a step {self.finer_by:g} times smaller"
        return f"{finer}, which would settle whether this is due to the plant or the solver, was not tried"

    @property
    def _others(self) -> tuple[Finding, ...]:
        of_run = () if self.adapting is None else self.adapting.findings
        shakes = None if self.judge is None else shaking(self.problem, self.verdict, self.simulation.t_end, self.judge.cycle)
        missed = None if self.missed is None else self.missed.sentence
        grid = self.simulation if self.simulation.tolerance is None else self.simulation.grid
        tail = float(grid.time(grid.tail_start))
        delayed = behind_the_delay(self.problem, self.verdict, self.t, self.x_m, tail)
        said = {
            "missed": missed,
            "delayed": delayed,
            "shakes": shakes,
            "held": None if self.judge is None else lost_when_held(self.verdict),
        }
        equations = self.loop.continuous
        said["assumed"] = equations.assumed if isinstance(equations, Assuming) else None
        of_control = [Finding(kind, sentence) for kind, sentence in said.items() if sentence is not None]
        return (*of_problem(self.problem, self.simulation.t_end), *of_control, *of_run)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Findings about the problem and this run, as sentences; the findings about the numerics are in ``numerics``."""
        return tuple(finding.sentence for finding in self._others)

    def __repr__(self) -> str:
        simulation = self.simulation
        step = (
            f"{simulation.solver.name}, h = {simulation.dt:g} s"
            if simulation.tolerance is None
            else f"tolerance {simulation.tolerance:g}"
        )
        how = f"{simulation.t_end:g} s with {step}"
        return f"<Result of {self.name!r} on {self.problem.name!r}: {how}; {outcome(self)}>"

    def _repr_html_(self) -> str:
        """For notebooks: the metrics as a table, and the plot."""
        return html_of([self])

    def plot(
        self, *, panels: str | Iterable[str] | None = None, axes: Axes | Iterable[Axes] | None = None, narrow: bool = False
    ) -> Figure:
        """Trajectory, error, control and estimates as a Matplotlib figure; ``barbalat.results.plot`` describes the options."""
        from barbalat.run.results.picture import figure_of

        return figure_of([self], names=panels, axes=axes, narrow=narrow, shown=True)

    def step_info(self, component: int = 1) -> dict[str, float]:
        """Rise time, settling time, overshoot, ... after the last jump of the command (see ``step_info``)."""
        return step_info(self, component)

    @cached_property
    def controller_states(self) -> dict[str, Array]:
        """(K, ...) by name, the controller's states other than its estimates: a predictor, filters, a covariance."""
        found = {name: self.states[:, part.rows].reshape(-1, *part.shape) for name, part in self._own_parts.items()}
        return Named.of("state of the controller", found)

    @cached_property
    def _own_parts(self) -> dict[str, StatePart]:
        """The parts of the controller's state that are not estimates, by the names of their columns."""
        parts = [part for part in self.loop.parts if part.role.kind != "estimates" and part.size]
        return {name: part for part, name in column_names(parts, {"t", *SERIES, "x_observed", *self.reported}).items()}

    @cached_property
    def x_observed(self) -> Array | None:
        """(K, n) the observer's estimate of the state, which the controller uses in place of x. For a sampled controller, it is
        the estimate at the last sample. None without an observer."""
        return observed_along(self.loop, self.states, self.x)

    def columns(self) -> dict[str, Array]:
        """Scalar series by name, each (K,): x_1 ... theta_hat_1 ... u, r, then the states of the controller, such as x_hat_1 and
        P_1_1, and the estimate of an observer, x_observed_1 ..."""
        series = {name: getattr(self, name) for name in SERIES} | self.reported
        vectors = {name: value for name, value in series.items() if value is not None and value.ndim > 1}
        result = {f"{name}_{i + 1}": value[:, i] for name, value in vectors.items() for i in range(value.shape[1])}
        scalars = {name: value for name, value in series.items() if value is not None and value.ndim == 1}
        own = {
            column: self.states[:, part.start + i]
            for name, part in self._own_parts.items()
            for i, column in enumerate(entry_names(name, part.shape))
        }
        seen = () if self.x_observed is None else enumerate(self.x_observed.T)
        return Named.of("column", result | scalars | own | {f"x_observed_{i + 1}": value for i, value in seen})

    def column_meanings(self) -> dict[str, str]:
        """The meanings of the columns with states of the controller, keyed by name; docs/notation.md explains the others."""
        others = {part.name: part for part in self.loop.other_estimates}
        found = {f"{name}_{i + 1}": part.role.comment for name, part in others.items() for i in range(part.size)}
        return found | {
            column: part.role.comment for name, part in self._own_parts.items() for column in entry_names(name, part.shape)
        }

    def to_pandas(self) -> pandas.DataFrame:
        """A table with the time [s] as its index and one column for each scalar series."""
        validate.require_extra("pandas", "tables", "to_pandas")
        import pandas as pd

        return pd.DataFrame(self.columns(), index=pd.Index(self.t, name="t"))

    def to_xarray(self) -> xarray.Dataset:
        """A dataset over the coordinates t [s], component (1 ... n) and parameter (1 ... p); solver and step are attributes.

        Other states of the controller have separate dimensions: x_hat over (t, x_hat_row), P over (t, P_row, P_column).
        """
        validate.require_extra("xarray", "tables", "to_xarray")
        import xarray as xr

        second = {"theta_hat": "parameter", "u": "input", "r": "command"}
        if self.y is not None:  # plant and model have separate states
            second |= {"x": "state", "x_m": "model_state", "e": "error"}
        series = {name: getattr(self, name) for name in SERIES}
        variables: dict[str, Any] = {
            name: (("t", second.get(name, "component"))[: value.ndim], value)
            for name, value in series.items()
            if value is not None
        }
        if self.x_observed is not None:
            variables["x_observed"] = ("t", "component"), self.x_observed
        for name, value in (self.reported | self.controller_states).items():
            variables[name] = ("t", *(f"{name}_{way}" for way in ("row", "column", "layer")[: value.ndim - 1])), value
        s = self.simulation
        how = {"dt": s.dt} if s.tolerance is None else {"tolerance": s.tolerance}
        return xr.Dataset(
            variables,
            coords={
                "t": self.t,
                "component" if self.y is None else "state": np.arange(1, self.x.shape[1] + 1),
                "parameter": np.arange(1, self.theta_hat.shape[1] + 1),
            },
            attrs={"controller": self.name, "solver": s.solver.name, **how, "numerics": self.numerics},
        )

    def to_control(self) -> control.TimeResponseData:
        """The run as a time response of python-control: outputs x, states (x, x_m), inputs (r, u)."""
        validate.require_extra("control", "control", "to_control")
        import control as ct

        n = self.x.shape[1]
        numbers = range(1, n + 1)
        return ct.TimeResponseData(
            self.t,
            self.x.T,
            np.vstack([self.x.T, self.x_m.T]),
            np.vstack([self.r.T, self.u.T]),
            output_labels=[f"x_{i}" for i in numbers],
            state_labels=[*(f"x_{i}" for i in numbers), *(f"x_m_{i}" for i in numbers)],
            input_labels=[name for name in self.columns() if re.fullmatch(r"[ru](_\d+)?", name)],
            title=self.name,
        )


def step_info(result: Result, component: int = 1) -> dict[str, float]:
    """Rise time, settling time, overshoot, ... under the names of python-control, after the last jump of the command.

    component  component of x, numbered from 1; not used if y is measured

    Times [s] count from the jump; levels are values of x or y, and the last value is taken as the settled value. The resolution
    is the interval between recorded instants. Raises InputError for a run that diverged or whose command does not jump.
    """
    validate.require_extra("control", "control", "step_info")
    import control

    state = validate.whole("component", component, least=1, most=1 if result.y is not None else result.x.shape[1]) - 1
    if result.diverged_at is not None:
        raise InputError(f"step_info needs a complete run, but {result.name} diverged at t = {result.diverged_at:.4g} s")
    start = _last_jump(result)
    first = int(np.searchsorted(result.t, start))
    value = (result.x[:, state] if result.y is None else result.y)[first:]
    if len(value) < 2 or value[-1] == value[0]:
        raise InputError(f"step_info needs a response to the command's jump at t = {start:.4g} s, but there is none")
    found = control.step_info(value - value[0], T=result.t[first:] - result.t[first], yfinal=value[-1] - value[0])
    levels = ("SettlingMin", "SettlingMax", "SteadyStateValue")
    info = {name: float(number + value[0] if name in levels else number) for name, number in found.items()}
    peak = {"Peak": float(value[np.argmax(np.abs(value - value[0]))])}  # python-control's value is a distance without a sign
    return validate.Named.of("figure", info | peak)


def _last_jump(result: Result) -> float:
    """The time of the last jump of a command [s]; 0 if the command is nonzero from the start."""
    jumps = [0.0] if any(float(command(np.zeros(1))[0]) != 0 for command in result.problem.commands) else []
    for command in result.problem.commands:
        if isinstance(command, BreakingSignal):
            at = command.breaks(0.0, result.simulation.t_end)
            jumps += at[command(at) != command.before(at)].tolist()
    if not jumps:
        raise InputError("step_info needs a command that jumps, such as Step(1.0)")
    return max(jumps)


class Results(Named[Result]):
    """The runs of one problem by controller name: a dictionary that is readable at a prompt and can be plotted."""

    kind = "controller"

    def __repr__(self) -> str:
        return f"<Results: {'; '.join(f'{name!r} {outcome_in_brief(result)}' for name, result in self.items())}>"

    def _repr_html_(self) -> str:
        """For notebooks: the metrics as a table, the findings, and the plot."""
        return html_of(list(self.values()))

    def plot(
        self, *, panels: str | Iterable[str] | None = None, axes: Axes | Iterable[Axes] | None = None, narrow: bool = False
    ) -> Figure:
        """All runs in common panels, as a Matplotlib figure; ``barbalat.results.plot`` describes the options."""
        return plot(self, panels=panels, axes=axes, narrow=narrow)


def plot(
    results: Result | Mapping[str, Result] | Iterable[Result],
    *,
    panels: str | Iterable[str] | None = None,
    axes: Axes | Iterable[Axes] | None = None,
    narrow: bool = False,
) -> Figure:
    """Draw runs of one problem, from one or several calls of ``simulate``, in common panels of a Matplotlib figure.

    panels  names of the panels to draw: motion, x_1 ... or y, largest error, control, error, estimates, or the name of a
            controller or a state; all by default
    axes    Matplotlib axes to draw into, one for each of the panels; a new figure by default
    narrow  whether to stack the panels, for a phone or a column of a page

    Raises InputError for an unknown panel, and if the numbers of axes and panels differ.
    """
    from barbalat.run.results.picture import figure_of

    return figure_of(_listed(results), names=panels, axes=axes, narrow=narrow, shown=True)


def _listed(results: Result | Mapping[str, Result] | Iterable[Result]) -> list[Result]:
    given = [results] if isinstance(results, Result) else results
    found = list(given.values() if isinstance(given, Mapping) else given)
    for one in found:
        if not isinstance(one, Result):
            raise InputError(f"plot needs results of simulate, got {show(one)}")
    if not found:
        raise InputError("plot needs at least one result, got none")
    return found
