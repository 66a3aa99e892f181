"""What a finished sweep can be asked: all members' columns, one column at a time."""

from __future__ import annotations

from typing import Protocol

from barbalat.validate import Array


class Rows(Protocol):
    """What a finished sweep can be asked."""

    @property
    def names(self) -> list[str]:
        """Of the columns, in their order."""
        ...

    def column(self, name: str) -> Array:
        """(M,) by the members' numbers."""
        ...

    def row(self, member: int) -> dict[str, float]:
        """The numbers of one member, by column."""
        ...
