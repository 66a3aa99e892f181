"""Which of a certificate's keys are needed: a part that costs much, and on which no other rests, is left out where it is not.

A search certifies hundreds of tunings for one or two values of each. What is needed is no setting of a scheme and changes no
value, so it reaches those few parts past the schemes' files, which know nothing of it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_NEEDED: ContextVar[frozenset[str] | None] = ContextVar("needed", default=None)
_LEFT_OUT: ContextVar[frozenset[str]] = ContextVar("left_out", default=frozenset())


@contextmanager
def needing(keys: Collection[str] | None) -> Iterator[None]:
    """Inside, certificates may lack what costs much and is not among these keys; with None they lack nothing."""
    token = _NEEDED.set(None if keys is None else frozenset(keys))
    try:
        yield
    finally:
        _NEEDED.reset(token)


@contextmanager
def leaving_out(*keys: str) -> Iterator[None]:
    """Inside, certificates lack these keys: what takes their place is computed elsewhere."""
    token = _LEFT_OUT.set(_LEFT_OUT.get() | frozenset(keys))
    try:
        yield
    finally:
        _LEFT_OUT.reset(token)


def is_needed(*keys: str) -> bool:
    """Whether one of these keys is."""
    needed, wanted = _NEEDED.get(), frozenset(keys) - _LEFT_OUT.get()
    return bool(wanted) if needed is None else not needed.isdisjoint(wanted)


def is_left_out(key: str) -> bool:
    """Whether certificates lack this key."""
    return key in _LEFT_OUT.get()
