"""The asset of a snapshot, read and checked, before it is stored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.expressions import Expressions
from rhytid.domain.tiles import mesh_udims
from rhytid.errors import SnapshotError, StorageError
from rhytid.storage.build_facts import BuildFacts
from rhytid.storage.homes import ASSET, OVERLAY, SHAPES
from rhytid.storage.kept_shapes import read_shapes
from rhytid.storage.manifest import read_verified
from rhytid.storage.overlays import read_overlay
from rhytid.storage.records import StoredAsset
from rhytid.storage.snapshot_index import SnapshotIndex
from rhytid.support.atomic_files import is_folder, storage_errors


@dataclass(frozen=True, eq=False)
class UnpackedAsset:
    """A built asset with its present settings, whose files are in the folder `place`.

    index: what its snapshot begins with.  has_shapes: whether named shapes of its mesh are there,
    too.
    """

    index: SnapshotIndex
    asset: StoredAsset
    settings: AssetSettings
    place: Path
    has_shapes: bool

    @property
    def id(self) -> str:
        """The id of the asset."""
        return self.index.asset

    @classmethod
    def read(cls, index: SnapshotIndex, place: Path) -> UnpackedAsset:
        """Read what `unpack` wrote; raises SnapshotError where it is no asset that can be drawn."""
        id = index.asset
        files = read_verified(place / ASSET, f"{ASSET} {id}")
        has_shapes = is_folder(place / SHAPES)
        shapes = read_verified(place / SHAPES, f"{SHAPES} {id}") if has_shapes else {}
        with storage_errors("a snapshot cannot be read"):
            overlay = (place / OVERLAY).read_bytes()
        try:
            # Places in the snapshot, not on this machine, are what errors name.
            asset = StoredAsset.read(files, Path(ASSET))
            settings = read_overlay(f"{ASSET} {id}", overlay, Path(OVERLAY))
            _check(asset)
            if has_shapes:
                _check_shapes(read_shapes(shapes, Path(SHAPES)), asset)
        except (StorageError, SnapshotError) as exc:
            raise SnapshotError(f"what it holds cannot be used: {exc}") from exc
        return cls(index, asset, settings, place, has_shapes)


def _check(asset: StoredAsset) -> None:
    """Raise SnapshotError where the parts do not fit each other."""
    if not mesh_udims(asset.mesh):
        raise SnapshotError("no triangle of the mesh lies in a UDIM")
    triangles = len(asset.mesh.faces)
    for name in ("node_triangle", "edge_triangle"):
        index = getattr(asset.graph, name)
        if index is not None and len(index) and index.max() >= triangles:
            raise SnapshotError(f"{name} of the graph names a triangle that the mesh does not have")
    BuildFacts.of(asset)


def _check_shapes(shapes: Expressions, asset: StoredAsset) -> None:
    """Raise SnapshotError where shapes are of another mesh."""
    own, theirs = len(asset.mesh.positions), shapes.positions.shape[1]
    if own != theirs:
        raise SnapshotError(f"its shapes have {theirs} vertices each, its mesh has {own}")
