"""The requested keys of a certificate: expensive parts on which no other part depends are omitted if they are not requested.

A search certifies hundreds of tunings for one or two values each. The request is not a setting of a scheme and changes no
value, so it is passed directly to the few expensive parts, not through the schemes' files.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_NEEDED: ContextVar[frozenset[str] | None] = ContextVar("needed", default=None)
_LEFT_OUT: ContextVar[frozenset[str]] = ContextVar("left_out", default=frozenset())


@contextmanager
def needing(keys: Collection[str] | None) -> Iterator[None]:
    """In this block, certificates may lack expensive values that are not among these keys. With None they are complete."""
    token = _NEEDED.set(None if keys is None else frozenset(keys))
    try:
        yield
    finally:
        _NEEDED.reset(token)


@contextmanager
def leaving_out(*keys: str) -> Iterator[None]:
    """In this block, certificates lack these keys, because something else is computed in their place."""
    token = _LEFT_OUT.set(_LEFT_OUT.get() | frozenset(keys))
    try:
        yield
    finally:
        _LEFT_OUT.reset(token)


def is_needed(*keys: str) -> bool:
    """Whether one of these keys is needed."""
    needed, wanted = _NEEDED.get(), frozenset(keys) - _LEFT_OUT.get()
    return bool(wanted) if needed is None else not needed.isdisjoint(wanted)


def is_left_out(key: str) -> bool:
    """Whether certificates lack this key."""
    return key in _LEFT_OUT.get()
