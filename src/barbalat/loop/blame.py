"""What is said of equations that can't be used: which controller, which equation, where in its file, and what would be right."""

from __future__ import annotations

import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from barbalat import validate
from barbalat.roles import Role, leaves, names_of
from barbalat.validate import InputError

PACKAGE = Path(__file__).parents[1]
LONGEST_REASON = 160
"""Characters of another package's message: the beginning says what went wrong."""


@dataclass(frozen=True)
class Subject:
    """What is spoken of: ``said`` as a sentence begins with it, ``controller`` the name of the one that is named there."""

    said: str
    controller: str = ""
    symbolic: bool = False

    def part(self, name: str) -> Subject:
        """One of its equations, or all of them."""
        return replace(self, said=f"{self.said}{name}")

    @property
    def on_numbers(self) -> Subject:
        return self.part(" on numbers")

    @property
    def on_symbols(self) -> Subject:
        """An equation that went well on numbers: what fails now fails because of the symbols."""
        return replace(self.part(" on symbols"), symbolic=True)

    def error(self, what: str) -> InputError:
        """A sentence that begins with it."""
        return InputError(f"{self.said}{what}", controller=self.controller)


def require_state(state: Any, what: Subject, declared: Mapping[str, Role] | None) -> None:
    """InputError where ``initial`` gives no NamedTuple of arrays, or one of which nothing says what is estimated."""
    if not isinstance(state, tuple) or type(state) is tuple:
        raise what.error(f" must return a NamedTuple of arrays, got {validate.show(state)}")
    if "theta_hat" not in names_of(state) and declared is None:
        raise what.error(
            f" returns a {type(state).__name__} without the field theta_hat: give it one, the estimates, or np.zeros(0) "
            "where nothing is estimated; or declare in a mapping `roles` what its fields are, {} where nothing is estimated"
        )
    for place, leaf in leaves(state):
        if not isinstance(leaf, (np.ndarray, np.generic)) or leaf.dtype.kind not in "iuf":
            raise what.error(f": {place} must be an array of real numbers, as np.zeros(2) is, got {validate.show(leaf)}")
        if not np.isfinite(leaf).all():
            raise what.error(f": {place} must be finite, got {validate.show(leaf)}")


def require_array(found: Any, shape: tuple[int, ...], what: Subject, name: str) -> None:
    """InputError for what is no number and no array of this shape; one number may stand in an array of one entry."""
    given = shape_of(found)
    if given is None:
        raise what.error(f": {name} must be {_named(shape)}, got {_shown(found)}")
    if given != shape and not (shape == () and given == (1,)):
        raise what.error(f": {name} must be {_named(shape)}, got shape {given}; `a @ b` of two vectors is a number")


def require_like(found: Any, state: Any, what: Subject) -> None:
    """InputError for a state of another form than the initial one."""
    if not isinstance(found, tuple):
        raise what.error(f": it must return the state, a {type(state).__name__}, got {_shown(found)}")
    expected, given = list(leaves(state)), list(leaves(found))
    if len(expected) != len(given):
        raise what.error(f": it must return {len(expected)} arrays, as initial does, got {len(given)}")
    places = [place for place, _ in given]
    if type(found) is not tuple and places != [place for place, _ in expected]:
        raise what.error(
            f": it must return a {type(state).__name__} with the fields {', '.join(place for place, _ in expected)}, "
            f"got a {type(found).__name__} with {', '.join(places)}"
        )
    for (place, array), (_, value) in zip(expected, given, strict=True):
        shape = shape_of(value)
        if shape != array.shape:
            got = _shown(value) if shape is None else f"shape {shape}"
            raise what.error(f": {place} must have shape {array.shape}, as initial gives it, got {got}")


def shape_of(value: Any) -> tuple[int, ...] | None:
    """The shape of numbers or expressions; ``None`` for anything else."""
    import casadi as ca

    if isinstance(value, (int, float)):
        return ()
    if isinstance(value, (np.ndarray, np.generic)):
        return value.shape if value.dtype.kind in "biuf" else None
    return tuple(value.shape) if isinstance(value, ca.ArrayInterface) else None


def _named(shape: tuple[int, ...]) -> str:
    return f"an array of shape {shape}" if shape else "a number, shape ()"


def _shown(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"a {type(value).__name__}: make an array of it with np.stack or np.concatenate"
    return "None: a return is missing" if value is None else f"a {type(value).__name__}, {validate.show(value)}"


@contextmanager
def blamed(what: Subject) -> Iterator[None]:
    """Whatever the user's own lines raise becomes one sentence with the line in it."""
    try:
        yield
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise what.error(f" fails{_line(error)}: {_reason(error, what)}") from error


@contextmanager
def named(controller: str) -> Iterator[None]:
    """A controller that does not fit its problem is told apart from those that stand beside it."""
    try:
        yield
    except InputError as error:
        if error.controller == controller:
            raise
        raise InputError(f"controller {validate.show(controller)}: {error}", controller=controller) from error


REMEDIES = {
    "__bool__": "it branches on a value that is known only during a run; use np.where, np.clip, np.minimum or np.maximum",
    "__array__": "np.array can't hold symbols; use np.stack or np.concatenate",
}
"""By the method of a symbol that refuses: Python asks the first for a truth value, NumPy the second for numbers."""


def _reason(error: BaseException, what: Subject) -> str:
    """What went wrong, and the remedy where it is known."""
    said = f"{type(error).__name__}: {' '.join(str(error).split())[:LONGEST_REASON]}"
    if not what.symbolic:
        return said
    last = traceback.extract_tb(error.__traceback__)[-1]
    if _is_library(last.filename) and last.name in REMEDIES:
        return REMEDIES[last.name]
    return f"{said}; write it with NumPy functions that also take symbols, such as sums, products, np.where, np.tanh"


def _is_library(filename: str) -> bool:
    return PACKAGE in Path(filename).parents or "site-packages" in filename or filename.startswith("<frozen")


def _line(error: BaseException) -> str:
    """Where in the user's file it happened: the last line there that is not the package's, nor a library's."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not _is_library(frame.filename)]
    if not own:
        return ""
    shown = f" ({validate.show(own[-1].line)[1:-1]})" if own[-1].line else ""
    return f" in line {own[-1].lineno} of {Path(own[-1].filename).name}{shown}"
