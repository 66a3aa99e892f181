"""Tunes the controllers of a case: the search, the choice, which is evaluated completely, the front and the validation plants."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from barbalat import budget, validate
from barbalat.budget import Estimate, Progress, part_of
from barbalat.cases.build import Case
from barbalat.cases.load import CaseText
from barbalat.certificates.certify import certify
from barbalat.comparison.grids import output_reach_of, reach_of
from barbalat.comparison.plants import drawn_values, require_delays
from barbalat.comparison.ranges import Range, Space, of_knobs
from barbalat.comparison.search.aim import DEFAULT_PLANTS, Aim, Plants
from barbalat.comparison.search.quantity import LINEAR_DELAYS, LINEAR_SENTENCE, OF_A_LINEAR_LOOP, Origin
from barbalat.comparison.search.search import least_trials, search
from barbalat.comparison.search.trials import Trials, in_one_kernel
from barbalat.comparison.starts import different_starts
from barbalat.comparison.tune.result import Tuned, Tuning, choose
from barbalat.controllers import Sampled
from barbalat.controllers.tuning_grid import OutputTunable, Tunable, TuningGrid
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers.path import FieldPath, by_index
from barbalat.open_numbers.varied import Varied, VariedCase, VariedObjects, tables_with
from barbalat.problem.modelling_error import DelayError
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel.costs import of_members, steps_of
from barbalat.solvers.simulation import Simulation
from barbalat.study.finer_step import finer
from barbalat.study.ideal_benchmark import NOISE_SENTENCE, SHORTEST_DELAY_STEPS
from barbalat.study.resolved import resolved
from barbalat.study.simulated_margins import half_sentence, less_than_half
from barbalat.validate import Array, InputError, Named

DEFAULT_TRIALS = 384
"""Number of tunings tried for each controller: a spread of 128, a generation over the whole space, four around the best tuning,
and three stars."""
SEARCH_SHARE = 0.75
"""The search takes approximately this fraction of the time for a controller. The front and the new plants take the rest."""


def tune(
    case: str | Path | Case,
    objective: str,
    *,
    maximize: bool = False,
    subject_to: Sequence[str] = (),
    vary: Mapping[str, str | Range] | None = None,
    controller: str | None = None,
    plants: int = DEFAULT_PLANTS,
    quantile: float = 1.0,
    trials: int | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Find the settings of each controller that minimise or maximise one quantity under constraints.

    case        a case file, the name of a bundled case, or a ``Case``, to whose fields ``vary`` then refers
    objective   a metric of a run, such as "rms_e", a key of a certificate, or "delay_margin_simulated"
    subject_to  such as "delay_margin_measured >= 0.02", "condition < 1", "delay_margin >= 0.01", "max_abs_u < 400"
    vary        "START:STOP" or "START:STOP:log" by path; by default the knobs of each scheme that the case contains
    controller  the name of the controller to tune; by default all
    plants      number of plants: the plant of the case and others from its known set
    quantile    quantile over the plants; 1 for the worst plant
    trials      number of tunings tried for each controller, by default 384; with more than three numbers 576, which is then the
                smallest number allowed
    seed        seed of the plants and of the search; the same seed gives the same result

    Raises InputError.
    """
    text = None if isinstance(case, Case) else CaseText.read(case)
    whole = text.case() if text is not None else case
    assert isinstance(whole, Case)
    labels = whole.problem.labels
    aim = Aim.of(objective, subject_to, maximize=maximize, plants=plants, quantile=quantile, seed=seed, labels=labels)
    paths = {place: FieldPath.parse(by_index(place, labels)) for place in vary or {}}
    spaces = {paths[place]: one if isinstance(one, Range) else Range.parse(one) for place, one in (vary or {}).items()}
    return tune_case(
        Tuner(text, whole, aim, trials, threads), Space(spaces) if spaces else None, controller=controller, progress=progress
    )


