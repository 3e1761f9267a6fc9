"""An Unreal that is made up: a content folder with assets, calls as the stub has them. It refuses
properties that the editor does not have, assets that are not there, and names of enumerations."""

from __future__ import annotations

import re
import sys
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from signatures import Stub

import stubs

STUB = Stub(stubs.UNREAL)


@cache
def properties(owner: str) -> frozenset[str]:
    """What the editor can set of a class and its bases."""
    return frozenset(re.findall(r"^ +- ``(\w+)`` \(", STUB.text_of(owner), re.MULTILINE))


class Thing:
    """An object whose properties are those of the class of its own name."""

    def __init__(self) -> None:
        self.values: dict[str, object] = {}

    def set_editor_property(self, name: str, value: object) -> None:
        if name not in properties(type(self).__name__):
            raise RuntimeError(f"Failed to find property '{name}' for {type(self).__name__}")
        self.values[name] = value


@STUB.like("Texture2D")
class Texture2D(Thing):
    pass


@STUB.like("Material")
class Material(Thing):
    path = ""

    def get_path_name(self) -> str:
        return self.path


@STUB.like("MaterialExpressionTextureSampleParameter2D")
class MaterialExpressionTextureSampleParameter2D(Thing):
    pass


@STUB.like("AssetImportTask")
class AssetImportTask(Thing):
    def __init__(self) -> None:
        super().__init__()
        self.imported: list[Thing] = []

    def get_objects(self) -> list[Thing]:
        return self.imported


@STUB.like("DisplacementScaling")
class DisplacementScaling:
    def __init__(self, magnitude: float = 0.0, center: float = 0.0) -> None:
        self.magnitude, self.center = magnitude, center


class Unreal:
    """The project."""

    def __init__(self) -> None:
        self.assets: dict[str, Thing] = {}
        self.imported: list[str] = []
        self.saved: list[Thing] = []
        self.compiled: list[Thing] = []
        self.expressions: list[Thing] = []
        self.task: Any = None
        self.refuses = self.cancelled = False


def install(unreal: Unreal) -> None:
    """Put the module in the place of Unreal's."""

    @STUB.like("ScopedSlowTask")
    class ScopedSlowTask:
        def __init__(self, work: float, text: str) -> None:
            self.work, self.done, self.open, self.dialog = work, 0.0, False, False
            unreal.task = self

        def __enter__(self) -> ScopedSlowTask:
            self.open = True
            return self

        def __exit__(self, *exc: object) -> None:
            self.open = False

        def make_dialog(self, can_cancel: bool) -> None:
            self.dialog = can_cancel

        def enter_progress_frame(self, work: float, text: str) -> None:
            assert self.open
            self.done += work
            assert 0 <= self.done <= self.work

        def should_cancel(self) -> bool:
            return unreal.cancelled

    @STUB.like("AssetTools")
    class AssetTools:
        def import_asset_tasks(self, tasks: list[AssetImportTask]) -> None:
            for task in tasks:
                unreal.imported.append(str(task.values["filename"]))
                assert Path(unreal.imported[-1]).is_file()
                if not unreal.refuses:
                    task.imported = [Texture2D()]

        def create_asset(self, name: str, folder: str, kind: type, factory: object) -> Thing:
            made = unreal.assets[f"{folder}/{name}"] = kind()
            made.path = f"{folder}/{name}"
            return made

    @STUB.like("AssetToolsHelpers")
    class AssetToolsHelpers:
        def get_asset_tools(self) -> AssetTools:
            return AssetTools()

    @STUB.like("EditorAssetLibrary")
    class EditorAssetLibrary:
        def does_asset_exist(self, path: str) -> bool:
            return path in unreal.assets

        def load_asset(self, path: str) -> Thing:
            return unreal.assets[path]

        def save_loaded_asset(self, asset: Thing) -> bool:
            unreal.saved.append(asset)
            return True

    @STUB.like("MaterialEditingLibrary")
    class MaterialEditingLibrary:
        def create_material_expression(self, of: Material, kind: type, x: int, y: int) -> Thing:
            unreal.expressions.append(kind())
            return unreal.expressions[-1]

        def recompile_material(self, material: Material) -> None:
            unreal.compiled.append(material)

    class Enumeration:
        def __init__(self, name: str) -> None:
            self._text = STUB.text_of(name)

        def __getattr__(self, name: str) -> str:
            assert re.search(rf"^    {name}: ", self._text, re.MULTILINE), name
            return name

    module = ModuleType("unreal")
    vars(module).update(
        AssetImportTask=AssetImportTask, AssetToolsHelpers=AssetToolsHelpers(),
        DisplacementScaling=DisplacementScaling, EditorAssetLibrary=EditorAssetLibrary(),
        Material=Material, MaterialEditingLibrary=MaterialEditingLibrary(),
        MaterialExpressionTextureSampleParameter2D=MaterialExpressionTextureSampleParameter2D,
        MaterialFactoryNew=SimpleNamespace, ScopedSlowTask=ScopedSlowTask, Texture2D=Texture2D,
        TextureAddress=Enumeration("TextureAddress"),
        TextureCompressionSettings=Enumeration("TextureCompressionSettings"),
    )  # fmt: skip
    sys.modules["unreal"] = module
