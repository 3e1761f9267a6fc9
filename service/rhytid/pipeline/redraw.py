"""Redraws every wrinkle and pore for a frame (section 2.3). Kernels: respond.cl, redraw.cl."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.device.held import Held
from rhytid.device.runtime import NO_DEFINES, Buffer, Device
from rhytid.domain.asset_settings import AssetSettings, ShapeSettings
from rhytid.pipeline.elements import BLOCK, RESPONSE_DEFINES, Lists, UdimElements
from rhytid.pipeline.levels import Draw
from rhytid.pipeline.stretch_buffers import StretchBuffers
from rhytid.pipeline.vectors import VECTOR

# Fills scales of so many elements from their places, triangles and stiffness.
Answer = Callable[[int, Buffer, Buffer, Buffer | None, Buffer], None]


@dataclass(frozen=True)
class ScaleBuffers(Held):
    """(σ_w, σ_d) of each wrinkle and pore of a UDIM in one frame, on the device."""

    wrinkles: Buffer
    pores: Buffer

    @classmethod
    def allocate(cls, device: Device, elements: UdimElements) -> ScaleBuffers:
        """Room for the scales of those elements, not initialised."""
        counts = (elements.wrinkles, elements.pores)
        return cls(*(device.empty(2 * count, np.float32) for count in counts))

    @property
    def _buffers(self) -> tuple[Buffer, ...]:
        return (self.wrinkles, self.pores)


def respond(
    device: Device, elements: UdimElements, settings: AssetSettings, stretch: StretchBuffers
) -> ScaleBuffers:
    """Alg. 1 for every wrinkle and Alg. 2 for every pore."""
    response = settings.response
    scales = ScaleBuffers.allocate(device, elements)

    def wrinkles(
        count: int, places: Buffer, triangle: Buffer, stiff: Buffer | None, into: Buffer
    ) -> None:
        device.launch(
            "respond", "respond_wrinkles", (-(-count // VECTOR),),
            places, triangle, stretch.axes, stretch.logs, stretch.jacobians, stiff, np.int32(count),
            np.float32(response.alpha_w), np.float32(response.alpha_d), into,
            defines=RESPONSE_DEFINES,
        )  # fmt: skip

    def pores(
        count: int, places: Buffer, triangle: Buffer, stiff: Buffer | None, into: Buffer
    ) -> None:
        device.launch(
            "respond", "respond_pores", (-(-count // VECTOR),),
            triangle, stretch.logs, stiff, np.int32(count),
            np.float32(response.beta_w), np.float32(response.beta_d), into,
            defines=RESPONSE_DEFINES,
        )  # fmt: skip

    answer(device, elements, scales, wrinkles, pores)
    return scales


def answer(
    device: Device, elements: UdimElements, scales: ScaleBuffers, wrinkles: Answer, pores: Answer
) -> None:
    """Fill the scales of the elements of a UDIM: of copies with what their originals answer."""
    wrinkles(
        elements.wrinkles, elements.segments, elements.wrinkle_triangle, elements.wrinkle_stiffness,
        scales.wrinkles,
    )  # fmt: skip
    pores(
        elements.pores, elements.centres, elements.pore_triangle, elements.pore_stiffness,
        scales.pores,
    )  # fmt: skip
    of_copies = (
        (wrinkles, elements.wrinkle_origins, scales.wrinkles),
        (pores, elements.pore_origins, scales.pores),
    )
    for respond_to, origins, into in of_copies:
        if origins is not None:
            respond_to(
                origins.count, origins.places, origins.triangle, origins.stiffness, origins.scales
            )
            origins.give(device, into)


def redrawing(
    device: Device, elements: UdimElements, settings: AssetSettings, scales: ScaleBuffers
) -> Draw:
    """Draws any rectangle of level 0 of the frame that `scales` belong to."""

    def draw(row: int, column: int, side: int) -> Buffer:
        out = device.empty(side * side, np.float32)
        launch_blocks(
            device, "redraw", "redraw", settings, elements, (row, column, side),
            elements.segments, elements.sizes, scales.wrinkles, *_both(elements.wrinkle_lists),
            elements.centres, elements.roots, scales.pores, *_both(elements.pore_lists),
            *elements.wrinkle_arguments, into=(out,),
        )  # fmt: skip
        return out

    return draw


def launch_blocks(
    device: Device,
    program: str,
    kernel: str,
    settings: AssetSettings,
    elements: UdimElements,
    square: tuple[int, int, int],
    *arguments: Any,
    into: tuple[Any, ...],
    defines: Mapping[str, object] = NO_DEFINES,
) -> None:
    """Run a drawing kernel over a square (row, column, texels a side) of level 0, a work-group for
    some rows of a block by the launch shape of the device.
    arguments: of the elements.  into: those of what is written."""
    row, column, side = square
    blocks, rows = side // BLOCK, min(device.shape.rows, BLOCK)
    device.launch(
        program, kernel, (blocks * device.shape.lanes, side // rows), *arguments,
        shape_values(settings.shape), np.float32(settings.depth),
        np.int32(settings.resolution // BLOCK), np.int32(row // BLOCK), np.int32(column // BLOCK),
        *into, group=(device.shape.lanes, 1),
        defines={
            "BLOCK": BLOCK, "ROWS": rows, "ITEMS": device.shape.lanes,
            **elements.defines, **defines,
        },
    )  # fmt: skip


def shape_values(shape: ShapeSettings) -> NDArray[np.float32]:
    """The float4 that drawing kernels take: bulges, sharpness, slots."""
    values = (shape.wrinkle_bulge, shape.pore_bulge, shape.sharpness, shape.slots)
    return np.array(values, np.float32)


def _both(lists: Lists) -> tuple[Buffer, Buffer]:
    return lists.offsets, lists.members
