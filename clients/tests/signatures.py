"""What a stub says that a host takes: fakes refuse every other call."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable
from functools import cache, wraps
from typing import Any, TypeVar

import stubs

T = TypeVar("T", bound=type)


class Stub:
    """An installed stub, asked for signatures by name."""

    def __init__(self, file: str) -> None:
        self._text = stubs.text(file)

    @cache  # noqa: B019  there are three stubs, which live as long as the tests
    def functions(self, name: str) -> list[inspect.Signature]:
        """The signatures of a function of the module, several where it is overloaded."""
        return _signatures(self._text, "", name)

    @cache  # noqa: B019
    def methods(self, owner: str, name: str) -> list[inspect.Signature]:
        """Those of a method of a class or of its bases."""
        return _signatures(self.text_of(owner), "    ", name)

    @cache  # noqa: B019
    def text_of(self, owner: str) -> str:
        """A class and its bases."""
        found = stubs.cut(self._text, [owner])
        assert re.search(rf"^class {owner}\b", found, re.MULTILINE), f"the stub has no {owner}"
        return found

    def like(self, owner: str) -> Callable[[T], T]:
        """A decorator of a fake of a class: its methods are there, and take what theirs take."""

        def checked(fake: T) -> T:
            for name, method in list(vars(fake).items()):
                if not name.startswith("_") and inspect.isfunction(method):
                    setattr(fake, name, _bound(method, self.methods(owner, name), True))
            return fake

        return checked

    def module(self, fake: T) -> T:
        """The same of functions of the module, static methods of the fake."""
        for name, held in list(vars(fake).items()):
            if isinstance(held, staticmethod) and not name.startswith("_"):
                function = _bound(held.__func__, self.functions(name), False)
                setattr(fake, name, staticmethod(function))
        return fake


def _signatures(text: str, indent: str, name: str) -> list[inspect.Signature]:
    lines = re.findall(rf"^{indent}def {name}\(.*$", text, re.MULTILINE)
    assert lines, f"the stub has no {name}"
    return [_signature(line.strip().removesuffix("...") + " pass") for line in lines]


def _signature(source: str) -> inspect.Signature:
    """Of a function by its first line; defaults are None, annotations are left out."""
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    taken = function.args
    none = ast.Constant(None)
    taken.defaults = [none for _ in taken.defaults]
    taken.kw_defaults = [default and none for default in taken.kw_defaults]
    for one in ast.walk(taken):
        if isinstance(one, ast.arg):
            one.annotation = None
    made = ast.Lambda(taken, none)
    code = compile(ast.fix_missing_locations(ast.Expression(made)), source, "eval")
    return inspect.signature(eval(code))


def _bound(function: Any, known: list[inspect.Signature], method: bool) -> Any:
    """The function, once the call fits one of the signatures."""

    @wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        if not any(_fits(signature, args, kwargs, method) for signature in known):
            raise TypeError(f"{function.__name__} does not take {args} {kwargs}")
        return function(*args, **kwargs)

    return called


def _fits(signature: inspect.Signature, args: Any, kwargs: Any, method: bool) -> bool:
    names = list(signature.parameters)
    if method and (not names or names[0] not in ("self", "cls")):
        args = args[1:]  # static in the host
    try:
        signature.bind(*args, **kwargs)
    except TypeError:
        return False
    return True
