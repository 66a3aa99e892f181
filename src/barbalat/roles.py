"""Roles of the parts of a controller's state: estimates, the law's memory, a predictor, a filter, or something else.

Equations declare roles in an attribute ``roles``, a mapping from the names of their state's fields to roles; a part of a nested
NamedTuple has a path, "memory.covariance". A field with a conventional name (``theta_hat``, ``memory``, ``x_hat``, ``y_hat``,
``filter``) has its role by default, so most laws declare nothing. The roles determine freezing, equilibria, true values, column
names and the comments of exports.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, TypeGuard, runtime_checkable

import numpy as np

from barbalat.protocols import DiscretizedEquations, Value

if TYPE_CHECKING:
    from barbalat.validate import Array

Kind = Literal["estimates", "memory", "predictor", "filter", "other"]

Truth = Callable[["Array", "Array"], "Array | None"]
"""The values to which estimates should converge, from the true theta (p,) and the effectiveness omega (m,) of the plant's
inputs; or None."""

THETA = "theta"
"""The symbol of the problem's parameters; estimates with this symbol are compared with them."""

MEANINGS: dict[Kind, str] = {
    "estimates": "estimates",
    "memory": "memory of the adaptive law",
    "predictor": "state of the predictor",
    "filter": "state of a filter",
    "other": "of the state of the scheme",
}
"""The comments of exported parts whose role has no meaning of its own."""


@dataclass(frozen=True, eq=False)
class Role:
    """The role of one field of a controller's state. Make it by the method named after the role.

    kind     a freeze holds estimates and memory; predictors, filters and everything else continue
    meaning  one phrase, for the comments of exports
    of       the symbol of the estimated quantity, without a hat, or the symbol of the memory; it names the columns in results
    names    (p,) names of the individual estimates, without a hat; by default the symbol with an index
    true     the values to which the estimates should converge; see ``Truth``
    within   the set onto which they are projected, a ``ParameterBox`` or another known set; None without projection
    """

    kind: Kind
    meaning: str = ""
    of: str = ""
    names: tuple[str, ...] | None = None
    true: Truth | None = None
    within: Any = None

    @classmethod
    def estimates(
        cls,
        of: str = THETA,
        *,
        true: Truth | None = None,
        within: Any = None,
        names: tuple[str, ...] | None = None,
        meaning: str = "",
    ) -> Role:
        """The role of estimates of the quantity ``of``, named without a hat: "theta", "k_x", "W".

        Estimates of "theta" are compared with the problem's parameters if there are equally many; others are compared with the
        result of ``true(theta, omega)``, if given. Estimates of "theta" are projected onto the equations' ``box``, if there is
        one; others onto ``within``.
        """
        return cls("estimates", meaning or f"estimates of {of}", of, names, true, within)

    @classmethod
    def memory(cls, meaning: str = "", *, symbol: str = "") -> Role:
        """The role of a law's memory besides the estimates, such as a covariance P(t) or collected data. A freeze holds it.

        Its columns in results are named after the symbol ("P_1_1"), or after the field if no symbol is given.
        """
        return cls("memory", meaning, symbol)

    @classmethod
    def predictor(cls, meaning: str = "") -> Role:
        """The role of the state of a predictor or an observer."""
        return cls("predictor", meaning)

    @classmethod
    def filter(cls, meaning: str = "") -> Role:
        """The role of the state of a signal filter."""
        return cls("filter", meaning)

    @classmethod
    def other(cls, meaning: str = "") -> Role:
        """The role of anything else that the controller integrates."""
        return cls("other", meaning)

    @property
    def rests(self) -> bool:
        """Whether a freeze holds this part of the state."""
        return self.kind in ("estimates", "memory")

    @property
    def comment(self) -> str:
        """A phrase for readers of exported code."""
        return self.meaning or MEANINGS[self.kind]


CONVENTIONAL: Mapping[str, Role] = {
    "theta_hat": Role.estimates(
        meaning="estimates of theta, then of the input gains where they are unknown: law (4), (7), (15) or (21)"
    ),
    "memory": Role.memory(),
    "x_hat": Role.predictor("state of the predictor (8)"),
    "y_hat": Role.predictor("output of the predictor (21)"),
    "filter": Role.filter("state of the filter C(s) of (5), or Q(s) of (14)"),
}
"""The roles of undeclared fields, by their names; any other field has the role ``Role.other()``."""
OTHER = Role.other()
BY_KIND: Mapping[str, Role] = {kind: Role.estimates() if kind == "estimates" else Role(kind) for kind in MEANINGS}
"""The roles that can be declared by the name of their kind alone."""


@runtime_checkable
class DeclaringRoles(Protocol):
    """Equations, or a law with memory, that declare the roles of the parts of their state."""

    @property
    def roles(self) -> Mapping[str, Role | str]:
        """The roles by the names of the state's fields, or by paths into nested ones; a role may be given by its kind alone."""
        ...


_declaring: dict[type, bool] = {}


def _declares(part: Any) -> TypeGuard[DeclaringRoles]:
    """Whether the part declares roles; cached for each class, because the check is slow and every member of an ensemble needs
    it."""
    kind = type(part)
    if kind not in _declaring:
        _declaring[kind] = isinstance(part, DeclaringRoles)
    return _declaring[kind]


def declared_roles(equations: Any) -> Mapping[str, Role] | None:
    """The roles that equations declare, or that the continuous equations behind sampled ones declare; None without declared
    roles."""
    if _declares(equations):
        accepted: Mapping[str, Role] = _accepted(equations.roles)
        return accepted
    return declared_roles(equations.continuous) if isinstance(equations, DiscretizedEquations) else None


