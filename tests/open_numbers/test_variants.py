"""A case with changed numbers equals the case of a changed file, whatever it reuses from the first one."""

import numpy as np
import pytest

from barbalat import InputError
from barbalat.cases.load import CaseText
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.structure import identical
from barbalat.open_numbers.numbers import in_tables
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase


@pytest.mark.parametrize("case", ["paper", "first-order", "l1-output", "f16-short-period"])
def test_a_number_makes_the_case_that_the_file_would_be(case):
    text = CaseText.read(case)
    for path, value in in_tables(text.data()):
        varied = VariedCase(text, (path,))
        for other in (value, 1.01 * value + 0.001 * (value == 0), 0.98 * value):
            tables = varied.tables_at([other])
            try:
                whole = text.case(tables)
            except InputError as error:
                with pytest.raises(InputError) as refused:
                    varied.at([other])
                assert str(refused.value) == str(error)
                continue
            made = varied.at([other])
            assert made.simulation == whole.simulation
            for one, two, equations in zip(made.controllers, whole.controllers, made.equations, strict=True):
                loop = ClosedLoop.of(whole.problem, two)
                assert identical(ClosedLoop.of(made.problem, one), loop)
                assert identical(equations, loop.equations)
                assert ClosedLoop.of(made.problem, one).initial().tobytes() == loop.initial().tobytes()
            assert identical(made.problem.signals, whole.problem.signals)


def test_thousands_of_cases_are_made_of_one():
    varied = VariedCase(CaseText.read("paper"), (FieldPath.parse("controller[2].gamma"),))
    gains = [varied.at([1.0 + k]).controllers[2].gamma for k in range(1500)]
    np.testing.assert_array_equal(gains, 1.0 + np.arange(1500))
