"""Messages about equations that cannot be used: the controller and equation, the line in its file, and the remedy."""

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
"""Largest number of characters quoted from a different package's message; its beginning describes the problem."""


@dataclass(frozen=True)
class Subject:
    """The subject of a message: ``said`` begins the sentence, and ``controller`` is the controller's name in the sentence."""

    said: str
    controller: str = ""
    symbolic: bool = False

    def part(self, name: str) -> Subject:
        """The same subject for one of the controller's equations, or for all of them."""
        return replace(self, said=f"{self.said}{name}")

    @property
    def on_numbers(self) -> Subject:
        return self.part(" on numbers")

    @property
    def on_symbols(self) -> Subject:
        """This subject for an equation that worked on numbers, so that a failure is due to the symbols."""
        return replace(self.part(" on symbols"), symbolic=True)

    def error(self, what: str) -> InputError:
        """An error whose message begins with the subject."""
        return InputError(f"{self.said}{what}", controller=self.controller)


def require_state(state: Any, what: Subject, declared: Mapping[str, Role] | None) -> None:
    """Raise InputError if ``initial`` returns no NamedTuple of arrays, or a NamedTuple without declared estimates."""
    if not isinstance(state, tuple) or type(state) is tuple:
        raise what.error(f" must return a NamedTuple of arrays, got {validate.show(state)}")
    if "theta_hat" not in names_of(state) and declared is None:
        raise what.error(
            f" returns a {type(state).__name__} without the field theta_hat: add it, with the estimates, or np.zeros(0) if "
            "nothing is estimated; or declare the roles of its fields in a mapping `roles`, {} if nothing is estimated"
        )
    for place, leaf in leaves(state):
        if not isinstance(leaf, (np.ndarray, np.generic)) or leaf.dtype.kind not in "iuf":
            raise what.error(f": {place} must be an array of real numbers, as np.zeros(2) is, got {validate.show(leaf)}")
        if not np.isfinite(leaf).all():
            raise what.error(f": {place} must be finite, got {validate.show(leaf)}")


def require_array(found: Any, shape: tuple[int, ...], what: Subject, name: str) -> None:
    """Raise InputError for an object that is not a number or array of this shape; a number is accepted for an array with one
    entry."""
    given = shape_of(found)
    if given is None:
        raise what.error(f": {name} must be {_named(shape)}, got {_shown(found)}")
    if given != shape and not (shape == () and given == (1,)):
        raise what.error(f": {name} must be {_named(shape)}, got shape {given}; `a @ b` of two vectors is a number")


def require_like(found: Any, state: Any, what: Subject) -> None:
    """Raise InputError for a state whose form differs from that of the initial state."""
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
def telling_user_errors(what: Subject) -> Iterator[None]:
    """Turns any error raised by the user's code into one sentence with the line."""
    try:
        yield
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise what.error(f" fails{_line(error)}: {_reason(error, what)}") from error


@contextmanager
def named(controller: str) -> Iterator[None]:
    """Adds the controller's name to an InputError, because several controllers may be given."""
    try:
        yield
    except InputError as error:
        if error.controller == controller:
            raise
        raise InputError(f"controller {validate.show(controller)}: {error}", controller=controller) from error


REMEDIES = {
    "__bool__": "it branches on a value that is known only during a run; use np.where, np.clip, np.minimum or np.maximum",
    "__array__": "np.array cannot hold symbols; use np.stack or np.concatenate",
}
"""The methods of a symbol that raise: Python calls the first for a truth value, NumPy the second for numbers."""


def _reason(error: BaseException, what: Subject) -> str:
    """The cause, with the remedy if it is known."""
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
    """The line in the user's file: the last one in the traceback outside the package and its libraries."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not _is_library(frame.filename)]
    if not own:
        return ""
    shown = f" ({validate.show(own[-1].line)[1:-1]})" if own[-1].line else ""
    return f" in line {own[-1].lineno} of {Path(own[-1].filename).name}{shown}"
