"""Notices: facts of an asset that are worth knowing and no mistakes; `strict` ignores them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from rhytid.domain.asset_settings import MOST_WRINKLES, AssetSettings
from rhytid.domain.lengths import GRAIN, SKIN, millimetres
from rhytid.domain.setting_fields import leaves, nested
from rhytid.domain.skin import depth_factor
from rhytid.domain.warnings import Meaning

GRAIN_NOT_DRAWN = "grain-not-drawn"
FEW_TEXELS = "few-texels"
LARGE_BUILD = "large-build"
PRESET_SET = "preset-set"
SCAN_REDRAWN = "scan-redrawn"
ARRAYS_NOT_READ = "arrays-not-read"
# few-texels: texels between pores from which on they are told apart.
TEXELS_BETWEEN = 4.0
# large-build: wrinkles beyond which more than a head may have been asked for. A face has about half
# a million at the usual spacing, and 20 million take three minutes and 4.6 GB on two cores.
LARGE_WRINKLES = 5_000_000
# Texels to a wave from which on an octave of the grain is drawn, as grain_codes.cl has it.
LEAST_TEXELS = 2.0
_RESOLUTIONS = tuple(2**n for n in range(8, 15))


@dataclass(frozen=True)
class Notice:
    """A fact worth knowing.  code: one of NOTICES.  detail: what, and what to do, in plain text."""

    code: str
    detail: str

    def __str__(self) -> str:
        return f"{self.code}: {self.detail}"


# Lists of assets ask for the same notices again and again.
@lru_cache(1024)
def grain_notice(settings: AssetSettings, uv_length: float) -> tuple[Notice, ...]:
    """A notice where half of the skin or more is drawn without the grain that is set, for its waves
    are shorter than two texels there.

    uv_length: `usual_uv_length` of the mesh.
    """
    size = _grain_size(settings)
    if settings.shape.grain == 0.0 or size is None or uv_length <= 0.0:
        return ()
    texel = uv_length / settings.resolution
    if size >= LEAST_TEXELS * texel:
        return ()
    waves, least = _length(size, settings), _length(LEAST_TEXELS * texel, settings)
    finer = [r for r in _RESOLUTIONS if size * r >= LEAST_TEXELS * uv_length]
    drawn = f"resolution {finer[0]} draws it" if finer else "no resolution draws it"
    detail = (
        f"no grain is drawn on half of the skin or more: its largest waves are {waves} long, and "
        f"at {settings.resolution} x {settings.resolution} texels carry waves from {least} on; "
        f"{drawn}, so would shape.grain_size {LEAST_TEXELS * texel:.3g}; shape.grain 0 is without"
    )
    return (Notice(GRAIN_NOT_DRAWN, detail),)


@lru_cache(1024)
def texel_notice(
    settings: AssetSettings, uv_length: float, spacing: float | None = None
) -> tuple[Notice, ...]:
    """A notice where fewer than four texels lie between pores on half of the skin or more.

    uv_length: `usual_uv_length` of the mesh.  spacing: of the pores, mesh units; None for that of
    the settings.
    """
    graph = settings.graph
    if spacing is None and graph.spacing is not None:
        spacing = graph.spacing * graph.density**-0.5
    texel = uv_length / settings.resolution
    if spacing is None or uv_length <= 0.0 or spacing >= TEXELS_BETWEEN * texel:
        return ()
    fine = [r for r in _RESOLUTIONS if spacing * r >= TEXELS_BETWEEN * uv_length]
    would = f"a resolution of {fine[0]} would do" if fine else "no resolution would do: use UDIMs"
    detail = (
        f"fewer than four texels lie between pores on half of the skin or more: pores are "
        f"{_length(spacing, settings)} apart and the longer side of texels is "
        f"{_length(texel, settings)} at {settings.resolution} x {settings.resolution}; {would}"
    )
    return (Notice(FEW_TEXELS, detail),)


def build_notice(wrinkles: int) -> tuple[Notice, ...]:
    """A notice where a build will make many wrinkles."""
    if wrinkles <= LARGE_WRINKLES:
        return ()
    detail = (
        f"about {wrinkles / 1e6:.2g} million wrinkles: a face has about half a million; mask "
        "the face (paint density 0 elsewhere) or raise the spacing for less"
    )
    if wrinkles > MOST_WRINKLES:
        detail += f"; more than the {MOST_WRINKLES / 1e6:g} million that a graph holds are refused"
    return (Notice(LARGE_BUILD, detail),)


def preset_notice(
    before: AssetSettings, after: AssetSettings, sent: Mapping[str, Any]
) -> tuple[Notice, ...]:
    """A notice where a preset that was sent changed other settings than were sent with it.

    sent: the changes that lead from `before` to `after`, as nested as settings are.
    """
    if "preset" not in sent:
        return ()
    now, named = leaves(after.as_json()), leaves(sent)
    former = leaves(before.as_json()).items()
    changed = {n: value for n, value in former if n not in named and now[n] != value}
    if not changed:
        return ()
    listed = [f"{n} is {_json(now[n])}, was {_json(value)}" for n, value in changed.items()]
    detail = (
        f"preset {after.preset} sets all of its keys anew, these too: {'; '.join(listed)}. To keep "
        "one, send it beside the preset"
    )
    return (Notice(PRESET_SET, detail),)


def redrawn_notice(before: AssetSettings, after: AssetSettings) -> tuple[Notice, ...]:
    """A notice where a change draws the lines of a scanned skin otherwise at rest, with the values
    of before that do not."""
    former, now = before.as_json(), after.as_json()
    was, is_now = (leaves({n: part[n] for n in ("depth", "shape")}) for part in (former, now))
    changed = {name: value for name, value in was.items() if is_now[name] != value}
    if not changed:
        return ()
    listed = "; ".join(f"{n} is {_json(is_now[n])}, was {_json(v)}" for n, v in changed.items())
    detail = (
        f"the lines of this scanned skin are drawn otherwise at rest, so that it is no longer what "
        f"it was there: {listed}. To have that back, PATCH {_json(nested(changed))}"
    )
    return (Notice(SCAN_REDRAWN, detail),)


def spacing_of_count(settings: AssetSettings, spacing: float, grown: int) -> str:
    """A line about the lengths that follow where `graph.wrinkles` fixes how far apart pores are,
    and about the number of wrinkles where that is another.

    settings: resolved.  spacing: of pores, where their density is 1, mesh units; the usual one
    counts likewise, and depths follow it.  grown: how many wrinkles there are, without copies.
    """
    assert settings.depth is not None
    depth, shape = settings.depth, settings.shape
    known = millimetres(settings.length_unit) is not None
    usual = f" (usually {SKIN.spacing:g} mm)" if known else ""
    deep = f" (usually {SKIN.depth * depth_factor(settings.graph.age):.3g} mm)" if known else ""
    assert settings.graph.wrinkles is not None
    asked = round(settings.graph.wrinkles * settings.graph.density)
    other = f"{grown} have grown, not {asked}: {_other_count(settings)}; " if grown != asked else ""
    return other + (
        f"{settings.graph.wrinkles} wrinkles fix the spacing, and depths follow it: pores are "
        f"{_length(spacing, settings)} apart{usual}, furrows of strength 1 are "
        f"{_length(depth, settings)} deep{deep}, grain {_length(shape.grain * depth, settings)} "
        f"and undulation {_length(shape.undulation * depth, settings)} rms"
    )


def _other_count(settings: AssetSettings) -> str:
    """Why another number of wrinkles grows than settings ask for."""
    return (
        f"that many are for skin of density {settings.graph.density:g} everywhere, and regions of "
        "the face and what is painted have other densities"
    )


def _grain_size(settings: AssetSettings) -> float | None:
    """The largest wavelength, mesh units; None where it is not known yet."""
    given, length = settings.shape.grain_size, millimetres(settings.length_unit)
    if given is not None:
        return given
    return None if length is None else GRAIN.millimetres / length


def _length(value: float, settings: AssetSettings) -> str:
    length = millimetres(settings.length_unit)
    if length is None:
        return f"{value:.3g} {settings.length_unit}"
    return f"{value * length:.3g} mm"


def _json(value: Any) -> str:
    return json.dumps(value)


# What each code means, in the order of the docs.
NOTICES: dict[str, Meaning] = {
    GRAIN_NOT_DRAWN: Meaning(
        "an asset",
        (
            "the largest wave of the grain is shorter than two texels on half of the skin or "
            "more, so that none of it is drawn there"
        ),
        (
            "raise `resolution` for the final maps, or `shape.grain_size`; `shape.grain` 0 is "
            "without grain. In a draft it may stay"
        ),
    ),
    FEW_TEXELS: Meaning(
        "an asset, a mesh that is checked",
        "fewer than four texels lie between pores on half of the skin or more",
        (
            "raise `resolution` for the final maps to what the text says, or `graph.spacing`; "
            "give skin more room in UV, or UDIMs. In a draft it may stay"
        ),
    ),
    LARGE_BUILD: Meaning(
        "an asset that builds, a mesh that is checked",
        "there will be more than 5 million wrinkles (a face has about half a million)",
        (
            "mask the face: paint `density` 0 elsewhere; or raise `graph.spacing`. If all of it "
            "is wanted it may stay"
        ),
    ),
    PRESET_SET: Meaning(
        "the change of an asset, in the answer to it alone",
        "a preset was sent, and it changed settings that were not",
        "to keep one as it was, send it beside the preset",
    ),
    SCAN_REDRAWN: Meaning(
        "the change of a scanned asset, in the answer to it alone",
        "`depth` or `shape` changed, in which its lines were traced: at rest it is the scan no "
        "more",
        "send the values back that the text has; `response` says how lines move and may change",
    ),
    ARRAYS_NOT_READ: Meaning(
        "an npz that is sent as a mesh, in the answer to it alone",
        "it has arrays that are not read, and no name is near that of one that is not there",
        "nothing, where they are for other programs",
    ),
}
