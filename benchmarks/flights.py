"""The cost of flights: a minute of the F-16 by the operation list and by the exported C, and 200 draws on two cores.

``./dev flight --benchmark`` runs it where JSBSim is installed. Costs are the processor time of all processes that take part, so
other programs hardly affect them. The costs of the draws include the start, the trim and the compilation.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time

from barbalat.export.exported_step import exported_c
from barbalat.run.kernel.sampled_controller import SampledList, Step
from barbalat.vehicles.dispersed import fly_dispersed
from barbalat.vehicles.f16.airframe import FlightCondition
from barbalat.vehicles.f16.axis import Axis
from barbalat.vehicles.f16.failures import OF_PITCH
from barbalat.vehicles.f16.flying import fly_once
from barbalat.vehicles.f16.trim import trimmed
from barbalat.vehicles.flight import Timing
from barbalat.vehicles.flying import on_loop
from barbalat.vehicles.vehicle import vehicle_of
from benchmarks.house import Section
from benchmarks.processor import description
from benchmarks.table import Row, console, show

MINUTE = Timing(duration=60.0, fails_at=60.0)
"""The flight without a failure."""
SHARE = 20.0
"""Target as a fraction of real time: a flight of one minute in three seconds."""
DRAWS, MINUTES, CORES = 200, 3.0, 2
"""Number of draws with one controller and one failure, the target time for them, and the number of cores."""
SCHEMES = ("l1-piecewise", "l1", "robust-mrac")
"""The schemes, from the smallest operation list to the largest."""


def one_flight(*, quick: bool) -> Section:
    axis = Axis(trim=trimmed(FlightCondition()))
    rows = []
    for name in SCHEMES[: 1 if quick else None]:
        pair = on_loop(vehicle_of(axis.like), axis, name)
        by_list, by_c = (
            _busy(axis, step, 1 if quick else 3) for step in (SampledList.of(*pair).step(), exported_c(*pair).step())
        )
        for how, busy in (("", by_list), (", exported C beside the list", by_c)):
            rows.append(Row(f"{name}{how}", f"{busy:.2f} s", f"{MINUTE.duration:g} s", MINUTE.duration / busy, at_least=SHARE))
    return rows, []


def _busy(axis: Axis, step: Step, repeats: int) -> float:
    """Processor time of the best flight, from reading the aircraft's file to the end."""
    found = []
    for _ in range(repeats):
        begun = time.process_time()
        flight = fly_once(axis, step, OF_PITCH[0], timing=MINUTE)
        found.append(time.process_time() - begun)
        if flight.lost:
            raise RuntimeError(f"{step.name} lost the aircraft with nothing failed: {flight.lost}")
    return min(found)


def draws(*, quick: bool) -> Section:
    members = DRAWS // 10 if quick else DRAWS
    busy, wall = _processors(), time.perf_counter()
    found = fly_dispersed("f16-pitch", schemes=["l1-piecewise"], failures=["elevator-50"], members=members, processes=CORES)
    busy, wall = _processors() - busy, time.perf_counter() - wall
    scaled, limit = busy * DRAWS / members / CORES, 60 * MINUTES
    what = f"{found.members} draws, one controller, one failure"
    ours = f"{busy:.1f} s of processors, {wall:.1f} s by the clock"
    return [Row(what, ours, f"{limit:g} s for {DRAWS} on {CORES} cores", limit / scaled, at_least=1.0)], []


def _processors() -> float:
    """Processor time [s] of this process and of the ended processes that it started."""
    used = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def main() -> int:
    parser = argparse.ArgumentParser(prog="./dev flight --benchmark", description="What flights cost.")
    parser.add_argument("--quick", action="store_true", help="one flight and a tenth of the draws")
    quick = parser.parse_args().quick
    console.print(f"{description()}\n")
    show("A minute of the F-16 at 100 Hz, processor time", *one_flight(quick=quick))
    show("Dispersed flights", *draws(quick=quick))
    return 0


if __name__ == "__main__":
    sys.exit(main())
