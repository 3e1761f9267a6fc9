"""What schemathesis is told: media types of ours are bytes, and which maps there are."""

from __future__ import annotations

from typing import Any

import schemathesis
from schemathesis.generation import GenerationMode
from schemathesis.generation.meta import ParameterLocation

THERE = {"udim": 1001, "level": 0}

for media_type in ("application/x-tar", "application/x-npy", "application/vnd.safetensors"):
    schemathesis.serializer.alias(media_type, "application/octet-stream")


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: Any) -> None:
    """Ask for a map that there is, but where the path is wrong on purpose: its configuration would
    put what is right there, too, and call the answer a fault."""
    path = case.meta and case.meta.components.get(ParameterLocation.PATH)
    if path is not None and path.mode is GenerationMode.POSITIVE:
        case.path_parameters.update({k: v for k, v in THERE.items() if k in case.path_parameters})
