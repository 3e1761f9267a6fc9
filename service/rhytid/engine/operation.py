"""What an operation of an engine is: a row that says what it addresses and what it does.

`engine/operations.py` enters one for each of its methods. Everything that carries operations to an
engine (the process of a device, a fleet) reads these rows, and nothing else lists operations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from inspect import signature
from typing import Any, Literal, TypeVar

# What the first arguments of an operation name: nothing, every asset, the content that makes an
# asset, an asset, all frames of an asset, a frame of an asset, a job.
Addressed = Literal["engine", "assets", "content", "asset", "frames", "frame", "job"]
# `drop`: the local copy of an asset may go; the answer says whether it did.
Effect = Literal["read", "create", "change", "remove", "drop"]
Method = TypeVar("Method", bound=Callable[..., Any])


@dataclass(frozen=True, eq=False)
class Operation:
    """One row.

    part, method: the attribute of the engine and its method, such as `tiles` and `draw`; part is
    empty for methods of the engine itself.  addresses: what the first arguments name.  effect: what
    it does to that.  spread: any engine that has the asset may do it.  constant: of an asset the
    answer stays the same for as long as the asset exists.  parameters: names of the arguments that
    may come by place.  name: part and method, such as `tiles.draw`.

    Every operation may be sent again: doing it twice is doing it once, but that the second removal
    finds nothing.
    """

    part: str
    method: str
    addresses: Addressed
    effect: Effect = "read"
    spread: bool = False
    constant: bool = False
    parameters: tuple[str, ...] = ()
    name: str = field(init=False)

    def __post_init__(self) -> None:
        name = f"{self.part}.{self.method}" if self.part else self.method
        object.__setattr__(self, "name", name)

    @property
    def mends(self) -> bool:
        """Whether it replaces or removes what may be damaged: it is tried all the same."""
        return self.effect != "read" and self.addresses in ("asset", "content")

    def of(self, engine: Any) -> Callable[..., Any]:
        """The method of an engine."""
        owner = getattr(engine, self.part) if self.part else engine
        method: Callable[..., Any] = getattr(owner, self.method)
        return method

    def placed(
        self, positional: tuple[Any, ...], named: Mapping[str, Any]
    ) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """The arguments of a call, by place where they may be: what it addresses comes first."""
        rest = dict(named)
        for name in self.parameters[len(positional) :]:
            if name not in rest:
                break
            positional = (*positional, rest.pop(name))
        return positional, rest


class Operations(dict[str, Operation]):
    """Rows by their names, in the order in which they are entered."""

    def operation(
        self,
        addresses: Addressed,
        effect: Effect = "read",
        *,
        spread: bool = False,
        constant: bool = False,
    ) -> Callable[[Method], Method]:
        """Enter a method of a protocol as an operation; arguments as of `Operation`."""

        def enter(method: Method) -> Method:
            protocol, _, name = method.__qualname__.partition(".")
            part = "" if protocol == "Engine" else protocol.lower()
            _, *found = signature(method).parameters.values()
            parameters = tuple(one.name for one in found if one.kind is one.POSITIONAL_OR_KEYWORD)
            row = Operation(part, name, addresses, effect, spread, constant, parameters)
            self[row.name] = row
            return method

        return enter
