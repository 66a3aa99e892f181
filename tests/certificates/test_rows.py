"""A certificate's rows: the form of a value determines how it is shown, also for keys of a single scheme."""

from __future__ import annotations

import pytest

from barbalat.certificates.certificate import Draft
from barbalat.certificates.entry import NUMBERS_ALONE, NotApplicable
from barbalat.certificates.quantities import Form, Quantity
from barbalat.certificates.rows import ROWS_BY_FORM

OWN_QUANTITIES = {
    "drift": Quantity("largest drift", "1/s"),
    "reserve": Quantity("what is left", below=True),
    "left": Quantity("of a unit", form=Form.PER_UNIT),
    "parts": Quantity("in series", form=Form.NAMES),
}


def test_a_schemes_own_keys_are_shown_by_their_form():
    draft = Draft(own=OWN_QUANTITIES)
    draft.guarantee("drift", 0.1234564, NUMBERS_ALONE)
    draft.guarantee("reserve", 0.1234564, NUMBERS_ALONE)
    draft.estimate({"left": {"r": 0.25, "d": 1e-15}, "parts": ["one", "two"]})
    draft.guarantee("nu_0", 2.0, NUMBERS_ALONE)  # and a shared one
    shown = {row.quantity: row for row in draft.finish().rows}
    assert (shown["drift"].value, shown["drift"].meaning) == ("0.123457", "largest drift [1/s]")  # outward means up
    assert shown["reserve"].value == "0.123456"  # outward means down
    assert shown["left"].value == "0.25 r, 0 d"
    assert shown["parts"].value == "one, two"
    assert shown["nu_0"].kind == "guaranteed"


def test_a_value_that_does_not_apply_says_why():
    draft = Draft(own=OWN_QUANTITIES)
    draft.estimate({"drift": NotApplicable("nothing moves")})
    (row,) = draft.finish().rows
    assert (row.value, row.meaning, row.kind) == ("", "nothing moves", "does not apply")
    assert "drift" not in draft.finish().values


def test_a_key_without_a_meaning_is_refused():
    with pytest.raises(KeyError):
        Draft().guarantee("drift", 1.0, NUMBERS_ALONE)


def test_every_form_is_shown():
    assert set(ROWS_BY_FORM) == set(Form)
