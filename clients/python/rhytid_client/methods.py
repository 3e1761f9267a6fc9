"""What the methods of both clients share: a signature, a docstring and a time to answer."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

# A tile may wait for its precomputed maps, so an answer gets longer than a connection.
ANSWER_SECONDS = 300.0
CONNECT_SECONDS = 10.0

M = TypeVar("M", bound=Callable[..., Any])


def described(method: M, call: Callable[..., Any]) -> M:
    """Give `method` the name, docstring and signature of `call`, with `self` in front."""
    wraps(call)(method)
    signature = inspect.signature(call)
    first = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    result = str(signature.return_annotation).removeprefix("Flow[").removesuffix("]")
    parameters = [first, *signature.parameters.values()]
    shown = signature.replace(parameters=parameters, return_annotation=result)
    method.__signature__ = shown  # type: ignore[attr-defined]
    return method
