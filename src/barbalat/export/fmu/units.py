"""The contents of each unit: its variables, and the C between them and the exported controller and plant."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from barbalat.export.acceptance import Entry, placed
from barbalat.export.fmu.variables import Variable, Variables, array, entries, parameters, require_distinct
from barbalat.export.layout import StatePart
from barbalat.export.log import of_the_channels
from barbalat.export.parameters import Parameter
from barbalat.export.plant_source import PrintedPlant
from barbalat.export.texts import Printed, command_units
from barbalat.lowering.c99 import DOUBLE
from barbalat.problem.labels import Labels
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem

FREEZE = Variable("freeze", "input", "discrete", "true: the estimates keep their values", 0.0, kind="truth")
STATUS = Variable("status", "output", "discrete", "0: the last sample was accepted; otherwise as in controller.h", kind="whole")


@dataclass(frozen=True, eq=False)
class Unit:
    """An FMU of a closed loop: the controller, the plant, or the loop of both."""

    printed: Printed
    controller: bool
    made: PrintedPlant | None

    @property
    def identifier(self) -> str:
        """The name of its files."""
        return self.printed.name + ("" if self.made is None else "_loop" if self.controller else "_plant")

    @property
    def title(self) -> str:
        """The unit's display name."""
        what = "controller" if self.made is None else "closed loop" if self.controller else "plant"
        return f"{self.printed.contents.controller.name}, {what}"

    @property
    def step_size(self) -> float:
        """The time [s] of which a communication step is a whole multiple."""
        if self.controller or self.made is None:
            return self.printed.contents.sample_time
        return self.made.plant.opened.members.simulation.dt

    @property
    def scalar_output(self) -> bool:
        return not self.printed.contents.measures_state

    @cached_property
    def variables(self) -> Variables:
        """The variables, in the order of their value references."""
        found = self._inputs() + self._outputs()
        wanted: dict[Parameter, bool] = {}
        if self.controller:
            contents = self.printed.contents
            wanted |= {one: one in contents.starts.values() for one in contents.parameters}
        if self.made is not None:
            plant = self.made.plant
            starts = [plant.start(row) for row in plant.rows]
            wanted |= {one: one in starts or wanted.get(one, False) for one in plant.parameters}
        opened = self.printed.contents.opened
        assert opened is not None
        labels = self.printed.contents.problem.labels
        units = () if labels is None else labels.input_units
        found += parameters(wanted, [one for one, fixed in wanted.items() if fixed], opened, units)
        if self.controller:
            found += self._states()
        if self.made is not None:
            found += array("plant.x", "local", "continuous", "state of the plant, without the sensor", [None] * self._order)
        found = [self._state_of_plant(one) for one in self._labelled(found)]
        return require_distinct(Variables(tuple(found), (FREEZE, STATUS) if self.controller else ()))

    def _state_of_plant(self, one: Variable) -> Variable:
        """A state of the plant or its initial value, with the label and unit of the case if the labels name these states."""
        problem = self.printed.contents.problem
        which = re.fullmatch(r"plant\.(x0?)\[(\d+)\]", one.name)
        if which is None:
            return one
        initial, i = which[1] == "x0", int(which[2]) - (which[1] == "x")
        meaning = "initial state" if initial else one.meaning
        same = initial or (self._order == problem.measured and not _has_other_states(problem))
        own = self.printed.measured == "x" and same and i < problem.measured  # a baseline's integral has no label
        return _with_label(replace(one, meaning=meaning), problem.measured_labels if own else None, i)

    def _labelled(self, found: list[Variable]) -> list[Variable]:
        """The measurements under the labels of the case, with underscores for characters that are not allowed in names.

        A channel whose label yields no unique name keeps ``x[1]``. The description contains the label and ``x[1]``.
        """
        labels = self.printed.contents.problem.measured_labels
        names = () if labels is None else labels.names
        if not names:
            return found
        own = entries(self.printed.measured, len(names), scalar=self.scalar_output)
        taken = {re.split(r"[.\[]", one.name)[0] for one in found if one.name not in own} | {FREEZE.name, STATUS.name, "time"}
        plain = [re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") for name in names]
        for old, new, label in zip(own, plain, names, strict=True):
            if not re.fullmatch(r"[A-Za-z_]\w*", new, re.ASCII) or new in taken or plain.count(new) > 1:
                continue
            i = [one.name for one in found].index(old)
            meaning = f"{found[i].meaning} {old}" + (f", {label}" if label != new else "")
            found[i] = replace(found[i], name=new, meaning=meaning, path=old)
        return found

    @property
    def _order(self) -> int:
        assert self.made is not None
        return int(self.made.plant.problem.dynamics.x0.size)

    def _inputs(self) -> list[Variable]:
        contents, found = self.printed.contents, []
        vectors = contents.vectors
        if self.made is None:
            found += self._measured("input", vectors.measured[0].tolist())
        if self.controller:
            q = contents.sizes[1]
            found += array(
                "r",
                "input",
                "discrete",
                "command",
                vectors.commands[0].tolist(),
                scalar=q == 1,
                units=command_units(contents.problem),
            )
        else:
            found += self._of_inputs("u", "input", "control", [0.0] * contents.sizes[2])
        if self.made is not None:
            plant = self.made.plant
            found += array("disturbance", "input", "continuous", "held over a communication step", [0.0] * plant.disturbances)
            found += array(
                "noise", "input", "discrete", "standard Gaussian number of the sensor", [0.0] * plant.loop.signals.noise
            )
        return found

    def _outputs(self) -> list[Variable]:
        contents, found = self.printed.contents, []
        if self.controller:
            m, p = contents.sizes[2:]
            found += self._of_inputs("u", "output", "control before the limits, as simulated", [None] * m)
            found += self._of_inputs("u_limited", "output", "control within the limits", [None] * m)
            found += array("theta_hat", "output", "discrete", "estimates", [None] * p)
        if self.made is not None:
            found += self._measured("output", [None] * self.made.plant.outputs)
        return found

    def _measured(self, causality: str, starts: Iterable[float | None]) -> list[Variable]:
        labels = self.printed.contents.problem.measured_labels
        name, scalar = self.printed.measured, self.scalar_output
        text = "measured output" if name == "y" else "measured state"
        variability = "discrete" if self.controller else "continuous"
        return array(name, causality, variability, text, starts, scalar=scalar, units=() if labels is None else labels.units)

    def _of_inputs(self, name: str, causality: str, text: str, starts: list[float | None]) -> list[Variable]:
        """A variable for each input."""
        labels = self.printed.contents.problem.labels
        variability = "discrete" if self.controller else "continuous"
        units = () if labels is None else labels.input_units
        return array(name, causality, variability, text, starts, scalar=len(starts) == 1, units=units)

    def _states(self) -> list[Variable]:
        """The controller's state, except parts that are already outputs."""
        found = []
        labels = self.printed.contents.problem.measured_labels
        for part in self._kept:
            made = array(f"state.{part.name}", "local", "discrete", part.meaning, [None] * part.size)
            own = labels if of_the_channels(self.printed, part) else None
            found += [_with_label(one, own, i) for i, one in enumerate(made)]
        return found

    @property
    def _kept(self) -> list[StatePart]:
        layout = self.printed.contents.layout
        return [part for part in layout.parts if part not in (layout.u, layout.theta_hat, layout.started)]

    def refusals(self) -> list[str]:
        """C text that checks parameters against their bounds and against each other."""
        opened, contents = self.printed.contents.opened, self.printed.contents
        assert opened is not None
        here = {one.name for one in self.variables.reals if one.causality == "parameter"}
        every = opened.parameters

        def text(entry: Entry) -> str:
            return self._at(every[entry].name) if isinstance(entry, int) else repr(entry)

        def name(entry: Entry) -> str:
            return every[entry].name if isinstance(entry, int) else f"{entry:g}"

        conditions = placed(opened.conditions, lambda k: k if every[k].name in here else every[k].value)
        tests = [(one.as_c(text, DOUBLE), one.in_words(name)) for one in conditions]
        most = contents.parameter_range
        for one in contents.parameters if self.controller else ():
            tests.append((f"fabs({self._at(one.name)}) <= {most!r}", f"{one.name} must be at most {most:g} in size"))
        return [f'if (!({test})) {{ return "{text}"; }}' for test, text in tests] or ["(void)m;"]

    def start(self) -> list[str]:
        """C text that computes the initial state from the variables."""
        name, lines = self.printed.name, []
        if self.controller:
            contents = self.printed.contents
            lines += [f"{name}_init(&m->controller);", *self._load_controller(), f"{name}_reset(&m->controller);"]
            both = [f"m->out.{one}[%d] = m->controller.{contents.layout.u.name}[%d];" for one in ("u", "u_limited")]
            lines += [line % (i, i) for line in both for i in range(contents.sizes[2])]
            lines += [
                f"m->out.theta_hat[{i}] = m->controller.{contents.layout.theta_hat.name}[{i}];" for i in range(contents.sizes[3])
            ]
            lines.append("m->whole[1] = 0;")
        if self.made is not None:
            lines += [f"{name}_plant_init(&m->plant);", *self._load_plant(), f"{name}_plant_reset(&m->plant);"]
        return lines

    def step(self) -> list[str]:
        """C text of one step of the unit; the value is one of FMU_OK, FMU_WARNING, FMU_ERROR."""
        name, macro, lines = self.printed.name, self.printed.macro, []
        if self.made is not None:
            lines += [f"{name}_plant_input given;", *([f"double y[{macro}_PLANT_OUTPUTS];"] if self.controller else [])]
        if self.controller:
            lines += [f"{name}_input in;", "unsigned status;"]
        lines += ["int i;"] if self.made is not None else []
        if self.made is not None:
            lines += [*self._load_plant(), "give(m, &given);"]
        if self.controller:
            lines += [*self._load_controller(), f"in.sample_time = {macro}_SAMPLE_TIME;", "in.freeze = m->whole[0];"]
            lines += self._sampled()
            lines += [f"status = {name}_step(&m->controller, &in, &m->out);", "m->whole[1] = (int)status;"]
        if self.made is not None:
            lines += self._moved()
        grade = f"status == {macro}_OK ? FMU_OK : FMU_WARNING" if self.controller else "FMU_OK"
        return [*lines, f"return {grade};"]

    def _sampled(self) -> list[str]:
        real, contents = self.printed.real, self.printed.contents
        y, q = contents.sizes[:2]
        lines = [f"in.r[{i}] = ({real}){self._at(name)};" for i, name in enumerate(entries("r", q, scalar=q == 1))]
        if self.made is None:
            names = entries(self.printed.measured, y, scalar=self.scalar_output)
            return lines + [f"in.{self.printed.measured}[{i}] = ({real}){self._at(one)};" for i, one in enumerate(names)]
        measure = f"{self.printed.name}_plant_measure(&m->plant, &given, y);"
        return [*lines, measure, *(f"in.{self.printed.measured}[{i}] = ({real})y[{i}];" for i in range(y))]

    def _moved(self) -> list[str]:
        """The steps of the plant up to the next sample, or one of them."""
        assert self.made is not None
        name, macro = self.printed.name, self.printed.macro
        step = f"{name}_plant_step(&m->plant, &given);"
        lines = []
        if self.controller:
            lines += [f"given.u[{i}] = m->out.u[{i}];" for i in range(self.made.plant.inputs)]
            step = f"for (i = 0; i < {macro}_PLANT_STEPS_PER_SAMPLE; ++i) {{ {step} }}"
        lines += [step, f"for (i = 0; i < {macro}_PLANT_STATES; ++i) {{", "    if (!isfinite(m->plant.state[i])) {"]
        return [*lines, "        return FMU_ERROR;", "    }", "}"]

    def give(self) -> list[str]:
        """C text that computes the plant's input, ``in``, from the variables."""
        assert self.made is not None
        plant, lines = self.made.plant, []
        names = entries("u", plant.inputs, scalar=plant.inputs == 1)
        lines += [f"in->u[{i}] = {'0.0' if self.controller else self._at(one)};" for i, one in enumerate(names)]
        for i, one in enumerate(entries("disturbance", plant.disturbances)):
            lines += [f"in->disturbance[{node}][{i}] = {self._at(one)};" for node in range(plant.nodes)]
        lines += [f"in->noise[{i}] = {self._at(one)};" for i, one in enumerate(entries("noise", plant.loop.signals.noise))]
        return lines if any("m->" in line for line in lines) else [*lines, "(void)m;"]

    def outputs(self) -> list[str]:
        """C text of the variables that are computed from the state."""
        contents, lines = self.printed.contents, []
        if self.made is not None:
            macro, name = self.printed.macro, self.printed.name
            y = self.made.plant.outputs
            lines += [f"{name}_plant_input given;", f"double y[{macro}_PLANT_OUTPUTS];", "give(m, &given);"]
            lines.append(f"{name}_plant_measure(&m->plant, &given, y);")
            names = entries(self.printed.measured, y, scalar=self.scalar_output)
            lines += [f"{self._at(one)} = y[{i}];" for i, one in enumerate(names)]
            lines += [f"{self._at(one)} = m->plant.state[{i}];" for i, one in enumerate(entries("plant.x", self._order))]
        if self.controller:
            for name, count in (("u", contents.sizes[2]), ("u_limited", contents.sizes[2]), ("theta_hat", contents.sizes[3])):
                names = entries(name, count, scalar=count == 1 and name != "theta_hat")
                lines += [f"{self._at(one)} = m->out.{name}[{i}];" for i, one in enumerate(names)]
            for part in self._kept:
                names = entries(f"state.{part.name}", part.size)
                lines += [f"{self._at(one)} = m->controller.{part.name}[{i}];" for i, one in enumerate(names)]
        return lines

    def _at(self, name: str) -> str:
        return f"m->real[{self.variables.place(name)}]"

    def _load_controller(self) -> list[str]:
        real, found = self.printed.real, self.printed.contents.parameters
        return [f"m->controller.parameter[{k}] = ({real}){self._at(one.name)};" for k, one in enumerate(found)]

    def _load_plant(self) -> list[str]:
        assert self.made is not None
        return [f"m->plant.parameter[{k}] = {self._at(one.name)};" for k, one in enumerate(self.made.plant.parameters)]


def _has_other_states(problem: TrackingProblem) -> bool:
    """Whether the simulated plant has separate states, only some of which are named by labels."""
    return isinstance(problem, Problem) and problem.truth is not None and problem.truth.states is not None


def _with_label(one: Variable, labels: Labels | None, i: int) -> Variable:
    """The variable with the i-th unit, and the i-th name in its description."""
    if labels is None:
        return one
    unit = labels.units[i] if labels.units else ""
    return replace(one, unit=unit, meaning=f"{one.meaning}: {labels.name(i)}" if labels.name(i) else one.meaning)
