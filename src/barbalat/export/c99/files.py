"""An export in C99: the controller, its self-test and its README, and on request the plant and a program that closes the loop."""

from __future__ import annotations

import re
from textwrap import fill

import numpy as np

from barbalat.controllers.settings import PatentNamed
from barbalat.export.contents import Contents, is_explicit
from barbalat.export.evidence import readme_evidence
from barbalat.export.log import logged
from barbalat.export.parameters import Opened
from barbalat.export.plant import PlantContents
from barbalat.export.plant_source import PrintedPlant, plant_header, plant_source
from barbalat.export.selftest import selftest
from barbalat.export.settable import parameters_readme
from barbalat.export.shell import in_ranges, shell_readme
from barbalat.export.source import channels, header, input_units, is_piecewise, shape, source, units_text
from barbalat.export.target import Request, require_case
from barbalat.export.texts import Printed, command_units, filled, indented, readable
from barbalat.lowering import c99
from barbalat.lowering.c99 import DOUBLE, FLOAT, Real
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.kernel.grid import WHOLE_STEP, signal_table
from barbalat.run.kernel.portable import standard_normal
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array, InputError, counted


def sources(asked: Request) -> tuple[Printed, dict[str, str]]:
    """The files of an export in C99, by name, and the export from which they are printed, for wrappers around the C; raises
    InputError as ``export_controller`` does."""
    problem, controller, simulation = asked.problem, asked.controller, asked.simulation
    require_case(problem, simulation)
    real = FLOAT if asked.float32 else DOUBLE
    contents = made_of(problem, controller, simulation, real, parameters=asked.parameters, place=asked.place)
    printed = Printed(contents, asked.name)
    found = {
        "controller.h": header(printed),
        "controller.c": source(printed),
        "selftest.c": selftest(printed),
        "README.md": readme(printed, closed_loop=asked.closed_loop, warning=asked.warning()),
    }
    if asked.closed_loop:
        if problem.handed_controls:
            raise InputError(
                "the exported plant does not contain the existing loop: set baseline.external = false for a closed loop in C"
            )
        problem = problem.nominal
        opened = contents.opened if asked.parameters else Opened.of(problem, controller, simulation, tunable=False)
        assert opened is not None
        made = PrintedPlant(PlantContents.of(problem, opened), printed)
        found |= {"plant.h": plant_header(made), "plant.c": plant_source(made), "loop.c": loop_program(made)}
    return printed, named(found, asked.name)


def made_of(
    problem: TrackingProblem, controller: Controller, simulation: Simulation, real: Real, *, parameters: bool, place: int = 0
) -> Contents:
    """The contents of an export, with the numbers of the case compiled in or as ``parameters`` that can be set."""
    if not parameters:
        return Contents.of(problem, controller, simulation, real)
    opened = Opened.of(problem.nominal, controller, simulation, tunable=True, place=place)
    made = Contents.of(problem, controller, simulation, real, opened=opened)
    if not made.parameters:
        raise InputError(
            f"the operations of {controller.name} use no parameter unchanged, so no parameter can be set at run time"
        )
    return made if real is FLOAT else made.replayed()


FILES = re.compile(r"\b(controller\.[hc]|selftest\.c|plant\.[hc]|loop\.c|README\.md)\b")
"""The files of an export, by their names in its texts; for Arduino, the user renames controller.c to controller.cpp."""


def named(files: dict[str, str], name: str) -> dict[str, str]:
    """The files with this prefix in their names and texts; unchanged if it is empty."""
    if not name:
        return files
    return {FILES.sub(rf"{name}_\1", file): FILES.sub(rf"{name}_\1", text) for file, text in files.items()}


