"""loop.c: the exported controller and the exported plant as a loop, beside the simulation that both are slices of."""

from __future__ import annotations

from barbalat.export.plant import PlantContents
from barbalat.export.plant_source import PrintedPlant
from barbalat.export.texts import filled, indented
from barbalat.lowering import c99
from barbalat.run.kernel.grid import WHOLE_STEP, signal_table
from barbalat.run.kernel.portable import standard_normal
from barbalat.validate import Array, InputError

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
