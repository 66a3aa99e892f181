"""Checks of user input: each error is one sentence with the field, the value and an admissible value."""

from __future__ import annotations

import math
import os
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import is_dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Self, TypeAlias, TypeVar

import numpy as np

Array: TypeAlias = Any
"""A NumPy array of floats; the shape is documented where an array is declared. The type is Any because constructors accept
whatever NumPy can convert to an array."""
Vector: TypeAlias = Annotated[Any, "vector"]
"""A one-dimensional NumPy array of floats. The type of a field determines what case files may contain."""
Matrix: TypeAlias = Annotated[Any, "matrix"]
"""A two-dimensional NumPy array of floats."""


class InputError(ValueError):
    """Unusable input: one sentence for the user, or several if more than one problem was found.

    field       the field with which the message begins, dotted as in a case file, so no caller adds its path again
    controller  the name of the controller that the sentence names
    """

    def __init__(self, *sentences: str, field: str = "", controller: str = "") -> None:
        super().__init__("; also: ".join(sentences))
        self.sentences = sentences
        self.field = field
        self.controller = controller

    @classmethod
    def of(cls, field: str, what: str) -> InputError:
        """An error whose message begins with the field and states the requirement and the given value."""
        return cls(f"{field} {what}", field=field)


def show(value: Any) -> str:
    """A value as it appears in a message: short and on one line; an array appears as the list that was typed."""
    try:
        text = repr(value.tolist() if isinstance(value, np.ndarray) and value.size <= MOST_SHOWN else value)
    except RecursionError:
        text = f"a {type(value).__name__} nested too deeply to be shown"
    except ValueError:  # Python refuses to print whole numbers of more than 4300 digits
        text = f"a {type(value).__name__} of too many digits to be shown"
    text = " ".join(text.split())
    return text if len(text) <= 100 else text[:97] + "..."


MOST_SHOWN = 36
"""The number of entries of an array that are shown at a prompt; a larger array is shown by its first and last entries."""


