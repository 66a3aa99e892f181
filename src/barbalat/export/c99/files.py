"""An export in C99: the controller, its self-test and its README, and with them the plant and a program that closes the loop."""

from __future__ import annotations

import re

from barbalat.controllers.settings import PatentNamed
from barbalat.export.contents import Contents, is_explicit
from barbalat.export.evidence import readme_evidence
from barbalat.export.parameters import Opened
from barbalat.export.plant import PlantContents
from barbalat.export.plant_source import PrintedPlant, plant_header, plant_source
from barbalat.export.selftest import selftest
from barbalat.export.shell import shell_readme
from barbalat.export.source import header, shape, source
from barbalat.export.target import require_case
from barbalat.export.texts import Printed, comment, filled, indented
from barbalat.lowering import c99
from barbalat.lowering.c99 import DOUBLE, FLOAT
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel.grid import WHOLE_STEP, signal_table
from barbalat.run.kernel.portable import standard_normal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError


def files(
    problem: TrackingProblem,
    controller: Controller,
    simulation: Simulation,
    *,
    float32: bool = False,
    closed_loop: bool = False,
    name: str = "",
) -> dict[str, str]:
    """The files of an export by their names, in C99; InputError as of ``export_controller``."""
    return sources(problem, controller, simulation, float32=float32, closed_loop=closed_loop, name=name)[1]


def sources(
    problem: TrackingProblem,
    controller: Controller,
    simulation: Simulation,
    *,
    float32: bool = False,
    closed_loop: bool = False,
    name: str = "",
) -> tuple[Printed, dict[str, str]]:
    """The same with the export that they are printed of, for what is made around the C."""
    require_case(problem, simulation)
    printed = Printed(Contents.of(problem, controller, simulation, FLOAT if float32 else DOUBLE), name)
    found = {
        "controller.h": header(printed),
        "controller.c": source(printed),
        "selftest.c": selftest(printed),
        "README.md": readme(printed, closed_loop=closed_loop),
    }
    if closed_loop:
        problem = problem.nominal
        opened = Opened.of(problem, controller, simulation, tunable=False)
        made = PrintedPlant(PlantContents.of(problem, opened), printed)
        found |= {"plant.h": plant_header(made), "plant.c": plant_source(made), "loop.c": loop_program(made)}
    return printed, named(found, name)


FILES = re.compile(r"\b(controller\.[hc]|selftest\.c|plant\.[hc]|loop\.c|README\.md)\b")
"""Files of an export, as they are called in its texts; controller.cpp, for Arduino, is the user's."""


def named(files: dict[str, str], name: str) -> dict[str, str]:
    """The files with this name before theirs, in their texts as well; as they are where it is empty."""
    if not name:
        return files
    return {FILES.sub(rf"{name}_\1", file): FILES.sub(rf"{name}_\1", text) for file, text in files.items()}


def readme(printed: Printed, *, closed_loop: bool = False) -> str:
    """The text of README.md."""
    contents = printed.contents
    layout, macro = contents.layout, printed.macro
    y, q, _, _ = contents.sizes
    functions = sorted({op.name for op in contents.step.operations} & LIBRARY)
    members = "\n".join(f"| `{part.name}` | {part.size} | {shape(part.shape)}{part.meaning} |" for part in layout.parts)
    euler = is_explicit(contents) and any(part.path == "controller.swapping" for part in layout.parts)
    return filled(
        "README.md",
        title=comment(contents.controller.name),
        origin=printed.origin.replace("\n *", ""),
        operations=len(contents.step.operations),
        numbers=len(layout.rows),
        calls=", ".join(functions) or "none",
        library=" -lm" if functions else "",
        samples=len(contents.vectors.states),
        name=printed.name,
        macro=macro,
        sample_time=f"{contents.sample_time!r}",
        measured=printed.measured,
        measured_count=f"{y} state{'s' if y > 1 else ''}" if contents.measures_state else "the output",
        commands=f"{q} commands" if q > 1 else "the command",
        start=f"{printed.measured}, " if contents.measures_state else "",
        range=f"{contents.range:g}",
        set=", or an estimate outside the known set" if contents.limits is not None else "",
        freeze=EULER_SWAPPING if euler else "",
        gap=GAP if any(part.path == "controller.span" for part in layout.parts) else "",
        shell=shell_readme(printed),
        other_time=""
        if contents.around is not None and contents.around.band is not None
        else OTHER_TIME.format(contents.sample_time),
        decide=DECIDE if contents.around is None or contents.around.longest is None else "Here it ends with the longest outage.",
        members=members,
        evidence=readme_evidence(printed),
        loop=filled("README_loop.md", library=" -lm").rstrip() + "\n" if closed_loop else "",
        patent=_patent(printed),
    )


