"""plant.h and plant.c: the plant of an export as C."""

from __future__ import annotations

from dataclasses import dataclass

from barbalat.export.parameters import Parameter
from barbalat.export.plant import NOISE, PARAMETER, PAST, SIGNAL, PlantContents
from barbalat.export.texts import Printed, filled, indented
from barbalat.lowering import c99
from barbalat.lowering.operations import Program, sources
from barbalat.lowering.shape import TAPS_PER_CHANNEL


@dataclass(frozen=True, eq=False)
class PrintedPlant:
    """A plant, and the names of its controller in C."""

    plant: PlantContents
    printed: Printed

    def number(self, wanted: Parameter | float) -> str:
        """C text of a number that may be a parameter of the plant ``p``."""
        if isinstance(wanted, float):
            return c99.constant(wanted)
        return f"p->parameter[{self.plant.parameters.index(wanted)}]"


def plant_header(made: PrintedPlant) -> str:
    """The text of plant.h."""
    plant, macro = made.plant, made.printed.macro
    sizes = {"STATES": len(plant.rows), "CONTROLS": plant.inputs, "OUTPUTS": plant.outputs, "NODES": plant.nodes}
    sizes |= {"DISTURBANCES": plant.disturbances, "NOISES": plant.loop.signals.noise, "PARAMETERS": len(plant.parameters)}
    members = [f"double state[{macro}_PLANT_STATES]; /* x, then the actuators', then the sensor's */"]
    if plant.parameters:
        names = ", ".join(one.name for one in plant.parameters)
        members.append(f"double parameter[{macro}_PLANT_PARAMETERS]; /* {names} */")
    if plant.channels:
        members.append(f"double past[{plant.lag + TAPS_PER_CHANNEL}][{plant.channels}]; /* values inside the delay */")
        members.append("int slot; /* index in past for this step's values */")
    inputs = [f"double u[{macro}_PLANT_CONTROLS]; /* control, held over the step */"]
    if plant.disturbances:
        inputs.append(f"double disturbance[{macro}_PLANT_NODES][{macro}_PLANT_DISTURBANCES]; /* at the step's instants */")
    if plant.loop.signals.noise:
        inputs.append(f"double noise[{macro}_PLANT_NOISES]; /* standard Gaussian numbers of the measurement */")
    return filled(
        "plant.h",
        origin=made.printed.origin,
        name=made.printed.name,
        macro=macro,
        dt=made.printed.number(plant.opened.members.simulation.dt),
        steps=plant.steps_per_sample,
        nodes=", ".join(f"{node:g}" for node in plant.opened.members.simulation.solver.nodes),
        sizes="".join(f"#define {macro}_PLANT_{name} {size}\n" for name, size in sizes.items()),
        members=indented(members),
        inputs=indented(inputs),
    )


def plant_source(made: PrintedPlant) -> str:
    """The text of plant.c."""
    plant = made.plant
    programs = (plant.step, plant.measurement)
    functions = c99.definitions(programs)
    headers = ["math"] if any(map(c99.calls_functions, programs)) else []
    headers += ["stdint", "string"] if functions else []
    return filled(
        "plant.c",
        origin=made.printed.origin,
        include="".join(f"#include <{name}.h>\n" for name in headers),
        functions=f"{functions}\n" if functions else "",
        name=made.printed.name,
        macro=made.printed.macro,
        defaults=indented(
            f"p->parameter[{k}] = {c99.constant(one.value)}; /* {one.name} */" for k, one in enumerate(plant.parameters)
        ),
        reset=indented(
            [*(f"p->state[{i}] = {made.number(plant.start(row))};" for i, row in enumerate(plant.rows)), *_nothing(plant)]
        ),
        measure=indented(_measured(made)),
        step=indented(_stepped(made)),
    )


def _nothing(plant: PlantContents) -> list[str]:
    """C text that fills the delay with the values for t < 0."""
    if not plant.channels:
        return []
    lines = ["int k;", f"for (k = 0; k < {plant.lag + TAPS_PER_CHANNEL}; ++k) {{"]
    lines += [f"    p->past[k][{i}] = {c99.constant(value)};" for i, value in enumerate(plant.history)]
    return ["p->slot = 0;", "{", *(f"    {line}" for line in (*lines, "}")), "}"]


def _measured(made: PrintedPlant) -> list[str]:
    program = made.plant.measurement
    lines = c99.statements(program, _inputs(made, program))
    printer = c99.Printer(program)
    lines += [f"y[{i}] = {printer.number(at)};" for i, at in enumerate(program.outputs[0])]
    return lines if any(kind in {NOISE, SIGNAL} for kind, _ in sources(program)) else [*lines, "(void)in;"]


def _stepped(made: PrintedPlant) -> list[str]:
    plant, program = made.plant, made.plant.step
    rows = plant.lag + TAPS_PER_CHANNEL
    taps = [
        f"const double *const tap{t} = p->past[(p->slot + {rows - plant.lag - t}) % {rows}];" for t in range(TAPS_PER_CHANNEL)
    ]
    lines = [*(taps if plant.channels else []), *c99.statements(program, _inputs(made, program))]
    printer = c99.Printer(program)
    own, remembered = program.outputs[0][: len(plant.rows)], program.outputs[0][len(plant.rows) :]
    lines += [f"p->state[{i}] = {printer.number(at)};" for i, at in enumerate(own)]
    lines += [f"p->past[p->slot][{i}] = {printer.number(at)};" for i, at in enumerate(remembered)]
    return [*lines, f"p->slot = (p->slot + 1) % {rows};"] if plant.channels else lines


def _inputs(made: PrintedPlant, program: Program) -> dict[tuple[int, int], str]:
    """C text of all inputs of the list."""
    texts = made.plant.entries()
    for kind, at in sources(program):
        if kind == PARAMETER:
            texts[kind, at] = made.number(made.plant.fed(at))
        elif kind == SIGNAL:
            place = made.plant.signal(at)
            texts[kind, at] = c99.constant(1.0) if place is None else f"in->disturbance[{place[0]}][{place[1]}]"
        elif kind == PAST:
            texts[kind, at] = f"tap{at % TAPS_PER_CHANNEL}[{at // TAPS_PER_CHANNEL}]"
        elif kind == NOISE:
            texts[kind, at] = f"in->noise[{at}]"
    return texts
