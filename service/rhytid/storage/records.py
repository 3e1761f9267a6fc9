"""The files of an asset: a request, the built asset, its present settings and its named shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from rhytid.domain.asset_settings import PRESETS, AssetSettings
from rhytid.domain.expressions import Expressions, Folds
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls, Stiffness
from rhytid.domain.residual import Residual, ScanRelief
from rhytid.domain.warnings import InputWarning
from rhytid.errors import InputError, LimitError, StoreFormatError
from rhytid.formats.graphs import graph_pieces, read_graph
from rhytid.storage.asset_ids import mesh_arrays
from rhytid.storage.canonical import canonical, damaged, hashed, parse_canonical, parse_hashed
from rhytid.storage.homes import ASSET, OVERLAY
from rhytid.storage.manifest import Content, read_file
from rhytid.support.atomic_files import storage_errors

T = TypeVar("T")
Files = Mapping[str, bytes]
MESH, GRAPH, FACTS = "mesh.safetensors", "graph.safetensors", "facts.json"
STIFFNESS, CONTROLS = "stiffness.safetensors", "controls.safetensors"
FOLDS = "folds.safetensors"
RESIDUAL, SCAN = "residual.safetensors", "scan.safetensors"
# A fact of assets that have had an overlay from the start; older ones have one once they change.
OVERLAID = "overlaid"
SHAPE_ARRAYS, SHAPE_NAMES = "shapes.safetensors", "names.json"


@dataclass(frozen=True, eq=False)
class StoredRequest:
    """The content that a caller sent for an asset.

    graph: None: one is to be synthesised, guided by `controls` and `folds`, which are computed from
    the expressions that were sent; or, where there is a `scan`, it is traced.  noted: warnings of
    the scan as it was sent, which cannot be found out from what is kept of it.
    """

    mesh: Mesh
    settings: AssetSettings
    graph: WrinkleGraph | None
    stiffness: Stiffness | None = None
    controls: Controls | None = None
    folds: Folds | None = None
    residual: Residual | None = None
    scan: ScanRelief | None = None
    noted: tuple[InputWarning, ...] = ()

    def files(self) -> dict[str, Content]:
        """The files of the request, by name."""
        facts: dict[str, Any] = {"settings": self.settings.as_json()}
        if self.noted:
            facts["extra"] = {"warnings": [asdict(warning) for warning in self.noted]}
        files = _files(self.mesh, self.graph, facts, self.stiffness, self.residual)
        if self.controls is not None:
            files[CONTROLS] = _packed(self.controls.arrays())
        if self.folds is not None:
            files[FOLDS] = _packed(self.folds.arrays())
        if self.scan is not None:
            files[SCAN] = _packed(self.scan.arrays())
        return files

    @classmethod
    def read(cls, files: Files, folder: Path) -> StoredRequest:
        """The inverse of `files`; raises StorageError naming the file in `folder`."""
        graph = _decode(files, folder / GRAPH, read_graph) if GRAPH in files else None
        facts = _facts(files, folder)
        mesh = _decode(files, folder / MESH, read_mesh)
        controls = _arrays(files, folder / CONTROLS, Controls.of_arrays)
        folds = _arrays(files, folder / FOLDS, Folds.of_arrays)
        scan = _arrays(files, folder / SCAN, ScanRelief.of_arrays)
        settings, (stiffness, residual) = _settings(facts, folder), _drawn(files, folder)
        noted = _warnings(facts["extra"].get("warnings", ()), folder)
        return cls(mesh, settings, graph, stiffness, controls, folds, residual, scan, noted)


@dataclass(frozen=True, eq=False)
class StoredAsset:
    """A built asset. Its settings are resolved; `extra` holds facts of the build as JSON."""

    mesh: Mesh
    graph: WrinkleGraph
    settings: AssetSettings
    extra: dict[str, Any]
    stiffness: Stiffness | None = None
    residual: Residual | None = None

    def files(self) -> dict[str, Content]:
        """The files of the asset, by name."""
        facts = {"settings": self.settings.as_json(), "extra": self.extra, OVERLAID: True}
        return _files(self.mesh, self.graph, facts, self.stiffness, self.residual)

    @classmethod
    def read(cls, files: Files, folder: Path) -> StoredAsset:
        """The inverse of `files`; raises StorageError naming the file in `folder`."""
        mesh = _decode(files, folder / MESH, read_mesh)
        graph = _decode(files, folder / GRAPH, read_graph)
        facts = _facts(files, folder)
        settings, (stiffness, residual) = _settings(facts, folder), _drawn(files, folder)
        return cls(mesh, graph, settings, facts["extra"], stiffness, residual)


def write_mesh(mesh: Mesh) -> bytes:
    """The mesh as safetensors; uv stay float64."""
    return _packed(mesh_arrays(mesh))


def read_mesh(data: bytes) -> Mesh:
    """The inverse of `write_mesh`; raises MeshError, TypeError or SafetensorError."""
    return Mesh(**load(data))


def decode_mesh(data: bytes, path: Path) -> Mesh:
    """The mesh of a file that was verified; raises StorageError naming `path` where it means
    nothing here."""
    return _decode({path.name: data}, path, read_mesh)


def decode_settings(facts: bytes, path: Path) -> AssetSettings:
    """The settings that an asset was built with, out of its facts, which were verified; raises
    StorageError naming `path`."""
    return _settings(_facts({path.name: facts}, path.parent), path.parent)


def parse_settings(value: Any, path: Path) -> AssetSettings:
    """Settings out of a file that was verified; raises StoreFormatError naming `path`."""
    try:
        return AssetSettings.parse(_drawn_as_before(value))
    except InputError as exc:
        raise _foreign(path, exc) from exc


def _files(
    mesh: Mesh,
    graph: WrinkleGraph | None,
    facts: dict[str, Any],
    stiffness: Stiffness | None,
    residual: Residual | None,
) -> dict[str, Content]:
    files: dict[str, Content] = {FACTS: canonical(facts), MESH: write_mesh(mesh)}
    if graph is not None:
        files[GRAPH] = list(graph_pieces(graph))
    if stiffness is not None:
        files[STIFFNESS] = _packed(stiffness.arrays())
    if residual is not None:
        files[RESIDUAL] = _packed(residual.arrays())
    return files


def _drawn(files: Files, folder: Path) -> tuple[Stiffness | None, Residual | None]:
    stiffness = _arrays(files, folder / STIFFNESS, Stiffness.of_arrays)
    return stiffness, _arrays(files, folder / RESIDUAL, Residual.of_arrays)


def _arrays(files: Files, path: Path, parse: Callable[[dict[str, NDArray[Any]]], T]) -> T | None:
    """What `parse` makes of the arrays of a file; None where it is not among the files."""
    return _decode(files, path, _of(parse)) if path.name in files else None


def _packed(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Arrays as safetensors."""
    data: bytes = save(dict(arrays))
    return data


