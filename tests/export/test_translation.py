"""Each compiled step is its operation list, for all numbers, with + * / sqrt as uninterpreted functions."""

from __future__ import annotations

import random

import pytest

from barbalat.export.contents import Contents
from barbalat.export.source import source
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE, FLOAT
from export.examples import SIMULATION
from export.targets import needs
from export.terms import Terms
from export.test_proof import PROVEN
from export.test_selftest import CHOSEN, EXAMPLES, FAULTS, one
from export.translation import compiled, difference

pytestmark = needs("clang", "z3")
OPTIMISED = [name for name in PROVEN if name != one("L1Adaptive-state-midpoint")]
"""For the other one, LLVM's optimiser uses facts on values that the terms do not contain, such as that no square is negative."""


def printed(name: str, real=DOUBLE) -> Printed:
    return Printed(Contents.of(*EXAMPLES[name], SIMULATION, real))


@pytest.mark.parametrize("real", [DOUBLE, FLOAT], ids=lambda real: real.name)
@pytest.mark.parametrize("name", CHOSEN)
@pytest.mark.short(kept=lambda name, real: name == CHOSEN[1] and real is FLOAT)
def test_the_step_is_the_list(name, real, tmp_path) -> None:
    """The step is compiled by clang for every scheme, one and several inputs, and both formats."""
    made = printed(name, real)
    assert difference(made, compiled(made, tmp_path, "-O0")) == ""


@pytest.mark.full
@pytest.mark.parametrize("name", OPTIMISED)
def test_the_optimised_step_is_the_list(name, tmp_path) -> None:
    made = printed(name)
    assert difference(made, compiled(made, tmp_path, "-O2")) == ""


@pytest.mark.parametrize(("name", "level"), [(one("Mrac-state-euler"), "-O2"), (one("RobustMrac-free-midpoint"), "-O0")])
@pytest.mark.short(kept=lambda name, level: level == "-O2")
def test_every_planted_fault_is_seen(name, level, tmp_path, sample) -> None:
    """The faults are the self-test's arithmetic mutants. None may be missed in any branch, and the place is reported."""
    made = printed(name)
    right = source(made)
    for number, fault in list(enumerate(FAULTS))[:: sample(5, 1)]:
        if callable(fault):
            said = difference(made, compiled(made, tmp_path, level, fault(right, random.Random(number))))
            assert " differs" in said, number


def test_terms_know_what_ieee_754_says_and_no_more() -> None:
    """a - b is a + -b, addition is commutative, and signs can be moved out of products. But addition is not associative, and 0 +
    x is not x."""
    terms = Terms(float)
    a, b, c = (terms.input("0", i) for i in range(3))
    zero, less = terms.constant(0.0), terms.compare("lt", a, b)

    def add(x: int, y: int) -> int:
        return terms.of("add", x, y)

    def mul(x: int, y: int) -> int:
        return terms.of("mul", x, y)

    chosen = terms.chosen(less, terms.neg(a), a)
    assert not terms.differ([(add(a, b), add(b, a)), (mul(terms.neg(a), b), terms.neg(mul(a, b)))])
    assert not terms.differ([(add(chosen, b), terms.chosen(less, add(terms.neg(a), b), add(a, b)))])
    assert not terms.differ([(mul(chosen, terms.neg(b)), terms.chosen(less, mul(a, b), terms.neg(mul(a, b))))])
    assert not terms.differ([(terms.of("div", a, terms.constant(4.0)), mul(a, terms.constant(0.25)))])
    for different in (
        (add(add(a, b), c), add(a, add(b, c))),
        (add(a, zero), a),
        (mul(a, zero), zero),
        (terms.neg(add(a, terms.neg(b))), add(b, terms.neg(a))),  # -0 and 0 are equal numbers
        (terms.of("div", mul(a, b), b), a),
        (terms.chosen(less, a, b), terms.chosen(terms.compare("le", a, b), a, b)),
        (terms.chosen(terms.negated(less), a, b), terms.chosen(terms.compare("le", b, a), a, b)),  # of an empty list
    ):
        assert terms.differ([different])