@dataclass(frozen=True, eq=False)
class Tuner:
    """A case, with its text if it comes from a file, and the aim of its tuning."""

    text: CaseText | None
    case: Case
    aim: Aim
    trials: int | None = None
    threads: int | None = None

    def varied(self, paths: tuple[FieldPath, ...]) -> Varied:
        if self.text is None:
            return VariedObjects(self.case, paths)
        tables, simulation = tables_with(self.text, paths), self.case.simulation
        if simulation.tolerance is not None:
            tables |= {"simulation": {**tables["simulation"], "record_points": simulation.record_points}}
        return VariedCase(self.text, paths, tables)

    def space_of(self, controller: int) -> Space:
        """Return the ranges of the scheme's knobs. Raises InputError if the scheme has none."""
        settings = self.case.controllers[controller]
        scheme = settings.controller if isinstance(settings, Sampled) else settings
        problem = self.case.problem
        knobs = None if self.text is None else _knobs_of(scheme, problem, self.case.simulation)
        if self.text is None or knobs is None:
            raise InputError(
                f"the tunable settings of {settings.name} are not declared: give --vary controller[{controller}].KEY="
                "START:STOP[:log]"
            )
        tables = self.text.data()["controller"]
        if controller >= len(tables):
            raise InputError(f"{settings.name} is not in the case file, so its settings cannot be tuned there")
        return of_knobs(knobs, tables[controller], controller)

    def count(self, space: Space) -> int:
        """Return the number of tunings to try for a controller. Raises InputError if there are too few."""
        least = least_trials(len(space))
        return max(DEFAULT_TRIALS, least) if self.trials is None else validate.whole("trials", self.trials, least=least)

    def tuned(self, controller: int, space: Space, progress: Progress | None) -> Tuned:
        """Search the tuning of one controller."""
        count = self.count(space)
        trials, start = self._trials(controller, space), self._start(space)
        own = trials.whole(np.zeros(0) if start is None else start, self.case)  # rejects cases that cannot be evaluated
        shares = None if start is None else space.shares(start)
        part = part_of(progress, 0, SEARCH_SHARE)
        search(trials.scoring(space), len(space), trials=count, seed=self.aim.seed, start=shares, progress=part)
        return choose(trials, space, own, part_of(progress, SEARCH_SHARE, 1 - SEARCH_SHARE))

    def _trials(self, controller: int, space: Space) -> Trials:
        varied = self.varied(space.paths)
        own = all(path.keys[0] == "controller" for path in space.paths)
        return Trials(
            varied,
            controller,
            self.aim,
            together=in_one_kernel(varied, space),
            shared=Plants.of(self.case, self.aim) if own else None,
            threads=self.threads,
        )

    def _start(self, space: Space) -> Array | None:
        """Return the tuning in the case (d,); None if one of its values is a default that the case does not state."""
        if self.text is None:
            return None
        found = [path.of(self.text.data()) for path in space.paths]
        if any(not isinstance(one, (int, float)) for one in found):
            return None
        return np.array(found, dtype=float)


def _knobs_of(scheme: Controller, problem: TrackingProblem, simulation: Simulation) -> TuningGrid | None:
    """Return the tuned settings that the scheme declares for such a problem; None if it declares none."""
    if isinstance(problem, OutputProblem) and isinstance(scheme, OutputTunable):
        return scheme.output_knobs(output_reach_of(problem, simulation))
    if isinstance(problem, Problem) and isinstance(scheme, Tunable):
        return scheme.knobs(reach_of(problem, simulation)[0])
    return None