def _of(parse: Callable[[dict[str, NDArray[Any]]], T]) -> Callable[[bytes], T]:
    """A reader of safetensors files whose arrays `parse` takes."""
    return lambda data: parse(load(data))


def _decode(files: Files, path: Path, read: Callable[[bytes], T]) -> T:
    """`read` of a verified file: one that fails here was written by another version of us."""
    if path.name not in files:
        raise damaged(path, "the file is missing")
    try:
        return read(files[path.name])
    except (SafetensorError, InputError, LimitError, TypeError, ValueError, KeyError) as exc:
        raise _foreign(path, exc) from exc


def _foreign(path: Path, why: object) -> StoreFormatError:
    """The error for a file that is what was written, and means nothing here."""
    return StoreFormatError(f"{path} is of another version of rhytid: {why}")


def _facts(files: Files, folder: Path) -> dict[str, Any]:
    path = folder / FACTS
    facts: Any = _decode(files, path, lambda data: parse_canonical(data, path))
    if not isinstance(facts, dict) or not isinstance(facts.get("extra", {}), dict):
        raise _foreign(path, "not an object of facts")
    return {"extra": {}, **facts}


def _settings(facts: Mapping[str, Any], folder: Path) -> AssetSettings:
    return parse_settings(facts.get("settings"), folder / FACTS)


def _warnings(kept: Any, folder: Path) -> tuple[InputWarning, ...]:
    try:
        return tuple(InputWarning(**one) for one in kept)
    except TypeError as error:
        raise _foreign(folder / FACTS, "warnings that are none") from error


