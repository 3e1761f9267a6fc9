"""Redraws every wrinkle and pore for a frame (section 2.3). Kernels: respond.cl, redraw.cl."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.programs import NO_DEFINES
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings, ShapeSettings
from rhytid.pipeline.cells import Lists
from rhytid.pipeline.copies import OriginBuffers
from rhytid.pipeline.cushion import draw_cushion
from rhytid.pipeline.elements import UdimElements
from rhytid.pipeline.levels import Draw
from rhytid.pipeline.nearby import Groups, NearbyGroups
from rhytid.pipeline.reach import bulging, response_defines
from rhytid.pipeline.stretch import StretchBuffers
from rhytid.pipeline.work import BLOCK, Place

# The defines of kernels that find r of wrinkles, and no scales (RESPONSE of line_kinds.clh).
R_ALONE = {"BENT": 1}


class Responder(Protocol):
    """Launches Alg. 1 or Alg. 2."""

    def __call__(
        self, count: int, places: Buffer, triangle: Buffer, stiff: Buffer | None, into: Buffer,
        groups: Groups | None = None,
    ) -> None:  # fmt: skip
        """Fill the response, scales or r, of `count` elements from their places, triangles and
        stiffness.  groups: those that are wanted; None: all."""


@dataclass(frozen=True)
class ScaleBuffers(BufferGroup):
    """(σ_w, σ_d) of each wrinkle and pore of a UDIM in one frame, on the device. Of a wrinkle that
    bends it is σ_w at both ends, then σ_d at both.

    filled: UDIMs and squares whose elements have them; None: all.
    """

    wrinkles: Buffer
    pores: Buffer
    filled: set[Place | None] = field(default_factory=set, init=False)

    @classmethod
    def allocate(cls, device: Device, elements: UdimElements) -> ScaleBuffers:
        """Buffers for the scales of `elements`, not initialised."""
        counts = ((4 if elements.bent else 2) * elements.wrinkles, 2 * elements.pores)
        return cls(*(device.empty(count, np.float32) for count in counts))

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.wrinkles, self.pores)


def respond(
    device: Device, elements: UdimElements, settings: AssetSettings, stretch: StretchBuffers
) -> ScaleBuffers:
    """Alg. 1 for every wrinkle and Alg. 2 for every pore."""
    scales = ScaleBuffers.allocate(device, elements)
    respond_nearby(device, elements, settings, scales, stretch, None)
    return scales


def respond_nearby(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: ScaleBuffers,
    stretch: StretchBuffers, near: NearbyGroups | None,
) -> None:  # fmt: skip
    """Fill the scales of the wrinkles and pores that are wanted; None: of all."""
    wrinkles = wrinkle_responder(device, settings, stretch, elements.response_defines)
    pores = pore_responder(device, settings, stretch)
    respond_with(device, elements, settings, scales, wrinkles, pores, near)


def wrinkle_responder(
    device: Device,
    settings: AssetSettings,
    stretch: StretchBuffers,
    defines: Mapping[str, object],
) -> Responder:
    """Launches Alg. 1 with the stretch of each triangle.

    defines: `response_defines` of the elements, or R_ALONE.
    """
    response, limits = settings.response, response_defines(settings.response.soft_limits)

    def wrinkles(
        count: int, places: Buffer, triangle: Buffer, stiff: Buffer | None, into: Buffer,
        groups: Groups | None = None,
    ) -> None:  # fmt: skip
        wanted = groups or Groups.of(count)
        device.launch(
            "respond", "respond_wrinkles", (wanted.items,),
            wanted.numbers, places, triangle, stretch.axes, stretch.logs, stretch.jacobians, stiff,
            np.int32(count), np.float32(response.alpha_w), np.float32(response.alpha_d), into,
            defines={**limits, **defines},
        )  # fmt: skip

    return wrinkles


def pore_responder(device: Device, settings: AssetSettings, stretch: StretchBuffers) -> Responder:
    """Launches Alg. 2 with the stretch of each triangle."""
    response, defines = settings.response, response_defines(settings.response.soft_limits)

    def pores(
        count: int, places: Buffer, triangle: Buffer, stiff: Buffer | None, into: Buffer,
        groups: Groups | None = None,
    ) -> None:  # fmt: skip
        wanted = groups or Groups.of(count)
        device.launch(
            "respond", "respond_pores", (wanted.items,),
            wanted.numbers, triangle, stretch.logs, stiff, np.int32(count),
            np.float32(response.beta_w), np.float32(response.beta_d),
            np.float32(response.pore_depth_limit), into,
            defines=defines,
        )  # fmt: skip

    return pores


def respond_with(
    device: Device,
    elements: UdimElements,
    settings: AssetSettings,
    scales: ScaleBuffers,
    wrinkles: Responder,
    pores: Responder,
    near: NearbyGroups | None = None,
) -> None:
    """Fill the scales of the elements of a UDIM; those of copies are the scales of their originals.

    wrinkles, pores: launch the kernel that finds the response of each kind.  near: what is wanted;
    None: all.
    """
    with _wrinkle_scales(device, elements, settings, scales, near) as found:
        wrinkles(
            elements.wrinkles, elements.segments, elements.wrinkle_triangle,
            elements.wrinkle_stiffness, found, None if near is None else near.answering,
        )  # fmt: skip
        defines = elements.response_defines
        take_over(device, elements.wrinkle_origins, wrinkles, found, defines)
    pores(
        elements.pores, elements.centres, elements.pore_triangle, elements.pore_stiffness,
        scales.pores, None if near is None else near.pores,
    )  # fmt: skip
    take_over(device, elements.pore_origins, pores, scales.pores, NO_DEFINES)


def take_over(
    device: Device,
    origins: OriginBuffers | None,
    responder: Responder,
    found: Buffer,
    defines: Mapping[str, object],
) -> None:
    """Give copies the response of their originals, in `found`.

    defines: that the kernels which found both were compiled with.
    """
    if origins is not None:
        responder(
            origins.count, origins.places, origins.triangle, origins.stiffness, origins.scales
        )
        origins.overwrite(device, found, defines)


@contextmanager
def _wrinkle_scales(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: ScaleBuffers,
    near: NearbyGroups | None,
) -> Iterator[Buffer]:  # fmt: skip
    """The buffer that kernels launched in the block write to: the scales of wrinkles; or, where
    wrinkles bend, r of each, from which the scales at their ends are made when the block ends."""
    if not elements.bent:
        yield scales.wrinkles
        return
    response, r = settings.response, device.empty(elements.wrinkles, np.float32)
    shares = () if elements.shares is None else (elements.sizes, elements.shares)
    yield r
    wanted = Groups.of(elements.wrinkles) if near is None else near.wrinkles
    device.launch(
        "ends", "respond_ends", (wanted.items,),
        wanted.numbers, r, elements.partners, np.int32(elements.wrinkles),
        np.float32(response.ends), np.float32(response.alpha_w), np.float32(response.alpha_d),
        *shares, scales.wrinkles,
        defines={**response_defines(response.soft_limits), **({"SHARED": 1} if shares else {})},
    )  # fmt: skip
    r.release()


def redrawing(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: ScaleBuffers
) -> Draw:
    """A function that draws any square of level 0 of the frame that `scales` belong to."""

    def draw(row: int, column: int, side: int) -> Buffer:
        square = (row, column, side)
        out = device.empty(side * side, np.float32)
        with _cushion(device, elements, settings, scales, square) as (coarse, defines):
            launch_blocks(
                device, "redraw", "redraw", settings, square,
                *elements.line_arguments, scales.wrinkles, *_both(elements.wrinkle_lists),
                elements.centres, elements.roots, scales.pores, *_both(elements.pore_lists),
                into=(*coarse, out),
                defines={
                    **elements.line_defines, **defines, "BULGING": int(bulging(settings.shape)),
                },
            )  # fmt: skip
        return out

    return draw


@contextmanager
def _cushion(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: ScaleBuffers,
    square: tuple[int, int, int],
) -> Iterator[tuple[tuple[Buffer, ...], Mapping[str, object]]]:  # fmt: skip
    """The broad layer under a square, as arguments and defines of `redraw`; empty where there is
    none. It is released when the block ends."""
    if elements.cushion is None:
        yield (), NO_DEFINES
        return
    coarse = draw_cushion(device, elements, settings, scales.wrinkles, square)
    raised = {"RAISED": 1, "COARSER": elements.cushion.factor}
    yield (coarse,), {**raised, **device.ahead_defines}
    coarse.release()


def launch_blocks(
    device: Device,
    program: str,
    kernel: str,
    settings: AssetSettings,
    square: tuple[int, int, int],
    *arguments: Any,
    into: tuple[Any, ...],
    defines: Mapping[str, object] = NO_DEFINES,
    maps: int = 1,
) -> None:
    """Run a drawing kernel over a square (row, column, texels per side) of level 0. A work-group
    draws some rows of a block, by the launch shape of the device.

    arguments: of the elements.  into: of the output.  maps: that a group has valleys and bulges of
    at once, 1 or 2.
    """
    row, column, side = square
    blocks, rows = side // BLOCK, min(device.shape.rows, BLOCK) // maps
    shape = settings.shape
    device.launch(
        program, kernel, (blocks * device.shape.lanes, side // rows), *arguments,
        shape_values(shape), np.float32(shape.least_half_width), np.float32(settings.depth),
        np.int32(settings.resolution // BLOCK), np.int32(row // BLOCK), np.int32(column // BLOCK),
        *into, group=(device.shape.lanes, 1),
        defines={"BLOCK": BLOCK, "ROWS": rows, "ITEMS": device.shape.lanes, **defines},
    )  # fmt: skip


def shape_values(shape: ShapeSettings) -> NDArray[np.float32]:
    """The shape argument of drawing kernels, a float4: both bulges, sharpness, slots."""
    values = (shape.wrinkle_bulge, shape.pore_bulge, shape.sharpness, shape.slots)
    return np.array(values, np.float32)


def _both(lists: Lists) -> tuple[Buffer, Buffer]:
    return lists.offsets, lists.members
