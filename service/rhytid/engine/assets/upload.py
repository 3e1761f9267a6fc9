"""Checks the upload of a new asset, and finds what follows from it before anything is built."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rhytid.domain.asset_settings import MOST_WRINKLES, AssetSettings
from rhytid.domain.expressions import Expressions, expressions_for_lines
from rhytid.domain.frame import check_positions
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh_warnings import mesh_warnings
from rhytid.domain.settings_changes import settings_unused
from rhytid.domain.tiles import mesh_udims
from rhytid.domain.uv_layout import usual_uv_length
from rhytid.domain.warnings import InputWarning
from rhytid.engine.assets.asset import Asset
from rhytid.engine.assets.graphs import check_graph
from rhytid.engine.frames import FrameMemory
from rhytid.engine.messages import NewAsset
from rhytid.errors import InputError, MeshError
from rhytid.pipeline.element_arrays import check_cover
from rhytid.pipeline.work import DrawLimit
from rhytid.storage.asset_ids import asset_id


@dataclass(frozen=True)
class CheckedUpload:
    """A new asset whose parts fit each other.

    new: the upload, with settings for its graph or for synthesis.  expressions: those that lines
    grow by.  wrinkles: how many it will have.  frames: (V, 3) float32 each.  warnings: of the mesh.
    unused: warnings of what was sent and has no effect.
    """

    id: str
    new: NewAsset
    expressions: Expressions | None
    wrinkles: int
    frames: tuple[NDArray[np.float32], ...]
    warnings: tuple[InputWarning, ...]
    unused: tuple[InputWarning, ...]

    @classmethod
    def of(cls, new: NewAsset, memory: int, limit: DrawLimit) -> CheckedUpload:
        """Check an upload; raises what `AssetService.create` does.

        memory: bytes that a synthesis may use on the device.  limit: of how long the maps of a
        given graph may take.
        """
        udims = mesh_udims(new.mesh)
        if not udims:
            raise MeshError("no triangle lies in a UDIM: u goes from 0 to 10, v from 0 up")
        if new.scan is not None:
            new, expressions, wrinkles = _to_trace(new, memory)
        elif new.graph is None:
            new, expressions, wrinkles = _to_grow(new, memory)
        else:
            expressions, wrinkles = None, new.graph.wrinkles
            new = replace(new, settings=_settings_of(new, new.graph, udims, limit))
        _check_painted(new, udims)
        settings = new.settings
        return cls(
            id=_id(new, expressions),
            new=new,
            expressions=expressions,
            wrinkles=wrinkles,
            frames=_checked_frames(new),
            warnings=(
                *mesh_warnings(new.mesh, settings.length_unit, settings.resolution, udims),
                *new.noted,
            ),
            unused=new.unused if _grows(new) else (*new.unused, *settings_unused(settings)),
        )

    @property
    def settings(self) -> AssetSettings:
        """Its settings, for the graph that was sent or for synthesis."""
        return self.new.settings

    def asset(self, memory: FrameMemory) -> Asset:
        """The asset of the upload, which is not built yet.  memory: counts its frames."""
        mesh = self.new.mesh
        made = Asset.of(self.id, mesh, self.settings, self.warnings, memory, lambda: mesh)
        made.expected_wrinkles, made.measured_uv = self.wrinkles, usual_uv_length(mesh)
        return made


def content_id(new: NewAsset) -> str:
    """The id that an upload will have; checks nothing of it."""
    if new.scan is not None:
        settings, expressions = _traced_settings(new), None
        if new.scan.filled:
            expressions = expressions_for_lines(settings.graph.lines, new.shapes)
    elif new.graph is not None:
        settings, expressions = new.settings.for_graph(new.graph.origin), None
    else:
        settings = new.settings.for_synthesis()
        expressions = expressions_for_lines(settings.graph.lines, new.shapes)
    return _id(replace(new, settings=settings), expressions)


def _id(new: NewAsset, expressions: Expressions | None) -> str:
    return asset_id(
        new.mesh, new.settings, new.graph, new.stiffness, new.controls, expressions, new.residual,
        new.scan,
    )  # fmt: skip


def _grows(new: NewAsset) -> bool:
    """Whether skin grows: all of it, or where a scan has none."""
    return new.graph is None if new.scan is None else new.scan.filled


def _to_trace(new: NewAsset, memory: int) -> tuple[NewAsset, Expressions | None, int]:
    """The upload of a scan, with settings that its traced graph is drawn with; what `_to_grow` has
    of skin that fills in."""
    traced = replace(new, settings=_traced_settings(new))
    if not _grows(new):
        return traced, None, MOST_WRINKLES
    _, expressions, _ = _to_grow(new, memory)
    return traced, expressions, MOST_WRINKLES


def _traced_settings(new: NewAsset) -> AssetSettings:
    from rhytid.tracing.trace import traced_settings

    assert new.scan is not None
    filled, settings = new.scan.filled, new.settings
    settings = settings.for_synthesis() if filled else settings.for_graph(None)
    return traced_settings(settings, new.scan.detail > 0.0, filled)


def _settings_of(
    new: NewAsset, graph: WrinkleGraph, udims: Iterable[int], limit: DrawLimit
) -> AssetSettings:
    """Settings for the graph of an upload; raises what `check_graph` and `check_cover` do."""
    settings = new.settings.for_graph(graph.origin)
    check_graph(graph, new.mesh, force=new.force)
    for udim in udims:
        check_cover(graph, settings, udim, limit)
    return settings


def _to_grow(new: NewAsset, memory: int) -> tuple[NewAsset, Expressions | None, int]:
    """The upload with settings for synthesis, the expressions that lines grow by, and the number of
    wrinkles."""
    from rhytid.synthesis.capacity import check_amount  # with all that grows skin

    settings = new.settings.for_synthesis()
    expressions = expressions_for_lines(settings.graph.lines, new.shapes)
    wrinkles = check_amount(new.mesh, settings.graph, new.controls, memory)
    return replace(new, settings=settings), expressions, wrinkles


def _check_painted(new: NewAsset, udims: tuple[int, ...]) -> None:
    for painted in (new.stiffness, new.controls):
        if painted is not None:
            painted.check_udims(udims)
    for scanned in (new.residual, new.scan):
        if scanned is not None:
            scanned.check(udims, new.settings.resolution)
    if new.residual is not None and new.graph is None:
        raise InputError("a residual is what a traced graph does not draw: send that, too")
    if new.scan is not None and new.graph is not None:
        raise InputError("a graph and a scan, of which one is traced: send one of them")
    if new.controls is not None and not _grows(new):
        names, sent = ", ".join(new.controls.maps), "scan" if new.graph is None else "graph"
        raise InputError(f"{names}: maps that guide synthesis; a {sent} was sent")


def _checked_frames(new: NewAsset) -> tuple[NDArray[np.float32], ...]:
    sent = () if new.frames is None else new.frames
    return tuple(check_positions(positions, len(new.mesh.positions)) for positions in sent)