def _drawn_as_before(value: Any) -> Any:
    """Settings written before lines were arcs, skin swelled and lines had ranks, with what leaves
    them as they were grown and drawn: the preset `paper` has all of it."""
    if not isinstance(value, dict):
        return value
    paper = PRESETS["paper"]
    before = {"shape": paper.shape, "response": paper.response, "graph": paper.graph}
    known = {name: value[name] for name in before if isinstance(value.get(name), dict)}
    return {**value, **{name: {**before[name], **given} for name, given in known.items()}}


@dataclass(frozen=True)
class BuildFacts:
    """Facts of the build of an asset. None: the version that built the asset did not record it.

    spacing, distance: of pores, mesh units.  uv_length: of a step of 1 in UV, mesh units.
    warnings: of the mesh.
    """

    spacing: float
    distance: float | None
    uv_length: float | None
    warnings: tuple[InputWarning, ...] | None

    @classmethod
    def of(cls, stored: StoredAsset) -> BuildFacts:
        """The facts of a built asset; raises StoreFormatError where they are not what a build
        writes."""
        extra = stored.extra
        try:
            spacing = float(extra["spacing"])
            distance, uv_length = (
                None if (known := extra.get(name)) is None else float(known)
                for name in ("distance", "uv_length")
            )
            kept = extra.get("warnings")
            warnings = None if kept is None else tuple(InputWarning(**one) for one in kept)
        except (KeyError, TypeError, ValueError) as exc:
            raise StoreFormatError(f"{FACTS} is of another version of rhytid: {exc!r}") from exc
        if not (isfinite(spacing) and spacing > 0):
            raise StoreFormatError(f"{FACTS}: a spacing of {spacing} is none")
        return cls(spacing, distance, uv_length, warnings)


def write_overlay(label: str, settings: AssetSettings) -> bytes:
    """The present settings of the asset `label` as a file of their own."""
    return hashed({"label": label, "settings": settings.as_json()})


def read_overlay(label: str, data: bytes, path: Path) -> AssetSettings:
    """The inverse of `write_overlay`; raises StorageError naming `path`."""
    value = parse_hashed(data, path)
    if not isinstance(value, dict) or value.get("label") != label:
        raise damaged(path, f"not the settings of {label}")
    return parse_settings(value.get("settings"), path)


def changed_settings(home: Path) -> AssetSettings | None:
    """The present settings of a built asset; None where an older version built it and it never
    changed.

    home: the folder of the asset, whose name is its id. Raises StorageError where the settings are
    damaged.
    """
    path, facts = home / OVERLAY, home / ASSET / FACTS
    with storage_errors(f"{path} cannot be read"), suppress(FileNotFoundError):
        return read_overlay(f"{ASSET} {home.name}", path.read_bytes(), path)
    with storage_errors(f"{facts} cannot be read"):
        found = parse_canonical(facts.read_bytes(), facts)
    if isinstance(found, dict) and found.get(OVERLAID, False):
        raise damaged(path, "the file is missing")
    return None


def present_settings(home: Path) -> AssetSettings:
    """The present settings of a built asset: those of its overlay, else those that it was built
    with."""
    if (changed := changed_settings(home)) is not None:
        return changed
    folder = home / ASSET
    facts = read_file(folder, f"{ASSET} {home.name}", FACTS)
    return decode_settings(facts, folder / FACTS)


def shape_files(shapes: Expressions) -> dict[str, bytes]:
    """The files of named shapes, by name: the positions as safetensors, the names as JSON."""
    positions = _packed({"shapes": shapes.positions})
    return {SHAPE_ARRAYS: positions, SHAPE_NAMES: canonical(list(shapes.names))}


def read_shapes(files: Mapping[str, bytes], folder: Path) -> Expressions:
    """The inverse of `shape_files`; raises StorageError naming what is wrong in `folder`."""
    try:
        data, named = files[SHAPE_ARRAYS], files[SHAPE_NAMES]
        names = parse_canonical(named, folder / SHAPE_NAMES)
        positions = load(data)["shapes"]
        return Expressions.checked(positions, positions.shape[1], list(names))
    except (InputError, KeyError, TypeError, ValueError, SafetensorError) as exc:
        raise damaged(folder / SHAPE_ARRAYS, f"{type(exc).__name__}: {exc}") from exc
