"""Writes a skin package: textures, mesh, stretch, shaders, and the manifest last."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import rhytid_viewer
from rhytid import __version__
from rhytid.domain.expressions import Expressions
from rhytid.domain.mesh import Mesh
from rhytid.errors import InputError
from rhytid.exports.meshes import write_morph_glb
from rhytid.exports.skin_package.cushion_lines import LINE_BYTES, CushionFiles
from rhytid.exports.skin_package.describe import PackageTextures, package_manifest
from rhytid.exports.skin_package.languages import LANGUAGES
from rhytid.exports.skin_package.manifest import FORMAT, Manifest, schema
from rhytid.exports.skin_package.maps import WRINKLES, SkinMaps, UdimMaps
from rhytid.exports.skin_package.runtime import runtime
from rhytid.exports.skin_package.runtime.stretch import rest_of
from rhytid.exports.skin_package.shaders import COMPUTE, materialx_texts, shader_texts
from rhytid.exports.skin_package.texture_arrays import (
    BESIDE,
    Paging,
    SetFiles,
    TextureFiles,
    index_channel,
    pyramid,
)
from rhytid.formats.ktx2 import CHANNELS
from rhytid.pipeline.cushion import CUSHIONS, OWNERS, PLACES
from rhytid.support.atomic_files import atomic_write, write_file
from rhytid.support.build_identity import modules_digest

MANIFEST, SCHEMA, MESH, REST = "manifest.json", "manifest.schema.json", "skin.glb", "triangles.bin"
TEXTURES = (
    "maps", "wrinkles", "wrinkles_codes", "triangles",
    "cushions", "cushion_owners", "cushion_lines",
    "residual",
    "cushions_codes", "cushion_triangles",  # of packages of before
)  # fmt: skip
Step = Callable[[], None]
# The packages of modules that write files of skin packages.
_WRITTEN_BY = ("rhytid.exports", "rhytid.formats")


@cache
def package_version() -> str:
    """The version of rhytid, with a digest of the modules, shaders and pages that packages are made
    by and made of.

    Where it differs, the same asset may give other files.
    """
    return f"{__version__}+{modules_digest(*_WRITTEN_BY, extra=rhytid_viewer.laid_out())}"


def has_package(folder: Path) -> bool:
    """Whether a folder holds a whole package, which another may replace; raises InputError where
    its manifest.json is of something else."""
    path, found = folder / MANIFEST, None
    try:
        found = json.loads(path.read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError, RecursionError):
        pass
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise InputError(f"{path} is not of a skin package: choose another folder")
    return True


class PackageWriter:
    """Writes the package of an asset into a folder, step by step.

    A folder without manifest.json holds no whole package.  levels: of the maps; None: down to one
    texel per page.  Raises LimitError where WebGL2 has too few layers.
    """

    def __init__(
        self,
        maps: SkinMaps,
        mesh: Mesh,
        shapes: Expressions | None,
        folder: Path,
        levels: int | None = None,
    ) -> None:
        self._maps, self._mesh, self._shapes, self._folder = maps, mesh, shapes, folder
        count, side = sum(map(maps.count, maps.names)), maps.settings.resolution
        self._paging = Paging.of(side, count)
        most = self._paging.size.bit_length()
        self._levels = most if levels is None else min(levels, most)
        textures, across = folder / "textures", self._paging.across
        index = index_channel(len(mesh.faces))
        self._index_bytes = CHANNELS[index].dtype.itemsize
        self._codes = TextureFiles(textures, "maps", "r8snorm", count, across)
        self._triangles = TextureFiles(textures, "triangles", index, 1, across)
        samples, self._bins = maps.settings.bins.samples, maps.bins.layers[WRINKLES]
        self._wrinkles = SetFiles(textures, WRINKLES, self._bins, samples, across)
        self._cushions: CushionFiles | None = None
        if maps.bins.cushion is not None:
            broad, ends = maps.count(CUSHIONS) + maps.count(PLACES), maps.settings.response.ends
            self._cushions = CushionFiles(textures, broad, len(mesh.faces), ends)
        self._residual: TextureFiles | None = None
        if maps.residual is not None:
            self._residual = TextureFiles(textures, "residual", "r16uint", 1, across)
        self.manifest: Manifest | None = None
        self._written: list[str] = []

    @property
    def files(self) -> list[Path]:
        """The files that were written so far."""
        textures = [name for one in self._textures() for name in one.files.values()]
        return [self._folder / n for n in (*self._written, *textures, *self._wrinkles.files)]

    @property
    def texture_bytes(self) -> int:
        """About how many bytes the textures will take."""
        maps = self._maps
        udims = len(maps.engine.assets.info(maps.asset).udims)
        layers = sum(map(maps.count, maps.names))
        share = sum(0.25**level for level in range(self._levels))
        texel = (layers + 2 * (self._bins + (self._residual is not None))) * share
        texel += self._index_bytes
        return int(udims * maps.settings.resolution**2 * texel)

    @property
    def host_bytes(self) -> int:
        """The most bytes that the arrays of the steps take at once: those of one UDIM, and the
        mesh."""
        maps, texels = self._maps, self._maps.settings.resolution**2
        share = sum(0.25**level for level in range(self._levels))
        plain = texels * sum(map(maps.count, maps.names))
        wrinkles, numbers = texels * maps.count(WRINKLES), 4 * texels * self._bins
        kept = 0 if maps.residual is None else sum(c.nbytes for c in maps.residual.codes.values())
        cushions = 0
        if self._cushions is not None:  # maps, owners and their numbers, lines
            cushions = (maps.count(CUSHIONS) + 1 + 12) * maps.cushion_side**2
            cushions += LINE_BYTES * maps.engine.assets.info(maps.asset).wrinkles
        arrays = max(
            2 * plain + wrinkles,  # when they become one array
            plain * (1 + share) + wrinkles,  # with pages and their levels
            2 * wrinkles,
            (wrinkles + numbers) * share + BESIDE,
            2 * cushions,
            3 * 4 * texels,  # triangles
            kept and 24 * texels,  # the residual, in double while it becomes other codes
        )
        page = 16 * self._paging.size**2  # in float32 for the levels, or as bytes of a file
        shapes = 0 if self._shapes is None else self._shapes.positions.nbytes
        faces = self._mesh.faces.nbytes
        # Beside what is given: with seams split, and as bytes of a file.
        mesh = 4 * (shapes + self._mesh.positions.nbytes + faces) + 16 * 8 * len(self._mesh.faces)
        return int(arrays + cushions + kept + page + mesh)

    def _textures(self) -> list[TextureFiles]:
        broad = [] if self._cushions is None else self._cushions.textures
        scanned = [] if self._residual is None else [self._residual]
        return [self._codes, self._triangles, *broad, *scanned]

    def steps(self) -> list[Step]:
        """The steps that write the package, in their order."""
        found: list[Step] = [self._begin, self._write_mesh]
        for udim in self._maps.engine.assets.info(self._maps.asset).udims:
            found += self._of_udim(udim)
        return [*found, self._finish]

    def _of_udim(self, udim: int) -> Iterator[Step]:
        made: list[UdimMaps] = []
        yield lambda: made.append(self._maps.empty(udim))
        for address in self._maps.settings.grid.addresses(udim, 0):
            yield partial(lambda at: self._maps.fill(made[0], at), address)
        yield lambda: self._write_textures(made.pop())

    def _begin(self) -> None:
        earlier = has_package(self._folder)
        (self._folder / "textures").mkdir(parents=True, exist_ok=True)
        for dialect in {*LANGUAGES, *COMPUTE, "materialx"}:
            (self._folder / "shaders" / dialect).mkdir(parents=True, exist_ok=True)
        if not earlier:
            return
        (self._folder / MANIFEST).unlink()
        for name in TEXTURES:  # those of the earlier package, which may have had other UDIMs
            for file in (self._folder / "textures").glob(f"{name}.1[0-9][0-9][0-9].ktx2"):
                file.unlink()

    def _write_mesh(self) -> None:
        mesh, metres = self._mesh, self._maps.metres
        self._write(MESH, write_morph_glb(mesh, self._shapes, "skin", metres))
        rest = rest_of(mesh.positions, mesh.faces, mesh.triangle_uv())
        self._write(REST, np.ascontiguousarray(rest, "<f8").tobytes())

    def _write_textures(self, read: UdimMaps) -> None:
        engine, asset, udim = self._maps.engine, self._maps.asset, read.udim
        self._codes.write(udim, self._taken(read, *self._maps.names))
        self._wrinkles.write(udim, self._taken(read, WRINKLES))
        triangles = engine.tiles.triangles(asset, udim)[None]
        self._triangles.write(udim, [self._paging.cut(triangles)])
        if self._cushions is not None:
            broad = np.concatenate([read.maps[CUSHIONS], read.maps[PLACES]])
            lines = engine.tiles.cushion_lines(asset, udim)
            self._cushions.write(udim, broad, read.maps[OWNERS], lines)
        if self._residual is not None:
            pages = self._paging.cut(self._maps.residual_codes(udim))
            self._residual.write(udim, pyramid(pages, self._levels))

    def _taken(self, read: UdimMaps, *names: str) -> list[NDArray[np.integer]]:
        """Maps as pages of every level; they are removed from `read`, to free their memory."""
        every = np.concatenate([read.maps.pop(name) for name in names])
        pages = self._paging.cut(every)
        del every  # where it was cut, before the coarser levels take their place
        return pyramid(pages, self._levels)

    def _finish(self) -> None:
        """Write everything that is text. The manifest comes last: it says that the package is
        whole."""
        broad = self._cushions
        cushions = None
        if broad is not None:
            of_samples = broad.maps.manifest_entry(), broad.owners.manifest_entry()
            cushions = (*of_samples, broad.lines.manifest_entry())
        written = PackageTextures(
            self._codes.manifest_entry(),
            self._wrinkles.manifest_entry(),
            self._triangles.manifest_entry(),
            cushions,
            None if self._residual is None else self._residual.manifest_entry(),
        )
        manifest = package_manifest(self._maps, self._mesh, self._shapes, written)
        texts = {name: text.encode() for name, text in shader_texts(manifest).items()}
        for name, data in (texts | materialx_texts(manifest)).items():
            self._write(name, data)
        self._write("stretch.py", runtime("stretch.py").encode())
        self._write("folds.py", runtime("folds.py").encode())
        for name in ("stretch.js", "folds.js"):
            self._write(name, rhytid_viewer.read(name))
        self._write_viewer()
        self._write(SCHEMA, _json(schema()))
        # Packages of grown skin are of version 2, which does not know it.
        absent = {"residual"} if manifest.residual is None else None
        self._write(MANIFEST, _json(manifest.model_dump(exclude=absent)))
        self.manifest = manifest

    def _write_viewer(self) -> None:
        """Write the page that shows the package, and its files."""
        for name, data in rhytid_viewer.laid_out().items():
            (self._folder / name).parent.mkdir(parents=True, exist_ok=True)
            self._write(name, data)

    def _write(self, name: str, data: bytes) -> None:
        with atomic_write(self._folder / name) as aside:
            write_file(aside, data)
        self._written.append(name)


def _json(value: object) -> bytes:
    return f"{json.dumps(value, indent=1)}\n".encode()
