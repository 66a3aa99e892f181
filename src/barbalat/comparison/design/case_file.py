"""Writes the case file with the designed controller in place of its controllers, and reads it back before returning it."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import Any

import numpy as np
import tomlkit

from barbalat.adaptation.laws import LAWS
from barbalat.cases.load import CaseText
from barbalat.controllers import SCHEMES, Sampled
from barbalat.linear.systems import StateSpace, TransferFunction
from barbalat.protocols import Controller
from barbalat.validate import InputError

NEGATIVE_ZERO = re.compile(r"-0\.(?![0-9])")
"""A value that is indistinguishable from 0 in a transfer function."""


def with_controller(text: CaseText, controller: Controller) -> str:
    """Return the text with only this controller.

    Raises InputError if one of its settings cannot be written in a case file or is read back differently.
    """
    document = tomlkit.parse(text.text)
    tables = tomlkit.aot()
    tables.append(tomlkit.item(_table(controller)))
    document["controller"] = tables
    written = tomlkit.dumps(document)
    controllers = replace(text, text=written, own=None).case().controllers  # only a baseline joins the states
    read = next(one for one in controllers if one.name == controller.name)
    if NEGATIVE_ZERO.sub("0.", repr(read)) != NEGATIVE_ZERO.sub("0.", repr(controller)):
        raise InputError(f"{controller.name} is read back from its case file as {read!r} instead of {controller!r}")
    return written


def _table(controller: Any) -> dict[str, Any]:
    sampling: dict[str, Any] = {}
    if isinstance(controller, Sampled):
        sampling = {"sample_time": controller.sample_time, "discretization": controller.discretization}
        controller = controller.controller
    scheme = {kind.__name__: name for name, kind in SCHEMES.items()}.get(type(controller).__name__)
    if scheme is None:
        raise InputError(f"{controller.name} does not belong to a registered scheme, so a case file cannot name it")
    return {"name": controller.name, "scheme": scheme, **_given(controller), **sampling}


def _given(settings: Any) -> dict[str, Any]:
    """Return the fields that differ from their defaults."""
    found = {}
    for one in fields(settings):
        value = getattr(settings, one.name)
        default = one.default if one.default_factory is MISSING else one.default_factory()
        if one.init and one.name != "name" and value is not None and not _same(value, default):
            found[one.name] = _plain(value)
    return found


def _same(value: Any, default: Any) -> bool:
    if default is MISSING or isinstance(value, np.ndarray):
        return False
    return value is default or (type(value) is type(default) and bool(value == default))


def _plain(value: Any) -> Any:
    """Return the value in a form that TOML can represent."""
    if isinstance(value, StateSpace):
        value = value.transfer_function()
    if isinstance(value, TransferFunction):
        return {"num": [float(one) for one in value.num], "den": [float(one) for one in value.den]}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (bool, int, float, str)):
        return value
    if is_dataclass(value):
        kind = {law.__name__: name for name, law in LAWS.items()}.get(type(value).__name__)
        return _given(value) if kind is None else {"kind": kind, **_given(value)}
    raise InputError(f"{value!r} cannot be expressed in a case file")