def _patent(printed: Printed) -> str:
    """What is to be asked before such a law flies."""
    controller = printed.contents.controller
    return f"\n## Before you fly it\n\n{controller.patent}\n" if isinstance(controller, PatentNamed) else ""


EULER_SWAPPING = " The swapping term of (14) moves as if the law did: Euler's steps know it from the law's rate alone."

OTHER_TIME = """\
- *Another sample time* than {!r} s, by more than 0.1 %, is flagged, and the step made as if it were right: a wrong rate
  is better than no control. A crystal's inaccuracy, below 0.01 %, and a clock of 1 us at a sample of 1 ms pass; a jitter of more
  than 0.1 % in what you measure is flagged sample by sample, and harmless.
"""

DECIDE = """How long an outage may last before
  something else must take over is yours to decide: without a longest outage in the case's [shell] nobody counts it."""

GAP = """ What the
  prediction error gathered over m samples counts by one sample's share: the law would answer all of it as if it came of one."""

LIBRARY = {"sqrt", "fabs", "floor", "ceil", "exp", "log", "sin", "cos", "tan", "tanh", "pow", "copysign"}
"""Operations that are calls of math.h."""


MOST_NUMBERS = 20_000
"""Numbers of disturbances in the table, some 500 kB of C; with more of them at a sample fewer samples are replayed."""


def loop_program(made: PrintedPlant) -> str:
    """The text of loop.c; InputError where a signal jumps inside of the first sample."""
    plant, printed = made.plant, made.printed
    vectors, every = printed.contents.vectors, plant.steps_per_sample
    at_a_sample = every * plant.nodes * plant.disturbances
    count = len(vectors.commands) if not at_a_sample else max(1, min(len(vectors.commands), MOST_NUMBERS // at_a_sample))
    count = plant.opened.whole_samples(count)
    if not count:
        raise InputError(
            "loop.c replays samples up to the first jump inside of a solver step, and here that is in the first one: let "
            "simulation.dt have the signals' jumps on its grid"
        )
    macro, declared, given = printed.macro, [], []
    if plant.loop.signals.noise:
        declared.append(f"static const double noise[SAMPLES][{macro}_PLANT_NOISES] = {{\n{_rows(_noise(plant, count))}}};\n")
        given.append("memcpy(given.noise, noise[k], sizeof given.noise);")
    moved = []
    if plant.disturbances:
        values = _disturbances(plant, count)
        size = f"[SAMPLES * {macro}_PLANT_STEPS_PER_SAMPLE][{macro}_PLANT_NODES * {macro}_PLANT_DISTURBANCES]"
        declared.append(f"static const double disturbances{size} = {{\n{_rows(values)}}};\n")
        moved = [f"memcpy(given.disturbance, disturbances[k * {macro}_PLANT_STEPS_PER_SAMPLE + i], sizeof given.disturbance);"]
        given.append(moved[0].replace(" + i]", "]"))
    return filled(
        "loop.c",
        origin=printed.origin,
        guard=printed.guard,
        name=printed.name,
        macro=macro,
        real=printed.real,
        measured=printed.measured,
        samples=count,
        exact=int(printed.contents.real is c99.DOUBLE),
        tables="".join(declared),
        command_rows=_rows(vectors.commands[:count]),
        measured_rows=_rows(vectors.measured[:count]),
        control_rows=_rows(vectors.states[:count, list(printed.contents.layout.u.rows)]),
        given=indented(given, 8),
        moved=indented(moved, 12),
    )


def _rows(values: Array) -> str:
    return indented(f"{{ {', '.join(map(c99.constant, row))} }}," for row in values)


def _noise(plant: PlantContents, count: int) -> Array:
    """(K, channels) what the simulation's generator gives at each sample."""
    noise, members = plant.problem.noise, plant.opened.members
    assert noise is not None
    hold = members.rhythm.noise_hold
    rows = [step // hold for step in range(0, count * plant.steps_per_sample, plant.steps_per_sample)]
    return standard_normal(noise.seed, 0, 0, rows[-1] + 1, plant.loop.signals.noise)[rows]


def _disturbances(plant: PlantContents, count: int) -> Array:
    """(steps, nodes * disturbances) at each solver step's instants."""
    members, timed = plant.opened.members, plant.loop.signals.timed
    in_pieces = members.program.shape.in_pieces
    table = signal_table(members.signals, members.simulation, 0, count * plant.steps_per_sample, in_pieces=in_pieces)
    table = table[:, : -len(WHOLE_STEP)] if in_pieces else table
    return table.reshape(len(table), plant.nodes, timed)[:, :, plant.loop.commands or 1 :].reshape(len(table), -1)
