"""Which shapes of a face are meant by a name: ARKit's, and other spellings of the same."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence

# `Left`, `_L`, `.l`, or `L` after a lower-case letter, at the end.
_SIDE = re.compile(r"(?:[ ._-]?(?:(left)|(right))|[ ._-](?:(l)|(r)))$", re.IGNORECASE)
_LETTER = re.compile(r"(?<=[a-z])(?:(L)|(R))$")
_PREFIX = re.compile(r"[.:|/]")
LEFT, RIGHT, BOTH = "left", "right", ""


def name_parts(name: str) -> tuple[str, str]:
    """The stem in lower case and the side of a shape's name: `eyeBlink_L`, `EyeBlinkLeft` and
    `face|eyeBlink.L` are all ("eyeblink", "left"). The side is empty where the name has none."""
    side = BOTH
    found = _SIDE.search(name) or _LETTER.search(name)
    if found is not None and found.start():
        groups = found.groups()
        side = LEFT if any(groups[0::2]) else RIGHT
        name = name[: found.start()]
    stem = re.sub(r"[^a-z0-9]", "", _PREFIX.split(name)[-1].lower())
    return stem, side


def meant_shapes(wanted: Sequence[str], known: Sequence[str]) -> list[tuple[int, ...]]:
    """For each wanted name the indices of the shapes that it means; empty for none.

    A name that is there as it is means that one. Else spellings are compared, and a name without a
    side means both where a face has them apart: `browInnerUp` of ARKit is `browInnerUp_L` and
    `browInnerUp_R`.
    """
    exact = {name: index for index, name in reversed(list(enumerate(known)))}
    by_parts: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    for index, name in enumerate(known):
        by_parts[name_parts(name)].append(index)

    def meant(name: str) -> tuple[int, ...]:
        if name in exact:
            return (exact[name],)
        stem, side = name_parts(name)
        found = by_parts.get((stem, side), [])[:1]
        if not found and side == BOTH:
            found = [i for half in (LEFT, RIGHT) for i in by_parts.get((stem, half), [])[:1]]
        return tuple(found)

    return [meant(name) for name in wanted]
