"""Statements on the exported C in flight: only compared flights are reported, and each difference is described."""

from types import SimpleNamespace

import pytest

from barbalat.report.flights import facts
from barbalat.run.kernel.sampled_controller import Agreement

EQUAL = Agreement(flights=2, samples=6000)
WRONG = Agreement(flights=2, samples=6000, difference="x_hat[1] differs from sample 3 of a flight on")
HELD = Agreement(flights=1, samples=1200, refused=7, difference="held_u[0] differs from sample 90 of a flight on")
BROKEN = Agreement(flights=0)
WHOLE = "was compiled on this machine and flown: u and the state are bit-identical to those of the simulation at all"


@pytest.mark.parametrize(
    ("agreements", "said"),
    [
        (None, []),
        ({"a": EQUAL}, [f"the exported C of a {WHOLE} 6,000 samples of 2 flights"]),
        ({"a": Agreement(samples=300)}, [f"the exported C of a {WHOLE} 300 samples of 1 flight"]),
        ({"a": EQUAL, "b": EQUAL}, [f"the exported C of every controller {WHOLE} 12,000 samples of 4 flights"]),
        (
            {"a": EQUAL, "b": WRONG, "c": EQUAL, "d": HELD, "e": BROKEN},
            [
                f"the exported C of 2 of 5 controllers {WHOLE} 12,000 samples of 4 flights",
                "the exported C of b differs from the simulation: x_hat[1] differs from sample 3 of a flight on",
                "the exported C of d differs from the simulation: held_u[0] differs from sample 90 of a flight on, "
                "and it rejected 7 of 1,200 samples",
                "nothing is known about the exported C of e: the simulator failed in every flight",
            ],
        ),
    ],
)
def test_what_is_said(agreements, said):
    found = SimpleNamespace(facts=lambda: [("trim", "level")], agreements=agreements)
    assert facts(found) == [("trim", "level"), *(("exported", one) for one in said)]
