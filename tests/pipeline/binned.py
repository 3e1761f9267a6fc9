"""One tile of precomputed maps: the product's, and what the reference makes of the same scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.scenes import DEPTH, EDGE_BAND, Scene
from reference import bins as reference
from reference import drawing, locate
from rhytid.domain.tiles import udim_origin
from rhytid.pipeline.bin_maker import BinMaker
from rhytid.pipeline.bins import map_count, parts
from rhytid.pipeline.blend import Blend
from rhytid.pipeline.line_stretches import LineStretches
from rhytid.pipeline.locate import UdimTriangles
from rhytid.pipeline.redraw import R_ALONE, wrinkle_responder
from rhytid.pipeline.vectors import VECTOR

TILE = 64


def stored_maps(device, tile, bins):
    """(maps, P) codes of a tile, as they are stored."""
    shape = (tile.texels // VECTOR, map_count(bins), VECTOR)
    codes = device.read(tile.codes, shape, f"i{bins.bits // 8}").swapaxes(0, 1)
    return codes.reshape(map_count(bins), tile.texels)


def stored_layers(device, tile, bins):
    """Of each layer (parts, M, P) codes of a tile, signed as they are stored."""
    ends = np.cumsum([len(parts(bins)) * m for m in bins.layer_samples])
    maps = np.delete(stored_maps(device, tile, bins), tilt_places(bins), axis=0)
    layers = np.split(maps, ends)[:-1]
    return [maps.reshape(len(parts(bins)), -1, tile.texels) for maps in layers]


def stored_codes(device, tile, bins):
    """(N + 1, parts, M, P) of layers that have as many samples."""
    return np.stack(stored_layers(device, tile, bins))


def tilt_places(bins):
    """The indices of the tilts: each behind the other maps of its bin."""
    each = len(parts(bins)) * bins.samples
    return [n * (each + 1) + each for n in range(bins.count)] if bins.tilt else []


class BinnedScene(Scene):
    """One tile of one UDIM: the maps of the product, and both sides of what comes of them."""

    def __init__(self, device, mesh, graph, settings, at=(64, 128), udim=1001):
        super().__init__(device, mesh, graph, settings)
        self.udim = udim
        self.located = UdimTriangles(device, mesh, udim, settings.resolution, settings.padding)
        maker = BinMaker(device, self.elements(udim), self.located, settings)
        self.tile = maker.tile(*at, TILE)
        self.points = drawing.crop(*at, TILE, TILE, settings.resolution)

    def layers(self, tile=None, side=TILE):
        """Of each layer (M, sides, P) as the reference has it: apart, valleys are positive too."""
        tile, bins = tile or self.tile, self.settings.bins
        stored = stored_layers(self.device, tile, bins)
        apart = [-1, 1] if bins.merge == "mellow" else [1]
        signs = np.array(apart, stored[0].dtype)[:, None, None]
        return [np.swapaxes(maps * signs, 0, 1)[..., : side * side] for maps in stored]

    def codes(self, tile=None, side=TILE):
        """(N + 1, M, sides, P), where all layers have as many samples."""
        return np.stack(self.layers(tile, side))

    def tilts(self):
        """(N, P) codes of the tilts of each bin."""
        bins = self.settings.bins
        return stored_maps(self.device, self.tile, bins)[tilt_places(bins)]

    def lines(self, stretch):
        """r at the ends of wrinkles."""
        elements = self.elements(self.udim)
        responder = wrinkle_responder(self.device, self.settings, stretch, R_ALONE)
        found = LineStretches.allocate(self.device, elements)
        found.fill(self.device, elements, self.settings, responder)
        return found.ends

    def blended(self, positions, model="tensor"):
        blend = Blend(self.device, self.settings, len(self.mesh.faces))
        out = blend.tile(self.tile, blend.coefficients(self.stretch(positions, model)))
        return self.device.read(out, (TILE * TILE,), np.float32)

    def reference_codes(self, layer, bits=None, points=None):
        """(M, sides, P) of one layer."""
        settings = self.settings
        bins = replace(settings.bins, bits=bits or settings.bins.bits)
        return reference.codes(
            self.points if points is None else points, self.graph, layer, settings.response,
            settings.shape, bins, DEPTH, udim_origin(self.udim),
            self.reference_waves(),
        )  # fmt: skip

    def reference_blend(self, codes, positions, model="tensor"):
        """(P,) the blend of the product's own codes, and whether a texel's triangle is sure."""
        settings = self.settings
        index, margin = locate.locate(
            self.points + udim_origin(self.udim),
            self.mesh.triangle_uv(),
            settings.padding / settings.resolution,
        )
        logs, axes = locate.sample(index, *self.reference_logs(positions, model))
        r = reference.layer_stretch(logs, axes, settings.bins.count)
        layers = [maps.astype(np.int64) for maps in codes]
        tilted = None
        if settings.bins.tilt:
            sides = reference.sides_of(logs, axes, settings.bins.count)
            tilted = reference.Tilts(self.tilts().astype(np.int64), *sides)
        found = reference.blend(
            layers, r, settings.response, settings.shape, settings.bins, DEPTH, tilted
        )
        return found, margin > EDGE_BAND