def readme(printed: Printed, *, closed_loop: bool = False, warning: str = "") -> str:
    """The text of README.md."""
    contents = printed.contents
    layout, macro = contents.layout, printed.macro
    _, q, m, _ = contents.sizes
    functions = sorted({op.name for op in contents.step.operations} & LIBRARY)
    members = "\n".join(f"| `{part.name}` | {part.size} | {shape(part.shape)}{part.meaning} |" for part in layout.parts)
    ends = contents.around is not None and contents.around.longest is not None
    euler = is_explicit(contents) and any(part.path == "controller.swapping" for part in layout.parts)
    return filled(
        "README.md",
        title=readable(contents.controller.name),
        origin=printed.told_origin(readable).replace("\n *", ""),
        warning=f"\n**{readable(warning)}**\n" if warning else "",
        operations=len(contents.step.operations),
        numbers=len(layout.rows),
        calls=", ".join(functions) or "none",
        library=" -lm" if functions else "",
        samples=len(contents.vectors.states),
        name=printed.name,
        macro=macro,
        sample_time=f"{contents.sample_time!r}",
        measured=printed.measured,
        measured_lines=_measured(printed),
        units=_units(printed),
        u_baseline=_handed(printed),
        between=_between(printed),
        existing=EXISTING.format(macro=macro, measured=printed.measured) if contents.problem.handed_controls else "",
        commands=(f"{q} commands" if q > 1 else "the command") + units_text(command_units(contents.problem)),
        further=f" to [{m - 1}]" if m > 1 else "",
        input_units=input_units(printed),
        start=f"{printed.measured}, " if contents.measures_state else "",
        range=f"{contents.range:g}",
        set=", or an estimate outside the known set" if _is_checked(contents) else "",
        parameters=parameters_readme(printed),
        freeze=FROZEN_FEEDBACK if is_piecewise(contents) else EULER_SWAPPING if euler else "",
        first_misses=" After LONGEST_OUTAGE misses the fallback acts." if ends else "",
        **(PREDICTS if contents.loop.observer is not None else HOLDS),
        gap=GAP if any(part.path == "controller.span" for part in layout.parts) else "",
        shell=shell_readme(printed),
        start_range=", is outside its plausible range (see below) or" if in_ranges(printed, "x") else " or",
        after_refusals=BEGINS_AGAIN
        if contents.around is None or contents.around.longest is None
        else "It counts as a miss: see the longest outage.",
        other_time=""
        if contents.around is not None and contents.around.band is not None
        else OTHER_TIME.format(contents.sample_time),
        decide=DECIDE
        if contents.around is None or contents.around.longest is None
        else "In this export, holding ends with the longest outage.",
        members=members,
        real=printed.real,
        log_size=len(logged(printed)),
        evidence=readme_evidence(printed),
        loop=filled("README_loop.md", library=" -lm").rstrip() + "\n" if closed_loop else "",
        patent=_patent(printed),
    )


BEGINS_AGAIN = """At the second consecutive good sample of that kind the controller restarts, as with a start that keeps the
  estimates and keeps u within its limits. From the tenth on it restarts with the initial estimates and with u at zero, or at
  the limit nearest to zero."""
EXISTING = """
- *The existing loop* stays in its own code. At each sample it passes its control, before limiting, in
  `in.{measured}[{macro}_U_BASELINE]`: u is this control plus the adaptive part, and u_limited is the sum within the limits. If
  the existing loop has an integrator, pass u_limited to its anti-windup. The controller keeps a copy of the loop's states,
  which the law needs. If this control is NaN, the measurement of that sample counts as lost. A start ignores this entry."""


def _handed(printed: Printed) -> str:
    """The lines that pass the control of an external baseline to the controller."""
    controls = len(printed.contents.problem.handed_controls)
    places = [f"{printed.macro}_U_BASELINE{f' + {i}' if i else ''}" for i in range(controls)]
    return "".join(f"    in.{printed.measured}[{place}] = ...;   /* u of the existing loop */\n" for place in places)


def _between(printed: Printed) -> str:
    """The functions that may be called between two steps."""
    functions = ["start", *(["set"] if printed.contents.parameters else []), "read_log"]
    named = [f"`{printed.name}_{one}`" for one in functions]
    return f"{', '.join(named[:-1])} and {named[-1]}"


def _measured(printed: Printed) -> str:
    """The lines that pass the measurements, one for each channel that has a label in the case."""
    each = channels(printed)
    texts = [f"{_counted(printed, printed.contents.problem.measured)} measured"] if not all(each) else each
    return indented(f"in.{printed.measured}[{i}] = ...;                       /* {text} */" for i, text in enumerate(texts))