def _accepted(declared: Any) -> Any:
    """The declared roles, each given as a role or by its kind; invalid ones are kept, and rejected by the check of the
    equations."""
    if not isinstance(declared, Mapping):
        return declared
    return {path: BY_KIND.get(given, given) if isinstance(given, str) else given for path, given in declared.items()}


def roles_of(equations: Any) -> Mapping[str, Role]:
    """The conventional roles, overridden by those that the equations declare."""
    return {**CONVENTIONAL, **(declared_roles(equations) or {})}


def within(field: str, part: Any) -> dict[str, Role]:
    """The roles that a part with a state, such as an adaptive law, declares for its state in ``field``."""
    declared = _accepted(part.roles) if _declares(part) else {}
    return {f"{field}.{path}": role for path, role in declared.items()}


def role_at(roles: Mapping[str, Role], path: str) -> Role:
    """The role of a leaf of the state: its declared role, or the role of the nearest enclosing part."""
    while path:
        if path in roles:
            return roles[path]
        path = path.rpartition(".")[0]
    return OTHER


class StatePart(NamedTuple):
    """One array of a controller's state: its path, its role, its shape, and its position in the flat state."""

    path: str
    role: Role
    shape: tuple[int, ...]
    start: int

    @property
    def size(self) -> int:
        return int(np.prod(self.shape, dtype=int))

    @property
    def rows(self) -> slice:
        return slice(self.start, self.start + self.size)

    @property
    def name(self) -> str:
        """The part's name in results, which includes the names of the enclosing parts."""
        return self.path.replace(".", "_")

    @property
    def symbol(self) -> str:
        """The symbol of the part's role, without a hat, or the field's name."""
        return self.role.of or self.path.rpartition(".")[2].removesuffix("_hat")

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its entries, (size,), without a hat: the names of the estimates, or the symbol with an index."""
        if self.role.names is not None:
            return self.role.names
        if self.role.of == THETA:
            return tuple(f"{THETA}_{i + 1}" for i in range(self.size))
        between = "," if "_" in self.symbol else "_"
        return (self.symbol,) if self.size == 1 else tuple(f"{self.symbol}{between}{i + 1}" for i in range(self.size))


def column_names(parts: Iterable[StatePart], taken: Container[str]) -> dict[StatePart, str]:
    """Column names that differ from those ``taken``: the last part of a path, or the whole path if two would be equal."""
    short = {part: part.role.of or part.path.rpartition(".")[2] for part in parts}
    named = Counter(short.values())
    long = {part: name if named[name] == 1 else part.name for part, name in short.items()}
    return {part: f"controller_{name}" if name in taken else name for part, name in long.items()}


def entry_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """The names of an array's entries, row by row, "x_hat_2", "P_1_2"; a scalar has the name without indices."""
    return ["_".join([name, *(str(i + 1) for i in place)]) for place in np.ndindex(shape)]


def hatted(name: str) -> str:
    """The name of an estimate with its hat, in plain letters: theta_hat_1 for theta_1, W_hat_0 for W_0."""
    symbol, _, index = name.partition("_")
    return f"{symbol}_hat_{index}" if index else f"{symbol}_hat"


def state_parts(equations: Any, initial: Any, start: int = 0) -> tuple[StatePart, ...]:
    """All arrays of a state with their roles, in the order of the flat state; the first one begins at ``start``."""
    roles, found = roles_of(equations), []
    for path, array in leaves(initial):
        part = StatePart(path, role_at(roles, path), np.shape(array), start)
        found.append(part)
        start += part.size
    return tuple(found)


def main_estimates(parts: tuple[StatePart, ...]) -> StatePart | None:
    """The estimates that results call ``theta_hat``: those in the field of that name, or else the first estimates of the state;
    None without estimates."""
    found = [part for part in parts if part.role.kind == "estimates"]
    return next((part for part in found if part.path == "theta_hat"), found[0] if found else None)


def taken_from(state: Any, part: StatePart | None) -> Value:
    """The entries of a part of a controller's state, flat; (0,) if the part is None."""
    return np.zeros(0) if part is None else next(array for path, array in leaves(state) if path == part.path).reshape(-1)


def resting(frozen: Value, roles: Mapping[str, Role], old: Any, new: Any, path: str = "") -> Any:
    """``new``, with the estimates and the memory of ``old`` wherever ``frozen`` is true; nested NamedTuples are traversed."""
    if not isinstance(new, tuple):
        return np.where(frozen, old, new) if role_at(roles, path).rests else new
    named = zip(names_of(new), old, new, strict=True)
    parts = [resting(frozen, roles, one, other, f"{path}.{name}" if path else name) for name, one, other in named]
    return tuple(parts) if type(new) is tuple else type(new)(*parts)


def names_of(state: tuple[Any, ...]) -> tuple[str, ...]:
    """The field names of a NamedTuple, or the indices of any other tuple."""
    named: Any = type(state)
    return tuple(named._fields) if hasattr(named, "_fields") else tuple(map(str, range(len(state))))


def leaves(state: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """The arrays of a nested NamedTuple with their paths."""
    if not isinstance(state, tuple):
        yield place, state
        return
    for name, part in zip(names_of(state), state, strict=True):
        yield from leaves(part, f"{place}.{name}" if place else name)


@runtime_checkable
class Estimating(Protocol):
    """Equations, sampled or not, of a scheme that estimates parameters. Its excitation can be measured along a run."""

    def regressor_at(self, state: Any, x: Value, u: Value) -> Value:
        """The regressor that multiplies the parameters in the law, (p,) or (p, m); normalised if the law normalises it."""
        ...