def number(field: str, value: Any) -> float:
    """Return the value as a float if it is a finite real number; raise InputError otherwise."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError.of(field, f"must be a number, got {show(value)}")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError.of(field, f"must be finite, got {show(value)}")
    return result


def whole(field: str, value: Any, least: int, most: int | None = None) -> int:
    """Return the value as an int if it is a whole number from ``least`` to ``most``; raise InputError otherwise."""
    is_whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):
        limits = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise InputError.of(field, f"must be a whole number {limits}, got {show(value)}")
    return int(value)


def positive(field: str, value: Any) -> float:
    """Return the value as a float if it is finite and above zero; raise InputError otherwise."""
    result = number(field, value)
    if result <= 0:
        raise InputError.of(field, f"must be positive, got {show(value)}")
    return result


def not_negative(field: str, value: Any) -> float:
    """Return the value as a float if it is finite and not negative; raise InputError otherwise."""
    result = number(field, value)
    if result < 0:
        raise InputError.of(field, f"must not be negative, got {show(value)}")
    return result


def array(field: str, value: Any, shape: tuple[int | None, ...]) -> Array:
    """Return a read-only copy as an array of finite floats; ``None`` in ``shape`` means any positive size."""
    try:
        given = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError.of(field, f"must be an array of numbers, got {show(value)}") from None
    if np.ma.is_masked(value):
        raise InputError.of(field, f"must not have masked entries, got {show(value)}")
    if given.dtype.kind not in "iuf":
        raise InputError.of(field, f"must be an array of real numbers, got {show(value)}")
    with np.errstate(over="ignore"):  # a longer floating-point number that does not fit becomes infinite and is rejected below
        result = np.array(given, dtype=np.float64)
    fits = result.ndim == len(shape) and all(s == k or (s is None and k > 0) for s, k in zip(shape, result.shape, strict=True))
    if not fits:
        wanted = " x ".join("n" if s is None else str(s) for s in shape)
        got = " x ".join(map(str, result.shape)) or "a number"
        raise InputError.of(field, f"must have shape {wanted}, got {got}: {show(value)}")
    if not np.isfinite(result).all():
        raise InputError.of(field, f"must be finite, got {show(value)}")
    result.flags.writeable = False
    return result


def dimensions(value: Any) -> int:
    """The nesting depth of a value; 0 for values that are not arrays, which ``array`` rejects."""
    try:
        return int(np.asarray(value).ndim)
    except (TypeError, ValueError, OverflowError):  # rows of different lengths, ...
        return 0


def vector(field: str, value: Any, size: int | None = None) -> Array:
    """A read-only vector (size,), of any size if none is given."""
    return array(field, value, (size,))


def by_rows(field: str, value: Any, size: int | None = None) -> Array:
    """A read-only vector (size,), from a vector or row by row from a matrix."""
    return vector(field, array(field, value, (None, None)).reshape(-1) if dimensions(value) == 2 else value, size)


def square_matrix(field: str, value: Any, size: int | None = None) -> Array:
    """A read-only square matrix."""
    result = array(field, value, (size, size))
    if result.shape[0] != result.shape[1]:
        raise InputError.of(field, f"must be square, got {result.shape[0]} x {result.shape[1]}: {show(value)}")
    return result


_INSTANCES: set[tuple[type, Any]] = set()
"""Cached answers: dataclasses and the types of which they are instances. A protocol check takes 10 us, and thousands are
needed."""


def is_instance(value: Any, kind: type | tuple[type, ...]) -> bool:
    """Like ``isinstance``, but the answer is cached for classes whose instances all have the same attributes."""
    if (type(value), kind) in _INSTANCES:
        return True
    found = isinstance(value, kind)
    if found and is_dataclass(value) and not isinstance(value, type):
        _INSTANCES.add((type(value), kind))
    return found


def instance(field: str, value: Any, kind: type | tuple[type, ...]) -> None:
    """Raise InputError for an object of a different type; the message names the right types."""
    if not is_instance(value, kind) or isinstance(value, type):  # a class has the attributes that a protocol requires
        names = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
        raise InputError.of(field, f"must be a {names}, got {show(value)}")


UNSHOWABLE = ("Cc", "Cs", "Cn", "Zl", "Zp")
"""Unicode categories that XML can't contain: control characters, surrogates, unassigned code points, line ends."""
TURNING = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
"""Bidirectional classes of characters that reverse the direction of the following text, even beyond the end of the name."""


def line(field: str, value: Any) -> str:
    """Text that every page, picture and terminal can show on one line; it may be empty."""
    if not isinstance(value, str):
        raise InputError.of(field, f"must be a string, got {show(value)}")
    if _may_control(value) and any(map(_controls, value)):
        raise InputError.of(field, f"must not contain control characters, got {value!a}")
    return value


URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/")
"""Pattern of the beginning of a URL, even after ``Path`` has merged its two slashes into one. A Windows drive, a single letter,
does not match."""


def local_path(field: str, given: str | Path) -> Path:
    """A path on this computer; a leading ``~`` is expanded to the home folder, as in a shell.

    Raises InputError for a URL, which ``Path`` would interpret as a folder named after the scheme.
    """
    text = str(given)
    if URL.match(text):
        raise InputError.of(field, f"must be a path on this computer, not a URL, got {show(text)}")
    path = Path(os.path.expanduser(text))  # noqa: PTH111  # leaves an unknown user's name as it is; Path's method raises
    shortened = text.startswith(".") and (URL.match(str(path)) or str(path).startswith("~"))
    return path.absolute() if shortened else path  # Path removed the ./ that distinguished a local s3:/x or ~


def counted(count: int, one: str) -> str:
    """A number with its noun: "1 step", "2 steps", "3 entries"."""
    several = f"{one[:-1]}ies" if one.endswith("y") else f"{one}s"
    return f"{count} {one if count == 1 else several}"


def nearest(given: object, known: Iterable[str]) -> str | None:
    """The known name whose spelling is closest to the given one; None if none is close."""
    from difflib import get_close_matches

    names = list(known)
    small = {name.lower(): name for name in reversed(names)}
    near = get_close_matches(str(given), names, n=1) or [small[one] for one in get_close_matches(str(given).lower(), small, n=1)]
    return near[0] if near else None


