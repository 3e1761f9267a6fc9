"""Wrinkles of the rhytid service in Unreal, as displacement of Nanite. Not run in Unreal.

The mesh and its frames come from the files that the animation was exported to: Unreal splits the
vertices of a mesh when it imports it. In the editor, with the Python plug-in on, `rhytid_client`
and this file where its Python finds them:

    import rhytid_unreal
    from rhytid_client.hosts import Server, Skin

    server = Server("http://127.0.0.1:8717")
    print(server.tested())
    face = rhytid_unreal.UnrealMesh("D:/shot/face.npz", content="/Game/Face")
    skin = Skin(face, server)
    print(skin.send(resolution=4096, expressions=[12, 48]))
    print(skin.bake("D:/shot/maps"))
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

import unreal
from rhytid_client.hosts import Display, MapSequence, Progress, Scene, Trouble
from rhytid_client.hosts.sequences import NO_UDIM, UDIM_LAST, Style
from rhytid_client.hosts.units import factor

PARAMETER = "Wrinkles"
_WORK = 100.0


class UnrealMesh:
    """A mesh of a file, and the assets of its maps.

    mesh: OBJ, PLY, glTF, GLB or npz.  frames: .npy of positions (N, V, 3) in the order of its
    vertices; of an npz those in it.  content: folder of the assets.  unit: of the file.  first:
    number of the first frame. Raises Trouble where there are no frames.
    """

    def __init__(
        self,
        mesh: str | Path,
        *,
        content: str,
        frames: str | Path | None = None,
        unit: str = "cm",
        first: int = 1,
    ) -> None:
        self.unit = unit
        self._mesh, self._content, self._first = Path(mesh), content.rstrip("/"), first
        self.name = self._mesh.stem
        self._frames = _frames(self._mesh if frames is None else Path(frames))

    def rest(self) -> Path:
        """The file."""
        return self._mesh

    def positions(self, frame: int) -> NDArray[np.floating]:
        """(V, 3), as the file has them."""
        at = frame - self._first
        if not 0 <= at < len(self._frames):
            last = self._first + len(self._frames) - 1
            raise Trouble(f"There is no frame {frame}: frames are {self._first} to {last}")
        positions: NDArray[np.floating] = self._frames[at]
        return positions

    def frame(self) -> int:
        """The first one: the editor shows none."""
        return self._first

    def frames(self) -> Sequence[int]:
        """Those of the file."""
        return range(self._first, self._first + len(self._frames))

    @contextmanager
    def working(self, title: str) -> Iterator[Progress]:
        """The editor's dialog of slow tasks, with a button that cancels."""
        with unreal.ScopedSlowTask(_WORK, title) as task:
            task.make_dialog(True)
            done = 0.0

            def show(share: float, text: str) -> bool:
                nonlocal done
                task.enter_progress_frame(max(_WORK * share - done, 0.0), text)
                done = _WORK * share
                return not task.should_cancel()

            yield show

    def style(self, udims: Sequence[int]) -> Style:
        """The UDIM is the end of a name, or is not in it."""
        return NO_UDIM if tuple(udims) == (1001,) else UDIM_LAST

    def show(self, display: Display) -> list[str]:
        """A texture for each frame, and a material with tessellation that shows the first."""
        maps = display.maps
        textures = [self._texture(maps, frame) for frame in maps.frames]
        # Heights are in units of the file, the scene is in centimetres.
        magnitude = display.scale * factor(self.unit, "cm")
        material = self._material(textures[0], magnitude)
        done = [
            f"{len(textures)} textures in {self._content}, the first in {material.get_path_name()}",
            "Left for you: lead R of its texture to Displacement, which Python cannot connect; "
            f"change the parameter '{PARAMETER}' frame by frame",
        ]
        settings = "r.Nanite.AllowTessellation and r.Nanite.Tessellation 1"
        return [*done, f"Left for you: {settings}, the material on a mesh of Nanite"]

    def _texture(self, maps: MapSequence, frame: int) -> unreal.Texture2D:
        """Import a frame, all of its UDIMs by the file of the first; raises Trouble."""
        file = maps.file(maps.udims[0], frame)
        task = unreal.AssetImportTask()
        _set(task, filename=str(file), destination_path=self._content, automated=True)
        _set(task, replace_existing=True, save=False)
        tools = unreal.AssetToolsHelpers.get_asset_tools()
        tools.import_asset_tasks(cast("unreal.Array[unreal.AssetImportTask]", [task]))
        imported = [asset for asset in task.get_objects() if isinstance(asset, unreal.Texture2D)]
        if not imported:
            raise Trouble(f"Unreal has not imported {file}")
        texture = imported[0]
        # Heights are numbers: floats, not colours, and all of them are kept.
        kept = unreal.TextureCompressionSettings.TC_SINGLE_FLOAT
        _set(texture, srgb=False, compression_settings=kept, virtual_texture_streaming=maps.tiled)
        if not maps.tiled:
            clamp = unreal.TextureAddress.TA_CLAMP
            _set(texture, address_x=clamp, address_y=clamp)
        unreal.EditorAssetLibrary.save_loaded_asset(texture)
        return texture

    def _material(self, texture: unreal.Texture2D, magnitude: float) -> unreal.Material:
        """The material of the mesh, made where it is not there, showing the texture."""
        name = f"M_{self.name}_wrinkles"
        material, made = _asset(self._content, name)
        _set(material, enable_tessellation=True, used_with_nanite=True)
        # 0 of a map is the smooth surface.
        _set(material, displacement_scaling=unreal.DisplacementScaling(magnitude, 0.0))
        if made:
            kind = unreal.MaterialExpressionTextureSampleParameter2D
            editing = unreal.MaterialEditingLibrary
            sample = editing.create_material_expression(
                material, cast("unreal.Class", kind), -400, 0
            )
            _set(sample, parameter_name=PARAMETER, texture=texture)
        unreal.MaterialEditingLibrary.recompile_material(material)
        unreal.EditorAssetLibrary.save_loaded_asset(material)
        return material


def _frames(file: Path) -> NDArray[np.floating]:
    """(N, V, 3) of a .npy, or of `frames` in a .npz; raises Trouble."""
    try:
        stored = np.load(file, allow_pickle=False)
        frames = stored["frames"] if file.suffix == ".npz" else stored
    except (OSError, ValueError, KeyError) as exc:
        raise Trouble(f"{file} has no frames: give a .npy of positions (N, V, 3)") from exc
    positions: NDArray[np.floating] = np.asarray(frames)
    if positions.ndim != 3 or positions.shape[2] != 3 or not len(positions):
        raise Trouble(f"{file} has frames of shape {positions.shape}, not (N, V, 3)")
    return positions


def _asset(folder: str, name: str) -> tuple[unreal.Material, bool]:
    """A material by its name, and whether it was made; raises Trouble."""
    path = f"{folder}/{name}"
    made = not unreal.EditorAssetLibrary.does_asset_exist(path)
    if made:
        tools, kind = (
            unreal.AssetToolsHelpers.get_asset_tools(),
            cast("unreal.Class", unreal.Material),
        )
        found = tools.create_asset(name, folder, kind, unreal.MaterialFactoryNew())
    else:
        found = unreal.EditorAssetLibrary.load_asset(path)
    if not isinstance(found, unreal.Material):
        raise Trouble(f"{path} is no material and cannot be made one")
    return found, made


def _set(thing: unreal.Object, **values: object) -> None:
    for name, value in values.items():
        thing.set_editor_property(name, value)


if TYPE_CHECKING:
    # What `Skin` asks of a host.
    _scene: type[Scene] = UnrealMesh
