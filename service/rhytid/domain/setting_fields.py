"""Settings as frozen dataclasses that read themselves from JSON, strictly.

A field declares its range or its choices where it stands::

    beta_w: float = number(4.0, 0.0, 64.0)

so that a mistake is answered with its path: ``response.beta_w is -1: from 0 to 64``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import Field, field, fields, is_dataclass, replace
from difflib import get_close_matches
from typing import Any, TypeVar

from rhytid.errors import SettingsError

T = TypeVar("T")


def number(default: float | None, low: float, high: float) -> Any:
    """A finite float in [low, high]; None as default allows null: to be resolved later."""
    return field(default=default, metadata={"low": low, "high": high, "whole": False})


def whole(default: int | None, low: int, high: int) -> Any:
    """An integer in [low, high]; None as default allows null: to be resolved later."""
    return field(default=default, metadata={"low": low, "high": high, "whole": True})


def power_of_two(default: int, low: int, high: int) -> Any:
    """A power of two in [low, high]."""
    return field(default=default, metadata={"low": low, "high": high, "whole": True, "power": True})


def choice(default: Any, *options: Any) -> Any:
    """One of `options`."""
    return field(default=default, metadata={"options": options})


def text(default: str | None, longest: int) -> Any:
    """A short string; None as default allows null: to be resolved later."""
    return field(default=default, metadata={"longest": longest})


def read(base: T, data: Mapping[str, Any], path: str = "") -> T:
    """A copy of the dataclass instance `base` with the values of `data` put in.

    Raises SettingsError naming the path of the first key or value that is wrong.
    """
    known = {f.name: f for f in fields(base)}  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    for key, value in data.items():
        if key not in known:
            raise SettingsError(_unknown(path, key, value, list(known)))
        changes[key] = _value(known[key], getattr(base, key), value, path + key)
    return replace(base, **changes)  # type: ignore[type-var]


def _value(declared: Field[Any], current: Any, value: Any, path: str) -> Any:
    if is_dataclass(current):
        if not isinstance(value, Mapping):
            raise SettingsError(f"{path} is {value!r}: must be an object")
        return read(current, value, path + ".")
    rule = declared.metadata
    if "options" in rule:
        return _option(rule["options"], value, path)
    if value is None and declared.default is None:
        return None
    if "longest" in rule:
        return _text(rule["longest"], value, path)
    return _number(declared, value, path)


def _option(options: tuple[Any, ...], value: Any, path: str) -> Any:
    for option in options:
        if type(option) is type(value) and option == value:
            return option
    listed = ", ".join(repr(o) for o in options)
    raise SettingsError(f"{path} is {value!r}: one of {listed}")


def _text(longest: int, value: Any, path: str) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= longest or not value.isprintable():
        raise SettingsError(f"{path} is {value!r}: a string of 1 to {longest} printable characters")
    return value


def _number(declared: Field[Any], value: Any, path: str) -> float | int:
    rule = declared.metadata
    allowed = (int,) if rule["whole"] else (int, float)
    kind = "a whole number" if rule["whole"] else "a number"
    if isinstance(value, bool) or not isinstance(value, allowed):
        raise SettingsError(f"{path} is {value!r}: must be {kind}")
    if not rule["low"] <= value <= rule["high"] or not math.isfinite(value):
        raise SettingsError(f"{path} is {value!r}: from {rule['low']:g} to {rule['high']:g}")
    if not rule["whole"]:
        return float(value)
    if rule.get("power") and int(value).bit_count() != 1:
        raise SettingsError(f"{path} is {value!r}: must be a power of two")
    return value


def _unknown(path: str, key: str, value: Any, known: list[str]) -> str:
    group, dot, _ = str(key).partition(".")
    if dot and group in known:
        whole = _nested(f"{path}{key}".split("."), value)
        return f"unknown setting {path}{key}: settings are nested, as {whole}"
    near = get_close_matches(str(key), known, n=1)
    hint = f"; did you mean {path}{near[0]}?" if near else f"; known here: {', '.join(known)}"
    return f"unknown setting {path}{key}{hint}"


def _nested(names: list[str], value: Any) -> str:
    for name in reversed(names):
        value = {name: value}
    return json.dumps(value, default=str)