def _units(printed: Printed) -> str:
    """The labels and units of the case in one sentence."""
    each = channels(printed)
    said = [f"{printed.measured}[{i}] is {one}" for i, one in enumerate(each) if one]
    said += [f"u is in {input_units(printed).strip(' []')}"] if input_units(printed) else []
    return fill(f"Quantities are in the units of the case{': ' if said else ''}{', '.join(said)}.", 128)


def _counted(printed: Printed, y: int) -> str:
    """The measured quantities in a few words."""
    if printed.measured == "x":
        return counted(y, "state")
    return "the output" if y == 1 else counted(y, "output")


def _is_checked(contents: Contents) -> bool:
    """Whether an estimate outside the known set is rejected."""
    return contents.checked_limits is not None and bool(np.isfinite(contents.checked_limits).any())


def _patent(printed: Printed) -> str:
    """The patents to check before such a law flies."""
    controller = printed.contents.controller
    return f"\n## Before you fly it\n\n{controller.patent}\n" if isinstance(controller, PatentNamed) else ""


FROZEN_FEEDBACK = (
    "\n  The estimate of this law is its only feedback: while it is frozen, the loop is open, and an unstable vehicle is lost "
    "within seconds."
)
EULER_SWAPPING = (
    " The swapping term of (14) still changes as if the law were active, because the Euler steps compute it only from the rate "
    "of the law."
)

OTHER_TIME = """\
- *A wrong sample time*, which differs from {!r} s by more than 0.1 %, is flagged. The step is still made as if the time were
right, because a wrong rate is better than no control. The error of a crystal oscillator, below 0.01 %, and a clock resolution of
1 us at a sample time of 1 ms are accepted. A jitter of more than 0.1 % in the measured time is flagged at each sample but is
harmless.
"""

DECIDE = """You decide how long an outage may last before something else must take over: unless the case's [shell] gives a
longest outage, the controller does not count missed samples."""

HOLDS = {"with_what": "the last good measurement and this u", "settle": "settle\n  for the last good sample"}
PREDICTS = {
    "with_what": "what the observer predicts from this u",
    "settle": "continue with\n  the observer's prediction, which for an unstable plant grows without bound",
}
"""The input of the models and filters at a lost measurement, without and with an observer."""
GAP = """ The prediction error accumulated over m samples is divided by m; otherwise the law would respond as if a single
sample had caused all of it."""

LIBRARY = {"sqrt", "fabs", "floor", "ceil", "exp", "log", "sin", "cos", "tan", "tanh", "pow", "copysign"}
"""Operations that call math.h."""


MOST_NUMBERS = 20_000
"""Largest number of values in the table of disturbances, some 500 kB of C; with more disturbances per sample, fewer samples are
replayed."""


def loop_program(made: PrintedPlant) -> str:
    """The text of loop.c; raises InputError if a signal jumps inside the first sample."""
    plant, printed = made.plant, made.printed
    vectors, every = printed.contents.vectors, plant.steps_per_sample
    at_a_sample = every * plant.nodes * plant.disturbances
    count = len(vectors.commands) if not at_a_sample else max(1, min(len(vectors.commands), MOST_NUMBERS // at_a_sample))
    count = plant.opened.whole_samples(count)
    if not count:
        raise InputError(
            "loop.c replays samples up to the first jump inside a solver step, but here this jump is in the first step: choose "
            "simulation.dt so that the signals jump at multiples of it"
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
    """(K, channels) the values of the simulation's noise generator at each sample."""
    noise, members = plant.problem.noise, plant.opened.members
    assert noise is not None
    hold = members.rhythm.noise_hold
    rows = [step // hold for step in range(0, count * plant.steps_per_sample, plant.steps_per_sample)]
    return standard_normal(noise.seed, 0, 0, rows[-1] + 1, plant.loop.signals.noise)[rows]


def _disturbances(plant: PlantContents, count: int) -> Array:
    """(steps, nodes * disturbances) the disturbances at the instants of each solver step."""
    members, timed = plant.opened.members, plant.loop.signals.timed
    in_pieces = members.program.shape.in_pieces
    table = signal_table(members.signals, members.simulation, 0, count * plant.steps_per_sample, in_pieces=in_pieces)
    table = table[:, : -len(WHOLE_STEP)] if in_pieces else table
    return table.reshape(len(table), plant.nodes, timed)[:, :, plant.loop.commands or 1 :].reshape(len(table), -1)
