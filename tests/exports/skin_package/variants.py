"""Shader texts of packages with other settings, without their maps."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from rhytid.exports.skin_package.manifest import Layer, Manifest, Residual
from rhytid.exports.skin_package.shaders import MERGES, shader_texts

STAGES = ("vert", "frag", "comp")


def whole_shaders(full: Manifest, language: str) -> Iterator[tuple[str, str, str]]:
    """Name, stage and text of every whole shader in a language (`glsl`, `hlsl`, `wgsl`), of every
    merge, with all that is optional and without.  full: has all that is optional."""
    for merge, plain in product(MERGES, (False, True)):
        said = f"{merge}, plain" if plain else merge
        for file, text in shader_texts(_changed(full, merge, plain)).items():
            folder, stage = file.split("/")[1], file.split(".")[1]
            if folder.startswith(language) and stage in STAGES:
                yield f"{file} ({said})", stage, text


def _changed(full: Manifest, merge: str, plain: bool) -> Manifest:
    """Plain: without soft limits, tilt, grain, events, cushion and residual."""
    assert None not in (full.blend.tilt, full.blend.grain, full.cushion)
    blend = full.blend.model_copy(update={"merge": merge, "soft_limits": not plain})
    if not plain:
        layers = [*full.layers, _events(full)]
        scanned = Residual(textures=full.triangles, step=1e-6, first=-0.03)
        return full.model_copy(update={"blend": blend, "layers": layers, "residual": scanned})
    blend = blend.model_copy(update={"tilt": None, "grain": None})
    shaders = {
        name: one.model_copy(
            update={
                "passes": {k: v for k, v in one.passes.items() if k not in ("lines", "cushion")}
            }
        )
        for name, one in full.shaders.items()
    }
    return full.model_copy(update={"blend": blend, "cushion": None, "shaders": shaders})


def _events(full: Manifest) -> Layer:
    """The layer of events after the maps that the package has."""
    pores = next(layer for layer in full.layers if layer.name == "pores")
    more = {"name": "events", "first": full.textures.maps, "samples": [0.0, 0.0]}
    return pores.model_copy(update={**more, "steps": [1e-4, 4e-7], "bins": 1})