def tune_case(tuner: Tuner, space: Space | None, *, controller: str | None, progress: Progress | None) -> Tuning:
    """Tune all requested controllers, one after another."""
    started = time.perf_counter()
    own = tuner.case.simulation
    if space is not None and own.tolerance is not None and any(path.keys[0] == "simulation" for path in space.paths):
        raise InputError("numbers of the simulation cannot be tuned together with simulation.tolerance: give simulation.dt")
    simulation = resolved(tuner.case.problem, tuner.case.controllers, own)
    tuner = replace(tuner, case=replace(tuner.case, simulation=simulation))
    _require_steps(tuner.aim, tuner.case)
    spaces, left_out = _spaces(tuner, space, controller)
    _require_known(tuner, list(spaces))
    _require_budget(tuner, spaces)
    require_delays([*tuner.aim.family(tuner.case), *tuner.aim.unseen(tuner.case.problem)], tuner.case.simulation)
    found: dict[str, Tuned] = {}
    for i, (which, one) in enumerate(spaces.items()):
        part = part_of(progress, i / len(spaces), 1 / len(spaces))
        found[tuner.case.controllers[which].name] = tuner.tuned(which, one, part)
    numbers = {path: value for one in found.values() if one.chosen for path, value in one.chosen.tuning.items()}
    text = None if tuner.text is None else with_numbers(tuner.text.text, numbers)
    case = tuner.varied(tuple(numbers)).at(list(numbers.values()))
    family = tuner.aim.family(tuner.case)
    thetas = [problem.true_parameters for problem in family]
    return Tuning(
        aim=tuner.aim,
        case=case if own.tolerance is None else replace(case, simulation=own),
        text=text,
        plants=len(family),
        thetas=np.array([theta for theta in thetas if theta is not None]),
        drawn=drawn_values(family),
        controllers=Named.of("controller", found),
        notes=(*left_out, *_notes(tuner, found)),
        seconds=time.perf_counter() - started,
    )


def _spaces(tuner: Tuner, space: Space | None, controller: str | None) -> tuple[dict[int, Space], list[str]]:
    """Return the ranges for each tuned controller, by its index, and sentences on the omitted controllers."""
    names = [one.name for one in tuner.case.controllers]
    if controller is not None and controller not in names:
        raise InputError(f"--controller must be a controller of the case ({', '.join(names)}), got {validate.show(controller)}")
    chosen = range(len(names)) if controller is None else [names.index(controller)]
    if space is None:
        return _own_spaces(tuner, chosen)
    places = {path.keys[1] if path.keys[0] == "controller" and len(path.keys) > 1 else None for path in space.paths}
    own = {place for place in places if isinstance(place, int)}
    if controller is None and None in places and len(names) > 1 and len(own) != 1:
        raise InputError(
            f"use --controller to select the controller to tune ({', '.join(names)}): --vary names parameters of several "
            f"controllers"
        )
    if None in places or controller is not None:
        which = names.index(controller) if controller is not None else next(iter(own), 0)
        return {which: space}, []
    parts = {which: Space({path: one for path, one in space.ranges.items() if path.keys[1] == which}) for which in sorted(own)}
    return parts, []


def _own_spaces(tuner: Tuner, chosen: Sequence[int]) -> tuple[dict[int, Space], list[str]]:
    """Return the knobs of each controller that has some, and the omitted controllers. Raises InputError if no controller has
    knobs."""
    found, left_out = dict[int, Space](), list[str]()
    for which in chosen:
        try:
            found[which] = tuner.space_of(which)
        except InputError as error:
            if not found and which == chosen[-1]:
                raise
            left_out.append(f"{tuner.case.controllers[which].name} is omitted: {error}")
    return found, left_out


RUNS_EACH_TRIAL = 5
"""Number of runs per plant: one without a delay and several with delays."""
PLANT = Estimate(memory=20e3, seconds=2e-3)
"""Seconds for a random plant, including the runs of its model and its ideal loop."""
CERTIFYING_SECONDS = 0.1
"""Seconds for a certificate's keys, for each trial and plant."""


def _require_budget(tuner: Tuner, spaces: Mapping[int, Space]) -> None:
    """Raise InputError if the plants, or the trials on them, exceed the budget."""
    case, plants = tuner.case, tuner.aim.plants
    loops = [ClosedLoop.of(case.problem, case.controllers[which]) for which in spaces]
    certified = CERTIFYING_SECONDS * len(loops) if tuner.aim.asks(Origin.CERTIFICATE) else 0.0

    def cost(trials: float, count: float) -> Estimate:
        runs = of_members(loops, steps_of(case.simulation), trials * count * RUNS_EACH_TRIAL)
        return PLANT.times(count) + Estimate(seconds=runs.seconds + certified * trials * count)

    counts = [tuner.count(space) for space in spaces.values()]
    least = max(least_trials(len(space)) for space in spaces.values())
    budget.require("plants", plants, lambda n: cost(least, n))
    budget.require("trials", max(counts), lambda n: cost(n, plants), least=least, what="tuning")


