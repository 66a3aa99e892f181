"""A case file with other numbers and everything else as it was written, its comments too."""

from __future__ import annotations

from collections.abc import Mapping

from barbalat.open_numbers.path import FieldPath


def with_numbers(text: str, numbers: Mapping[FieldPath, float]) -> str:
    """The TOML text with numbers at some places."""
    import tomlkit

    document = tomlkit.parse(text)
    for path, value in numbers.items():
        path.put(document, value)
    return tomlkit.dumps(document)
