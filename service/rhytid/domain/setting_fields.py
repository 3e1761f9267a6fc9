"""Frozen dataclasses of settings: declared once, read from JSON, and described by a JSON schema.

A field declares its range or its choices; the docstring of its class has a line with its meaning::

    class ResponseSettings:
        \"""Exponents of Alg. 1 and 2.

        beta_w: how much stretch widens a pore (Alg. 2)
        \"""

        beta_w: float = number(4.0, 0.0, 64.0)

A mistake is answered with its path: ``response.beta_w is -1: from 0 to 64``.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import Field, field, fields, is_dataclass, replace
from difflib import get_close_matches
from inspect import getdoc
from typing import Any, NamedTuple, TypeVar

from rhytid.errors import SettingsError

T = TypeVar("T")
Schema = dict[str, Any]
# Bounds of this size stand for none.
UNBOUNDED = 1e30
_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", type(None): "null"}
# `name: what it means`, and lines that go on with it.
_MEANING = re.compile(r"^(\w+): (.+(?:\n +.+)*)", re.MULTILINE)


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
    """One of `options`, by type and value: 1 is neither 1.0 nor true."""
    return field(default=default, metadata={"options": options})


def text(default: str | None, longest: int) -> Any:
    """A string of 1 to `longest` printable characters; None as default allows null."""
    return field(default=default, metadata={"longest": longest})


def read(base: T, data: Mapping[str, Any], path: str = "", beside: tuple[str, ...] = ()) -> T:
    """A copy of the dataclass instance `base` with the values of `data` put in.

    beside: keys that others have read and taken out, to be told with the known ones. Raises
    SettingsError naming the path of the first key or value that is wrong.
    """
    known = {f.name: f for f in fields(base)}  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    for key, value in data.items():
        if key not in known:
            raise SettingsError(_unknown(path, key, value, [*known, *beside]))
        changes[key] = _value(known[key], getattr(base, key), value, path + key)
    return replace(base, **changes)  # type: ignore[type-var]


class Setting(NamedTuple):
    """A setting: its dotted name, its default, its range or choices, and its meaning.

    rule: `options`, or `longest`, or `low`, `high`, `whole` and, where it is true, `power`.
    """

    name: str
    default: Any
    rule: Mapping[str, Any]
    meaning: str


def settings_of(settings: Any, path: str = "") -> Iterator[Setting]:
    """Every setting of a dataclass and of the dataclasses in it; their values are the defaults."""
    meanings = dict(_MEANING.findall(getdoc(settings) or ""))
    for declared in fields(settings):
        value = getattr(settings, declared.name)
        if is_dataclass(value):
            yield from settings_of(value, f"{path}{declared.name}.")
        else:
            meaning = " ".join(meanings.get(declared.name, "").split())
            yield Setting(path + declared.name, value, declared.metadata, meaning)


def settings_schema(settings: Any, names: tuple[str, ...] | None = None) -> Schema:
    """A JSON schema (2020-12) of a dataclass of settings; its values are the defaults.

    names: the top-level keys of the schema; None for all.
    """
    schema = _object()
    for setting in settings_of(settings):
        *groups, last = setting.name.split(".")
        if names is not None and setting.name.split(".")[0] not in names:
            continue
        place = schema
        for group in groups:
            place = place["properties"].setdefault(group, _object())
        place["properties"][last] = {
            **_allowed(setting.default, setting.rule),
            "default": setting.default,
            "description": setting.meaning,
        }
    return schema


def nested(named: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by their dotted names as nested objects: {"a.b": 1} as {"a": {"b": 1}}."""
    found: dict[str, Any] = {}
    for name, value in named.items():
        *groups, last = name.split(".")
        place = found
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    return found


def leaves(settings: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """The inverse of `nested`."""
    found: dict[str, Any] = {}
    for key, value in settings.items():
        inner = isinstance(value, Mapping)
        found |= leaves(value, f"{path}{key}.") if inner else {path + key: value}
    return found


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
    return _number(rule, value, path)


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


def _number(rule: Mapping[str, Any], value: Any, path: str) -> float | int:
    allowed = (int,) if rule["whole"] else (int, float)
    kind = "a whole number" if rule["whole"] else "a number"
    if isinstance(value, bool) or not isinstance(value, allowed):
        raise SettingsError(f"{path} is {value!r}: must be {kind}")
    if not rule["low"] <= value <= rule["high"] or not math.isfinite(value):
        low, high = (f"{rule[end]:{'d' if rule['whole'] else 'g'}}" for end in ("low", "high"))
        raise SettingsError(f"{path} is {value!r}: from {low} to {high}")
    if not rule["whole"]:
        return float(value)
    if rule.get("power") and int(value).bit_count() != 1:
        raise SettingsError(f"{path} is {value!r}: must be a power of two")
    return value


def _unknown(path: str, key: str, value: Any, known: list[str]) -> str:
    group, dot, _ = str(key).partition(".")
    if dot and group in known:
        whole = json.dumps(nested({f"{path}{key}": value}), default=str)
        return f"unknown setting {path}{key}: settings are nested, as {whole}"
    near = get_close_matches(str(key), known, n=1)
    hint = f"; did you mean {path}{near[0]}?" if near else f"; known here: {', '.join(known)}"
    return f"unknown setting {path}{key}{hint}"


def _object() -> Schema:
    return {"type": "object", "additionalProperties": False, "properties": {}}


def _allowed(default: Any, rule: Mapping[str, Any]) -> Schema:
    """Which values the schema allows."""
    if "options" in rule:
        types = list(dict.fromkeys(_TYPES[type(option)] for option in rule["options"]))
        return {"type": types[0] if len(types) == 1 else types, "enum": list(rule["options"])}
    if "longest" in rule:
        return {**_typed("string", default), "minLength": 1, "maxLength": rule["longest"]}
    if rule.get("power"):
        powers = range(rule["low"].bit_length() - 1, rule["high"].bit_length())
        return {"type": "integer", "enum": [2**n for n in powers]}
    return {**_typed("integer" if rule["whole"] else "number", default), **_bounds(rule)}


def _typed(kind: str, default: Any) -> Schema:
    return {"type": [kind, "null"] if default is None else kind}


def _bounds(rule: Mapping[str, Any]) -> Schema:
    low, high = rule["low"], rule["high"]
    if high < UNBOUNDED:
        return {"minimum": low, "maximum": high}
    return {"exclusiveMinimum": 0} if low > 0 else {"minimum": 0}