def _require_steps(aim: Aim, case: Case) -> None:
    shortest = SHORTEST_DELAY_STEPS * case.simulation.resolution
    steps = "two steps, " * (case.simulation.tolerance is None)
    for one in aim.constraints:
        if DelayError() in one.quantity.errors and one.requirement.limit < shortest:
            raise InputError(
                f"the delay in {one.requirement} is shorter than the shortest that can be simulated, {steps}{shortest:g} s"
            )


def _require_known(tuner: Tuner, controllers: Sequence[int]) -> None:
    """Raise InputError if a key is in no certificate of the tuned controllers."""
    asked = [one for one in tuner.aim.quantities if one.origin is Origin.CERTIFICATE]
    if not asked:
        return
    chosen = [tuner.case.controllers[which] for which in controllers]
    certificates = certify(tuner.case.problem, chosen, tuner.case.simulation)
    for one in asked:
        one.require_known(certificates)


def _notes(tuner: Tuner, found: Mapping[str, Tuned]) -> tuple[str, ...]:
    """Return sentences on the limitations of the result."""
    said, own = [], "the step" if tuner.case.simulation.tolerance is None else "the tolerance"
    if len(tuner.aim.family(tuner.case)) < tuner.aim.plants:
        said.append("only the plant of the case was used: it has no known set from which other values of theta could be drawn")
    for name, one in found.items():
        if one.chosen is None:
            said.append(f"{name}: {_unmet(tuner, one)}; the case file keeps its original values")
        elif one.refused:
            said.append(
                f"{name}: {len(one.refused)} better tunings meet every constraint only at {own} of the case: "
                f"{'; '.join(one.refused[0].broken)}"
            )
        said += [f"{name}: {sentence}" for sentence in ([] if one.step is None else one.step.sentences)]
    problem, aim = tuner.case.problem, tuner.aim
    for name, one in found.items():
        said += [f"{name}: {sentence}" for sentence in _compared_with_linear(one)]
    if isinstance(problem, Problem):
        said += different_starts(problem, [one for one in tuner.case.controllers if one.name in found])
    if aim.asks(Origin.PROBE) and tuner.case.problem.noise is not None:
        said.append(NOISE_SENTENCE)
    said += [LINEAR_SENTENCE.format(key=one.name) for one in aim.quantities if one.key in OF_A_LINEAR_LOOP]
    return tuple(said)


def _unmet(tuner: Tuner, one: Tuned) -> str:
    """Return why no tuning was chosen: a constraint, or a plant that cannot be controlled by any tuning."""
    tunings, plants = validate.counted(one.trials, "tuning"), len(tuner.aim.family(tuner.case))
    if one.nearest.value is not None and np.isfinite(one.nearest.value):
        return f"none of {tunings} meets every constraint{f' at {finer(tuner.case.simulation)} as well' if one.refused else ''}"
    if plants == 1:
        return f"the run diverges with each of {tunings}"
    return (
        f"each of {tunings} diverges on at least one of the {plants} plants, which are the plant of the case and others from "
        f"its known set. A smaller known set may help; --plants 1 uses only the plant of the case"
    )


def _compared_with_linear(one: Tuned) -> list[str]:
    """Return the finding if the requested linear delay margin is more than twice what the case tolerates."""
    point, measured = one.chosen or one.nearest, one.delay_margin_measured
    if measured is None:
        return []
    linear = {asked.quantity.name: value for asked, value in point.found.items() if asked.quantity.key in LINEAR_DELAYS}
    larger = [f"{key}, {value:.3g} s" for key, value in linear.items() if value is not None and less_than_half(measured, value)]
    return [half_sentence(f"delay margin, {measured:.3g} s on the worst of the plants", larger)] if larger else []


def with_numbers(text: str, numbers: Mapping[FieldPath, float]) -> str:
    """Return the TOML text with some numbers replaced."""
    import tomlkit

    document = tomlkit.parse(text)
    for path, value in numbers.items():
        path.put(document, value)
    return tomlkit.dumps(document)