def hint(given: object, known: Iterable[str]) -> str:
    """The end of an error message, which suggests the known name with the closest spelling; empty if none is close."""
    near = nearest(given, known)
    return "" if near is None else f"; did you mean {near!r}?"


MOST_LISTED = 12
"""The largest number of names that are listed if no name is close to the given one."""


class UnknownNameError(KeyError):
    """A KeyError whose message is shown without quotation marks around it."""

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


def unknown_name(kind: str, given: object, known: Iterable[str]) -> UnknownNameError:
    """The error for an unknown name: it suggests the closest name, or lists the known names."""
    names = list(known)
    listed = ", ".join(map(repr, names[:MOST_LISTED])) + (", ..." if len(names) > MOST_LISTED else "")
    said = hint(given, names) or (f"; known here: {listed}" if names else "; there is none")
    return UnknownNameError(f"there is no {kind} {show(given)}{said}")


V = TypeVar("V")


class Named(dict[str, V]):
    """A dictionary keyed by names that people type; the KeyError for an unknown name suggests the closest one.

    kind    what the names denote, in words
    absent  why some names are absent, each as the end of a sentence: "error_bound does not apply (...)"
    """

    kind = "name"
    absent: Mapping[str, str] = MappingProxyType({})

    @classmethod
    def of(cls, kind: str, values: Mapping[str, V], absent: Mapping[str, str] | None = None) -> Self:
        """Return a mapping of these values."""
        found = cls(values)
        found.kind, found.absent = kind, dict(absent or {})
        return found

    def __missing__(self, name: str) -> V:
        if name in self.absent:
            raise UnknownNameError(f"{name} {self.absent[name]}")
        raise unknown_name(self.kind, name, [*self, *self.absent])


def printable(text: str) -> str:
    """The text with its control characters escaped, so they have no effect on a terminal."""
    return "".join(ascii(c)[1:-1] if _controls(c) else c for c in text) if _may_control(text) else text


def _may_control(text: str) -> bool:
    return not (text.isascii() and text.isprintable())


def _controls(character: str) -> bool:
    return unicodedata.category(character) in UNSHOWABLE or unicodedata.bidirectional(character) in TURNING


def label(field: str, value: Any) -> str:
    """Return the value if it is a non-empty text; raise InputError otherwise."""
    if not isinstance(value, str) or not value:
        raise InputError.of(field, f"must be a nonempty string, got {show(value)}")
    return line(field, value)


def require_extra(module: str, name: str, purpose: str) -> None:
    """Raise InputError if an optional package is missing; the message names the extra that installs it."""
    if find_spec(module) is None:
        raise InputError(f"{purpose} needs the package {module}, which is not installed: pip install 'barbalat[{name}]'")


def read_only(part: Any) -> None:
    """Make all arrays within a dataclass read-only; NumPy's copies and unpickled arrays are writable."""
    if isinstance(part, np.ndarray):
        part.flags.writeable = False
    elif isinstance(part, (list, tuple)):
        for entry in part:
            read_only(entry)
    elif is_dataclass(part):
        for entry in vars(part).values():
            read_only(entry)


def freeze(part: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass to their validated values, in its constructor."""
    for name, value in values.items():
        object.__setattr__(part, name, value)


def signal_values(signal: object, t: Array) -> Array:
    """The values of a signal at these times; raises InputError unless there is one finite real number for each time."""
    given = signal(t)  # type: ignore[operator]
    try:
        values = np.asarray(given)
    except (TypeError, ValueError):  # rows of different lengths, ...
        values = np.array(None)
    if values.dtype.kind not in "biuf":
        raise InputError(f"a signal must return real numbers, got {show(given)}: {show(signal)}")
    values = values.astype(np.float64, copy=False)
    if values.shape != t.shape:
        raise InputError(f"a signal must return one value for each time, got shape {values.shape} for {t.shape}: {show(signal)}")
    if not np.isfinite(values).all():
        i = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InputError(f"a signal must be finite, got {values[i]} at t = {t[i]:g} s: {show(signal)}")
    return values
