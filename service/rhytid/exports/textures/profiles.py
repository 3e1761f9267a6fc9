"""The profiles: the file that each writes, and its contents."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rhytid.errors import QueryError
from rhytid.exports.textures import USUAL, Shine, normals, shine, stretch, writers
from rhytid.exports.textures.frame_map import Facts, FrameMap
from rhytid.exports.textures.writers import image_library
from rhytid.formats.exr_encoder import renamed as exr_renamed
from rhytid.formats.png import renamed as png_renamed

_UDIM_FIRST, _FRAME_FIRST = "{udim}.{frame}", "{frame}.{udim}"


@dataclass(frozen=True)
class Profile:
    """One kind of texture file.

    key: identifies the bytes that it writes of a map: a change of the writer needs another key.
    extension: with its dot.  middle: between NAME and extension.  texel_bytes: before compression.
    working_bytes: of memory for a texel while its file is written, at most, beside displacement,
    chart and padding.  write: draws and writes one file, whole or not at all; returns its SHA-256,
    None where a library has written it.  packed: whether `--compression` is for it.  facts: for
    readers of the files, the same for all files of an asset.
    described: whether the facts are in a file beside them, too.  drawn: whether it shows
    displacement, and not only the stretch of the frame.  halves: whether half floats of it are
    enough.  posed: whether it reads the positions of
    the frame, too.  lagging: whether it reads those of frames before it.  of_slopes: whether it is
    made of moments of slopes.  tiled: whether it needs OpenImageIO.  renamed: a file with another
    text for one of its attributes; None where there is no quick way.
    """

    name: str
    key: str
    extension: str
    middle: str
    texel_bytes: float
    working_bytes: int
    write: Callable[[Path, FrameMap, Facts], str | None]
    facts: Callable[[FrameMap], Facts]
    described: bool = True
    packed: bool = False
    drawn: bool = True
    halves: bool = False
    posed: bool = False
    lagging: bool = False
    tiled: bool = False
    of_slopes: bool = False
    renamed: Callable[[bytes, str, str], list[bytes]] | None = exr_renamed

    def file_name(self, name: str, udim: int, frame: str) -> str:
        """The name of one file."""
        return f"{name}.{self.middle.format(udim=udim, frame=frame)}{self.extension}"

    def pattern(self, name: str) -> str:
        """The names of all files, with <UDIM> and <FRAME>."""
        return f"{name}.{self.middle.format(udim='<UDIM>', frame='<FRAME>')}{self.extension}"

    def all_facts(self, drawn: FrameMap) -> Facts:
        """The facts of the profile, with its name."""
        return {"profile": self.name, **self.facts(drawn)}

    def compressed(self, compression: str) -> Profile:
        """The profile with a compression, where it has a choice of them; `zip` is the usual one."""
        if not self.packed or compression == "zip":
            return self
        write: Callable[..., str | None] = self.write
        key = f"{self.key}-{compression}"
        return replace(self, key=key, write=partial(write, compression=compression))

    def shiny(self, how: Shine) -> Profile:
        """The profile of a level, where it is made of slopes: normals where one is given."""
        write: Callable[..., str | None] = self.write
        facts: Callable[..., Facts] = self.facts
        if self.name.startswith("normal") and how.level is not None:
            write, facts = shine.write_mean_normals, partial(shine.normal_facts, self.facts)
        elif not self.of_slopes:
            return self
        rough = self.name in ("roughness", "anisotropy")
        if how.of_moments == 0 and rough:
            raise QueryError(
                f"{self.name} of level 0: a texel there has one slope; choose level 1 or coarser"
            )
        return replace(
            self,
            key=f"{self.key}-{how.of_moments}" + (f"-{how.roughness!r}" if rough else ""),
            write=partial(write, shine=how),
            facts=partial(facts, shine=how),
            texel_bytes=self.texel_bytes / 4**how.of_moments,
            of_slopes=True,
        )

    def check(self) -> None:
        """Raise InputError where a library that the profile needs is missing."""
        if self.tiled:
            image_library()


_MIPMAPPED = 4.0 * 4.0 / 3.0
_ALL = (
    Profile(
        "float", "single-2", ".exr", _UDIM_FIRST, 4.0, 10,
        writers.write_float, writers.plain_facts, described=False, packed=True,
    ),
    Profile(
        "half", "half-2", ".exr", _UDIM_FIRST, 2.0, 8,
        writers.write_half, writers.plain_facts, described=False, packed=True, halves=True,
    ),
    Profile(
        "png16", "png16-4", ".png", f"png16.{_UDIM_FIRST}", 2.0, 14,
        writers.write_png16, writers.png16_facts, renamed=png_renamed,
    ),
    Profile(
        "normal-gl", "normal-gl-5", ".png", f"normal-gl.{_UDIM_FIRST}", 6.0, 26,
        normals.write_normals, normals.normal_gl_facts, posed=True, renamed=png_renamed,
    ),
    Profile(
        "normal-dx", "normal-dx-5", ".png", f"normal-dx.{_FRAME_FIRST}", 6.0, 26,
        normals.write_normals, normals.normal_dx_facts, posed=True, renamed=png_renamed,
    ),
    Profile(
        "cavity", "cavity-3", ".png", f"cavity.{_FRAME_FIRST}", 1.0, 16,
        writers.write_cavity, writers.cavity_facts, renamed=png_renamed,
    ),
    Profile(
        "weights", "weights-3", ".png", f"weights.{_FRAME_FIRST}", 3.0, 32,
        stretch.write_weights, stretch.weight_facts, drawn=False, posed=True, renamed=png_renamed,
    ),
    Profile(
        "stretch", "stretch-1", ".exr", f"stretch.{_UDIM_FIRST}", 6.0, 32,
        stretch.write_stretch, stretch.stretch_facts, described=False, drawn=False, posed=True,
    ),
    Profile(
        "blood", "blood-3", ".png", f"blood.{_UDIM_FIRST}", 2.0, 14,
        stretch.write_blood, stretch.blood_facts, drawn=False, lagging=True, renamed=png_renamed,
    ),
    Profile(
        "slopes", "slopes-1", ".exr", f"slopes.{_UDIM_FIRST}", 20.0, 48,
        shine.write_slopes, shine.slope_facts, described=False, posed=True, of_slopes=True,
    ),
    Profile(
        "roughness", "roughness-3", ".png", f"roughness.{_UDIM_FIRST}", 6.0, 64,
        shine.write_roughness, shine.roughness_facts, posed=True, of_slopes=True,
        renamed=png_renamed,
    ),
    Profile(
        "anisotropy", "anisotropy-3", ".png", f"anisotropy.{_UDIM_FIRST}", 6.0, 64,
        shine.write_anisotropy, shine.anisotropy_facts, posed=True, of_slopes=True,
        renamed=png_renamed,
    ),
    Profile(
        "mip", "mip-1", ".exr", f"mip.{_UDIM_FIRST}", _MIPMAPPED, 16,
        writers.write_mipmapped, writers.plain_facts, described=False, tiled=True, renamed=None,
    ),
    Profile(
        "tx", "tx-1", ".tx", _UDIM_FIRST, _MIPMAPPED, 16,
        writers.write_mipmapped, writers.plain_facts, described=False, tiled=True, renamed=None,
    ),
)  # fmt: skip
PROFILES: Mapping[str, Profile] = {profile.name: profile for profile in _ALL}


def profiles_of(
    names: list[str], compression: str = "zip", how: Shine = USUAL
) -> tuple[Profile, ...]:
    """The profiles of these names, each once, in the order of the table.

    compression: one of COMPRESSIONS, of the profiles float and half.  how: of those made of slopes,
    and of normals.

    Raises QueryError for an unknown name, for roughness of level 0 and where two would write the
    same files, InputError where a library is missing.
    """
    for name in names:
        if name not in PROFILES:
            raise QueryError(f"profile {name!r:.40}: one of {', '.join(PROFILES)}")
    found = tuple(
        profile.compressed(compression).shiny(how) for profile in _ALL if profile.name in names
    )
    patterns = [profile.pattern("NAME") for profile in found]
    for number, pattern in enumerate(patterns):
        if (first := patterns.index(pattern)) != number:
            both = f"{found[first].name} and {found[number].name}"
            raise QueryError(
                f"profiles {both} have the same file names: bake them into two folders"
            )
    for profile in found:
        profile.check()
    return found


def halves_are_enough(profiles: Iterable[Profile]) -> bool:
    """Whether none of some profiles needs more of the displacement than half floats."""
    return all(profile.halves for profile in profiles if profile.drawn)
