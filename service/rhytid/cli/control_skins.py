"""Pictures of a small piece of skin, at any value of any control."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rhytid.cli.control_samples import STIFFNESS, ControlSample
from rhytid.cli.preview import drawn_under, resident, resolution_for
from rhytid.cli.preview_spots import flat_spots, spot_at
from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.lengths import MILLIMETRES, USUAL_UNIT, millimetres
from rhytid.domain.mesh import Mesh
from rhytid.domain.painted_maps import Controls, Stiffness
from rhytid.domain.tiles import triangles_inside, udim_origin
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.errors import InputError
from rhytid.meshes.nearest import cut_around
from rhytid.pictures.sheet import PATCH, LabelledPatch
from rhytid.pictures.surface_patch import SurfacePatch, surface_patch
from rhytid.synthesis.generate import Synthesis, synthesize
from rhytid.synthesis.progress import silent

# Of a patch, and of the skin around it that its lines grow from, millimetres.
SIDE_MM, AROUND_MM = 10.0, 12.0
# How much shorter pressed skin is from left to right, and where light comes from, degrees.
PRESSED, LIGHT = 0.2, 30.0


class ControlSkins:
    """A patch of a mesh whose skin is drawn at values of controls.

    unit: length unit of the mesh.  place: u and v, or x, y and z, of the patch; empty for the
    flattest place. Raises InputError where no patch fits.
    """

    def __init__(self, device: Device, mesh: Mesh, unit: str, place: Sequence[float] = ()) -> None:
        self._device, self._unit = device, unit
        self.unit_mm = millimetres(unit) or MILLIMETRES[USUAL_UNIT]
        side = SIDE_MM / self.unit_mm
        near = spot_at(mesh, place, side) if place else flat_spots(mesh, [side])
        if not near.spots:
            raise InputError(f"no place of the mesh is flat over {SIDE_MM:g} mm: --patch names one")
        self._spot, self._udim, self._side = near.spots[0], near.udim, side
        radius = (SIDE_MM / np.sqrt(2) + AROUND_MM) / self.unit_mm
        self._mesh = cut_around(mesh, near.udim, self._spot.frame.origin, radius)
        self._grown: dict[str, Synthesis] = {}
        self._resting = self._surface(NEUTRAL_FRAME)
        self._frame = Frame.of(self._pressed())
        self._pressing = self._surface(self._frame)

    def patch(self, sample: ControlSample) -> LabelledPatch:
        """The picture of a control at one value."""
        settings = AssetSettings.parse({"unit": self._unit, **sample.settings}).for_synthesis()
        made = self._skin(settings, sample)
        resolution = resolution_for([self._spot.scale], made.spacing)
        drawn = settings.with_lengths(made.lengths).changed({"resolution": resolution})
        stiffness = Stiffness(self._mask(sample)) if sample.name == STIFFNESS else None
        frame, surface = NEUTRAL_FRAME, self._resting
        if sample.pressed:
            frame, surface = self._frame, self._pressing
        with resident(self._device, self._mesh, made.graph, drawn, stiffness) as asset:
            heights = drawn_under(asset, self._udim, [surface], silent, frame)
        return LabelledPatch(sample.label, surface.picture(heights, LIGHT))

    def _skin(self, settings: AssetSettings, sample: ControlSample) -> Synthesis:
        """The skin of a value. Values that only change how skin is drawn share one."""
        masked = sample.grey is not None and sample.name != STIFFNESS
        controls = Controls({sample.name: self._mask(sample)}) if masked else None
        graph = settings.as_json()["graph"]
        key = json.dumps([graph, sample.name if masked else "", sample.grey if masked else 0])
        if key not in self._grown:
            made = synthesize(
                self._mesh, settings.graph, self._device, controls=controls, unit=self._unit
            )
            self._grown[key] = made
        return self._grown[key]

    def _mask(self, sample: ControlSample) -> dict[int, NDArray[np.float32]]:
        """A mask that has one grey everywhere."""
        return {self._udim: np.full((2, 2), sample.grey, np.float32)}

    def _pressed(self) -> NDArray[np.float32]:
        """(V, 3) positions of the piece, pressed together from left and right."""
        frame, positions = self._spot.frame, self._mesh.positions.astype(np.float64)
        right = frame.axes[0]
        across = (positions - frame.origin) @ right
        moved: NDArray[np.float32] = positions - PRESSED * across[:, None] * right
        return moved.astype(np.float32)

    def _surface(self, frame: Frame) -> SurfacePatch:
        positions = self._mesh.positions if frame.positions is None else frame.positions
        inside = triangles_inside(self._mesh, self._udim)
        corners = positions[self._mesh.faces[inside]].astype(np.float64)
        uv = self._mesh.triangle_uv()[inside] - udim_origin(self._udim)
        return surface_patch(corners, uv, self._spot.frame, self._side, PATCH)
