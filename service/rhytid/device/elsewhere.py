"""A device used by long work, step by step; tasks of others run in between."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, wraps
from typing import Any, TypeVar

Method = TypeVar("Method", bound=Callable[..., Any])


class Elsewhere:
    """Calls of one thread to a device whose tasks run one at a time.

    call: runs one step in a task of the device, which begins with `check`. Launches gather until
    something else is asked for, and run in the same step.
    """

    def __init__(self, call: Callable[..., Any], check: Callable[[], None] | None = None) -> None:
        self._call, self._checks = call, [] if check is None else [check]
        self._launches: list[Callable[[], None]] = []
        self._made: list[Any] = []

    def later(self, launch: Callable[[], None]) -> None:
        """Launch with the next step."""
        self._launches.append(launch)

    def step(self, task: Callable[[], Any]) -> Any:
        """The result of a task that runs after all launches so far."""
        launches, self._launches = self._launches, []
        return self._call(_in_order, [*self._checks, *launches], task)

    def made(self, task: Callable[[], Any]) -> Any:
        """As `step`, of a task that makes a buffer."""
        buffer = self.step(task)
        self._made.append(buffer)
        return buffer

    def give_back(self) -> None:
        """Release every buffer that was made, and forget launches that wait."""
        self._launches = []
        self._call(_in_order, [buffer.release for buffer in self._made], _nothing)


def by_owner(method: Method) -> Method:
    """Runs a method of a device as a step of a thread that uses it from elsewhere."""

    @wraps(method)
    def run(self: Any, *arguments: Any, **named: Any) -> Any:
        elsewhere = self.elsewhere
        if elsewhere is None:
            return method(self, *arguments, **named)
        return elsewhere.step(partial(method, self, *arguments, **named))

    return run  # type: ignore[return-value]


def making(method: Method) -> Method:
    """As `by_owner`, for a method that makes a buffer."""

    @wraps(method)
    def run(self: Any, *arguments: Any, **named: Any) -> Any:
        elsewhere = self.elsewhere
        if elsewhere is None:
            return method(self, *arguments, **named)
        return elsewhere.made(partial(method, self, *arguments, **named))

    return run  # type: ignore[return-value]


def _in_order(tasks: list[Callable[[], None]], last: Callable[[], Any]) -> Any:
    for task in tasks:
        task()
    return last()


def _nothing() -> None:
    """A task without a result."""
