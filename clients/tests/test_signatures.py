"""Fakes refuse what the stubs of hosts do not have."""

from __future__ import annotations

import pytest
from signatures import Stub

import stubs

MAYA, HOUDINI, UNREAL = Stub(stubs.MAYA), Stub(stubs.HOUDINI), Stub(stubs.UNREAL)


def test_a_method_that_is_not_there() -> None:
    class Fake:
        def nothing(self) -> None: ...

    with pytest.raises(AssertionError, match="no nothing"):
        HOUDINI.like("SopNode")(Fake)


def test_methods_of_bases_are_there_and_others_arguments_are_refused() -> None:
    @HOUDINI.like("SopNode")
    class Fake:
        def path(self) -> str:
            return "/obj"

        def geometryAtFrame(self, frame: float, at: int = 0) -> None: ...

    assert Fake().path() == "/obj"
    Fake().geometryAtFrame(3.0)
    with pytest.raises(TypeError, match="does not take"):
        Fake().geometryAtFrame(3.0, at=1)


def test_any_overload_will_do_and_no_other_flag() -> None:
    @MAYA.module
    class Fake:
        @staticmethod
        def progressWindow(**flags: object) -> bool:
            return True

    assert Fake.progressWindow(query=True, isCancelled=True)
    assert Fake.progressWindow(title="a", progress=0)
    for wrong in ({"titel": "a"}, {"query": True}, {"query": True, "endProgress": True}):
        with pytest.raises(TypeError, match="does not take"):
            Fake.progressWindow(**wrong)


def test_a_class_method_is_called_on_the_class() -> None:
    @UNREAL.like("EditorAssetLibrary")
    class Fake:
        def save_loaded_asset(self, asset: object) -> bool:
            return True

    assert Fake().save_loaded_asset(1)
    with pytest.raises(TypeError, match="does not take"):
        Fake().save_loaded_asset(1, 2, 3)


def test_what_is_cut_has_its_bases_first() -> None:
    text = stubs.cut(stubs.text(stubs.UNREAL), ["Texture2D"])
    places = [text.index(f"\nclass {name}(") for name in ("_ObjectBase", "Object", "Texture2D")]
    assert places == sorted(places)
