"""The manifest of a package, from what is known of its asset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rhytid import __version__
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.exports.skin_package import manifest as m
from rhytid.exports.skin_package.languages import BINDINGS, LANGUAGES, RESIDUAL
from rhytid.exports.skin_package.maps import FIRST_CODE, WRINKLES, SkinMaps
from rhytid.exports.skin_package.shaders import COMPUTE, materialx_files, stretch_file
from rhytid.pipeline.cushion import CUSHIONS
from rhytid.pipeline.events import EVENT_LAYER
from rhytid.pipeline.folding import FoldRule

TRIANGLES_A_ROW = 1024


@dataclass(frozen=True)
class PackageTextures:
    """The textures of a package as the manifest describes them.

    wrinkles: stored as sets, so that what the numbers of their texels stand for comes with them.
    cushions: maps, owners and lines.  residual: of a scanned skin.
    """

    maps: m.Textures
    wrinkles: tuple[m.Textures, m.Codes]
    triangles: m.Textures
    cushions: tuple[m.Textures, m.Textures, m.Lines] | None
    residual: m.Textures | None = None


def package_manifest(
    maps: SkinMaps, mesh: Mesh, shapes: Expressions | None, written: PackageTextures
) -> m.Manifest:
    """The manifest of a package with these textures."""
    wrinkles, wrinkle_codes = written.wrinkles
    found, beside = [written.maps, written.triangles, wrinkles], wrinkle_codes.bytes
    if written.cushions is not None:
        maps_of_cushions, owners, lines = written.cushions
        found += [maps_of_cushions, owners]
        beside += lines.bytes
    if written.residual is not None:
        found.append(written.residual)
    return m.Manifest(
        **_facts(maps),
        mesh=_mesh(mesh, shapes),
        blend=_blend(maps),
        layers=_layers(maps),
        wrinkles=m.Wrinkles(textures=wrinkles, codes=wrinkle_codes),
        textures=written.maps,
        triangles=written.triangles,
        cushion=_cushion(maps, written),
        residual=_residual(maps, written.residual),
        stretch=_stretch(maps, mesh),
        weights=_weights(maps, len(mesh.faces)),
        shaders={dialect: _shaders(dialect, written) for dialect in LANGUAGES},
        materialx=materialx_files(),
        texture_bytes=beside + sum(one.bytes for one in found),
        texture_bytes_of_level_0=beside + sum(one.bytes_of_level_0 for one in found),
        conventions=m.CONVENTIONS,
        left_out=m.LEFT_OUT,
    )


def _facts(maps: SkinMaps) -> dict[str, Any]:
    """The asset of the package, and its settings."""
    settings = maps.settings
    return {
        "format": m.FORMAT,
        "version": m.VERSION if maps.residual is None else m.SCANNED_VERSION,
        "rhytid_version": __version__,
        "asset": maps.asset,
        "preset": settings.preset,
        "unit": settings.length_unit,
        "unit_in_metres": maps.metres,
        "scale": maps.scale,
        "resolution": settings.resolution,
        "udims": list(maps.engine.assets.info(maps.asset).udims),
        "settings": settings.drawn(),
    }


def _mesh(mesh: Mesh, shapes: Expressions | None) -> m.Mesh:
    names = [] if shapes is None else list(shapes.names)
    return m.Mesh(
        file="skin.glb", vertices=len(mesh.positions), shapes=names, centre=mesh.centre.tolist()
    )


def _blend(maps: SkinMaps) -> m.Blend:
    bins = maps.bins
    return m.Blend(
        angles=list(bins.angles),
        r_max=maps.settings.bins.r_max,
        last_sample=maps.settings.last_sample,
        merge=bins.merge,
        sharpness=bins.sharpness,
        depth=bins.depth,
        log_stretch_limit=bins.log_stretch_limit,
        scale_limit=bins.scale_limit,
        soft_limits=bins.soft_limits,
        # A single bin has no angles for a line.
        tilt=m.Tilt(node=bins.tilt.node) if bins.tilt and len(bins.angles) > 1 else None,
        grain=m.Grain(exponent=bins.grain.exponent) if bins.grain else None,
    )


def _layers(maps: SkinMaps) -> list[m.Layer]:
    found = [_layer(maps, WRINKLES)]
    first = 0
    for name in maps.names:
        found.append(_layer(maps, name, first))
        first += maps.count(name)
    return found


def _layer(maps: SkinMaps, name: str, first: int = 0) -> m.Layer:
    bins = maps.bins
    samples = {
        "pores": bins.pore_samples,
        "wrinkles": bins.samples,
        CUSHIONS: () if bins.cushion is None else bins.cushion.samples,
        EVENT_LAYER: (0.0, 0.0),
    }
    pores = name in ("pores", EVENT_LAYER)
    return m.Layer(
        name=name,
        first=first,
        bins=bins.layers[name],
        samples=list(samples.get(name, (0.0,))),
        steps=list(bins.steps[name]),
        depth_exponent=bins.depth_exponents[name if pores else "wrinkles"],
        depth_limit=bins.pore_depth_limit if pores else bins.scale_limit,
    )


def _cushion(maps: SkinMaps, written: PackageTextures) -> m.Cushion | None:
    cushion = maps.bins.cushion
    if cushion is None or written.cushions is None:
        return None
    textures, owners, lines = written.cushions
    layer = _layer(maps, CUSHIONS).model_copy(update={"depth_exponent": cushion.exponent})
    return m.Cushion(
        textures=textures,
        owners=owners,
        lines=lines,
        layer=layer,
        factor=cushion.factor,
        apron=cushion.apron,
    )


def _residual(maps: SkinMaps, textures: m.Textures | None) -> m.Residual | None:
    if textures is None or maps.residual_steps is None:
        return None
    step, middle = maps.residual_steps
    return m.Residual(textures=textures, step=step, first=middle - FIRST_CODE * step)


def _weights(maps: SkinMaps, triangles: int) -> m.Weights:
    layers, rows = len(maps.bins.angles) + 1, _rows(triangles)
    layers += maps.bins.grain is not None or EVENT_LAYER in maps.bins.layers
    return m.Weights(width=TRIANGLES_A_ROW, height=layers * rows, rows=rows)


def _rows(triangles: int) -> int:
    """Rows of a texture with an entry for each triangle, and one for no triangle."""
    return -(-(triangles + 1) // TRIANGLES_A_ROW)


def _stretch(maps: SkinMaps, mesh: Mesh) -> m.Stretch:
    triangles = len(mesh.faces)
    return m.Stretch(
        triangles=triangles,
        triangles_a_row=TRIANGLES_A_ROW,
        width=2 * TRIANGLES_A_ROW,
        height=_rows(triangles),
        rest="triangles.bin",
        python="stretch.py",
        javascript="stretch.js",
        compute={name: stretch_file(name) for name in COMPUTE},
        folds=_folds(maps, mesh),
    )


def _folds(maps: SkinMaps, mesh: Mesh) -> m.Folds | None:
    amount = maps.settings.response.folds
    if amount == 0.0:
        return None
    rule = FoldRule.of(mesh, maps.settings.length_unit)
    return m.Folds(
        length=rule.length,
        most=amount * rule.most,
        least=rule.least,
        most_bend=rule.most_bend,
        rounds=rule.rounds,
        normal_rounds=rule.normal_rounds,
        python="folds.py",
        javascript="folds.js",
    )


# Functions alone.
_LIBRARIES = ("weights", "skin", "shine")


def _shaders(dialect: str, written: PackageTextures) -> m.Shaders:
    broad = [] if written.cushions is None else ["lines", "cushion"]
    passes = ["weights", *broad, "height"]
    names = {name: n for n, name in enumerate(BINDINGS)}
    if written.residual is None:
        del names[RESIDUAL]
    language = LANGUAGES[dialect]
    folder, suffix = f"shaders/{dialect}", language.suffix
    return m.Shaders(
        libraries={name: f"shaders/{name}.{language.ending}" for name in _LIBRARIES},
        vertex=f"{folder}/full.vert{suffix}",
        passes={name: f"{folder}/{name}.frag{suffix}" for name in passes},
        moments={name: f"{folder}/{name}.frag{suffix}" for name in ("slopes", "products")},
        bindings=names if dialect == "wgsl" else None,
    )
