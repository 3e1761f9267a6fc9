"""The settings of an asset as a JSON schema, made of their declarations and meanings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from rhytid.domain.setting_meanings import MEANINGS

Schema = dict[str, Any]
# Bounds of this size stand for none.
UNBOUNDED = 1e30
_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", type(None): "null"}


def settings_of(settings: Any, path: str = "") -> Iterator[tuple[str, Any, Mapping[str, Any]]]:
    """Dotted name, default and rule of every setting of a dataclass and of those in it."""
    for declared in fields(settings):
        value = getattr(settings, declared.name)
        if is_dataclass(value):
            yield from settings_of(value, f"{path}{declared.name}.")
        else:
            yield path + declared.name, value, declared.metadata


def settings_schema(settings: Any, names: tuple[str, ...] | None = None) -> Schema:
    """A JSON schema (2020-12) of a dataclass of settings, whose values are the defaults.

    names: the top-level keys that it has, all of them where None.
    """
    schema = _object()
    for name, default, rule in settings_of(settings):
        *groups, last = name.split(".")
        if names is not None and name.split(".")[0] not in names:
            continue
        place = schema
        for group in groups:
            place = place["properties"].setdefault(group, _object())
        place["properties"][last] = {
            **_allowed(default, rule),
            "default": default,
            "description": MEANINGS[name],
        }
    return schema


def _object() -> Schema:
    return {"type": "object", "additionalProperties": False, "properties": {}}


def _allowed(default: Any, rule: Mapping[str, Any]) -> Schema:
    """What the value may be."""
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
