"""Folds of the mesh itself, and the log stretch that they leave to lines. Kernel: folding.cl.

Lines answer to the log stretch of the triangles. Skin that is pressed hard folds as a sheet, too,
crest beside valley, and a mesh shows such folds itself: level ones where brows are raised, the one
beside the nose in a smile. Lines that take all of the compression show it a second time.

What curvature says of it. A chord is shorter than its arc by (κL)²/24 of it, and a mesh measures
chords: for its folds that is about a hundredth, too little to count. The face of a sheet is longer
than its middle by tκ on a crest, and shorter by as much in a valley: that sums to nothing over a
fold, whatever the thickness t. What counts is that a sheet which has folded is relieved. The
compression that is left to its face falls, and on the crest as in the valley, for it passes along
the sheet. How far it falls, no curvature of a mesh can tell. So the rule has the form that follows,
little for weak bends and most of it for steep folds, and its numbers are by eye, on one real face.

The rule. Of each triangle b = ℓ Σ cᵢ (κ'ᵢ − κᵢ) over both axes of stretch: c the log compression, 0
where it is stretched, κ' and κ the curvatures along the axis in the frame and in the neutral, ℓ =
100 mm. T is the variance of b over about a fold around each vertex: a mean of b is another form of
the face, as a cheek that bulges, and no fold. Of T what is above 0.5, t, is a fold: they take the
share 0.9 (1 − (1 + t)^(−1/4)) of each compression, and leave stretch as it is.

So lines keep a tenth at least. The power is a quarter because of what moves: c and κ' − κ both grow
with an expression, so that T grows with its fourth power, and what is left of c grows with it
nearly all the way, ever more slowly. A share that grows faster has lines that go deep and fade
again on the way to an expression, which is a flash in motion, though no still shows it. What moves
rigidly has no folds. The share is continuous in the frame and over the surface; it hangs on space
alone, not on UV, and on what is near. Curvature is that of the normals of the vertices
(Rusinkiewicz 2004), which see a third of that of a fold three edges long. Finer meshes are smoothed
to see no more, as far as `_MOST_ROUNDS` reaches: to edges of 1.4 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from rhytid.device.buffer import Buffer, BufferGroup
from rhytid.device.runtime import Device
from rhytid.domain.lengths import millimetres
from rhytid.domain.mesh import Mesh
from rhytid.pipeline.nearby import Numbers, Wanted, listed, united
from rhytid.pipeline.uv_vertices import triangles_around

# ℓ: where the variance of b is 15 above what is no fold, folds take half of what they can.
_LENGTH_MM = 100.0
# A millimetre where the unit is not known: its share of the root of the area, on a face.
_MILLIMETRE_OF_ROOT = 0.0034
# Of a compression: what folds take of it; and of T, the variance of b, what is no fold.
_MOST, _LEAST = 0.9, 0.5
# Of ℓ (κ' − κ): rims of lips and lids are bent without measure.
_MOST_BEND = 45.0
# Median edge of the real face on which the numbers were found, and its rounds of smoothing.
_EDGE_MM, _ROUNDS, _MOST_ROUNDS = 2.8, 2, 8


@dataclass(frozen=True)
class FoldRule:
    """The numbers by which folds of a mesh are measured.

    length: ℓ, mesh units.  most: of a compression, what folds take.  least: of the variance of b,
    what is no fold.  most_bend: of ℓ (κ' − κ).
    rounds, normal_rounds: of the means of b and b², and of normals, over the triangles of a vertex.
    """

    length: float
    most: float
    least: float
    most_bend: float
    rounds: int
    normal_rounds: int

    @classmethod
    def of(cls, mesh: Mesh, unit: str) -> FoldRule:
        """The rule for a mesh: rounds are more where edges are shorter than those of the face on
        which the numbers were found. Where the unit is not known the mesh is taken for a face."""
        millimetre, lengths = _millimetre(mesh, unit), np.linalg.norm(_edges(mesh), axis=-1)
        edge = float(np.median(lengths[lengths > 0.0]))  # corners may coincide
        finer = float(np.clip(_EDGE_MM * millimetre / edge, 0.0, 100.0)) ** 2
        rounds = int(np.clip(round(_ROUNDS * finer), 1, _MOST_ROUNDS))
        of_normals = int(np.clip(round((finer - 1.0) * 4 / 3), 0, _MOST_ROUNDS // 2))
        return cls(_LENGTH_MM * millimetre, _MOST, _LEAST, _MOST_BEND, rounds, of_normals)


@dataclass(frozen=True)
class Places:
    """The places of a mesh: its vertices, those at one place in the neutral once.

    of_vertex (V,), corners (F, 3): places.  offsets (W + 1,), members, shares: the triangles with
    area around each place, and their shares of the area, which sum to 1.
    """

    of_vertex: NDArray[np.int32]
    corners: NDArray[np.int32]
    offsets: NDArray[np.int32]
    members: NDArray[np.int32]
    shares: NDArray[np.float32]

    @classmethod
    def of(cls, mesh: Mesh) -> Places:
        """The places of a mesh."""
        _, place = np.unique(mesh.positions + 0.0, axis=0, return_inverse=True)  # -0 is 0
        place = place.reshape(-1)
        corners, usable = place[mesh.faces], mesh.usable_triangles()
        around = triangles_around(corners, usable, _relative_areas(mesh), int(place.max()) + 1)
        return cls(place.astype(np.int32), corners.astype(np.int32), *around)


@dataclass(frozen=True)
class Beside:
    """How places of a mesh are smoothed in one round.

    offsets (W + 1,), places, shares: those beside each place, and what they have of its mean; a
    third is that of the place itself.
    """

    offsets: NDArray[np.int32]
    places: NDArray[np.int32]
    shares: NDArray[np.float32]

    @classmethod
    def of(cls, places: Places) -> Beside:
        """Means over the triangles of each place, of the means of their corners."""
        corners, count = places.corners, len(places.offsets) - 1
        around = scipy.sparse.csr_array(
            (places.shares.astype(np.float64), places.members, places.offsets),
            shape=(count, len(corners)),
        )
        thirds, ends = np.full(corners.size, 1.0 / 3.0), 3 * np.arange(len(corners) + 1)
        means = scipy.sparse.csr_array(
            (thirds, corners.reshape(-1), ends), shape=(len(corners), count)
        )
        found = around @ means
        found.sort_indices()
        own = np.repeat(np.arange(count), np.diff(found.indptr))
        others = found.indices != own
        number = np.bincount(own[others], minlength=count)
        return cls(
            np.concatenate([[0], np.cumsum(number)]).astype(np.int32),
            found.indices[others].astype(np.int32),
            found.data[others].astype(np.float32),
        )


@dataclass(frozen=True)
class NearbyFolds(BufferGroup):
    """What is found to know what folds take of some triangles.

    moments: places in each round of means, the last round first.  bent: triangles.  normals:
    places, as `moments`.
    """

    moments: tuple[Wanted, ...]
    bent: Wanted
    normals: tuple[Wanted, ...]

    @property
    def _buffers(self) -> tuple[Wanted, ...]:
        return *self.moments, self.bent, *self.normals


class Folding:
    """The folds of a mesh, ready to be measured in any frame.

    faces: of the mesh, and rest: the rest shapes of its triangles (`Rest`), on the device; they
    stay the caller's.  unit: of the mesh.
    """

    def __init__(self, device: Device, mesh: Mesh, faces: Buffer, rest: Buffer, unit: str) -> None:
        self._places = places = Places.of(mesh)
        self._device, self._faces, self._rest = device, faces, rest
        self._triangles, self._vertices = len(mesh.faces), len(mesh.positions)
        self._count = len(places.offsets) - 1
        self._rule = FoldRule.of(mesh, unit)
        self._of_vertex, self._corners = (
            device.upload(places.of_vertex),
            device.upload(places.corners),
        )
        self._around = _uploaded(device, places.offsets, places.members, places.shares)
        self._listed: Beside | None = None
        self._beside: tuple[Buffer, ...] = ()
        if self._rule.rounds > 1 or self._rule.normal_rounds:
            self._listed = beside = Beside.of(places)
            self._beside = _uploaded(device, beside.offsets, beside.places, beside.shares)
        self._forms = self._neutral_forms(mesh)

    def nearby(self, triangles: Numbers) -> NearbyFolds:
        """What is found for the shares of some triangles."""
        corners = self._places.corners
        moments = self._round_by_round(corners[triangles], self._rule.rounds - 1)
        bent = united([listed(self._places.offsets, self._places.members, moments[-1])])
        normals = self._round_by_round(corners[bent], self._rule.normal_rounds)
        upload = partial(Wanted.upload, self._device)
        of_places = (tuple(map(upload, rounds)) for rounds in (moments, normals))
        return NearbyFolds(next(of_places), upload(bent), next(of_places))

    def _round_by_round(self, places: Numbers, rounds: int) -> list[Numbers]:
        """Places, and all from which they are smoothed in one round, in two, and so on."""
        found = [united([places.reshape(-1)])]
        for _ in range(rounds):
            assert self._listed is not None
            beside = listed(self._listed.offsets, self._listed.places, found[-1])
            found.append(united([found[-1], beside]))
        return found

    def take(
        self, frame: Buffer, amount: float, logs: Buffer, tension: Buffer | None, taken: Buffer,
        triangles: Wanted, near: NearbyFolds | None,
    ) -> None:  # fmt: skip
        """The share of its compression that folds take of each triangle in a frame, as `taken`,
        (F + 1,). It is taken of `logs` in place, and of the tension of vertices.

        frame: positions (V, 3).  amount: 0 to 1, factor of the share.  triangles: of which it is
        wanted, and nothing was taken yet, the last of them none.  near: what is found for them;
        None: all.
        """
        moments = self._moments(frame, near or self._all)
        most, least = np.float32(amount * self._rule.most), np.float32(self._rule.least)
        self._launch(
            "take_shares", triangles,
            self._corners, moments, np.int32(self._triangles), most, least, logs, taken,
        )  # fmt: skip
        if tension is not None:
            self._device.launch(
                "folding", "take_tension", (self._vertices,),
                self._of_vertex, moments, most, least, tension,
            )  # fmt: skip
        moments.release()

    def release(self) -> None:
        """Give the memory back."""
        owned = (self._of_vertex, self._corners, self._forms)
        for buffer in (*owned, *self._around, *self._beside):
            buffer.release()

    @property
    def _all(self) -> NearbyFolds:
        triangles, places = Wanted(self._triangles), Wanted(self._count)
        rounds, of_normals = self._rule.rounds, self._rule.normal_rounds + 1
        return NearbyFolds((places,) * rounds, triangles, (places,) * of_normals)

    def _neutral_forms(self, mesh: Mesh) -> Buffer:
        frame = self._device.upload(mesh.positions)
        normals, forms = self._normals(frame, self._all), self._floats(4 * self._triangles)
        self._device.launch(
            "folding", "neutral_forms", (self._triangles,),
            *self._surface(frame, normals), np.float32(self._rule.length), forms,
        )  # fmt: skip
        self._device.finish()
        frame.release()
        normals.release()
        return forms

    def _moments(self, frame: Buffer, wanted: NearbyFolds) -> Buffer:
        """The means of b and b² of places; the caller's."""
        bends, found = self._bends(frame, wanted), self._floats(2 * self._count)
        self._launch("gathered", wanted.moments[-1], *self._around, bends, found)
        bends.release()
        return self._smoothed("smoothed", found, 2, wanted.moments)

    def _bends(self, frame: Buffer, wanted: NearbyFolds) -> Buffer:
        """b and b² of triangles; the caller's."""
        normals, moments = self._normals(frame, wanted), self._floats(2 * self._triangles)
        self._launch(
            "bends", wanted.bent, *self._surface(frame, normals), self._forms,
            np.float32(self._rule.length), np.float32(self._rule.most_bend), moments,
        )  # fmt: skip
        normals.release()
        return moments

    def _surface(self, frame: Buffer, normals: Buffer) -> tuple[Buffer, ...]:
        return frame, self._faces, self._corners, self._rest, normals

    def _normals(self, frame: Buffer, wanted: NearbyFolds) -> Buffer:
        normals, (offsets, members, _) = self._floats(4 * self._count), self._around
        self._launch(
            "place_normals", wanted.normals[-1], frame, self._faces, offsets, members,
            np.float32(1.0 / self._rule.length), normals,
        )  # fmt: skip
        return self._smoothed("smoothed_normals", normals, 4, wanted.normals)

    def _smoothed(
        self, kernel: str, values: Buffer, width: int, wanted: tuple[Wanted, ...]
    ) -> Buffer:
        """Values of places after all rounds but the first; takes these."""
        for places in reversed(wanted[:-1]):
            found = self._floats(width * self._count)
            self._launch(kernel, places, *self._beside, values, found)
            values.release()
            values = found
        return values

    def _floats(self, count: int) -> Buffer:
        return self._device.empty(count, np.float32)

    def _launch(self, kernel: str, wanted: Wanted, *arguments: object) -> None:
        self._device.launch("folding", kernel, (wanted.items,), wanted.numbers, *arguments)


def _uploaded(device: Device, *arrays: NDArray[Any]) -> tuple[Buffer, ...]:
    return tuple(device.upload(array) for array in arrays)


def _millimetre(mesh: Mesh, unit: str) -> float:
    """In mesh units."""
    length = millimetres(unit)
    if length is not None:
        return 1.0 / length
    longest = np.linalg.norm(_edges(mesh), axis=-1).max()
    return float(_MILLIMETRE_OF_ROOT * longest * np.sqrt(0.5 * _relative_areas(mesh).sum()))


def _relative_areas(mesh: Mesh) -> NDArray[np.float64]:
    """(F,) twice the areas, in squares of the longest edge."""
    edges = _edges(mesh)
    edges /= np.linalg.norm(edges, axis=-1).max()
    areas: NDArray[np.float64] = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return areas


def _edges(mesh: Mesh) -> NDArray[np.float64]:
    """(F, 3, 3) the edges of each triangle, around it."""
    corners = mesh.positions[mesh.faces].astype(np.float64)
    return np.roll(corners, -1, axis=1) - corners
