"""Pores: Poisson-disk sampling that is even on the surface, whatever its UV layout."""

from __future__ import annotations

import numpy as np

from rhytid.synthesis.fields.fields import Fields
from rhytid.synthesis.pores.area_capacity import total_room
from rhytid.synthesis.pores.dart_selection import DartSelection
from rhytid.synthesis.pores.darts import Darts
from rhytid.synthesis.pores.even_skin import PACKING
from rhytid.synthesis.progress import Progress
from rhytid.synthesis.surface import Points, Surface
from rhytid.synthesis.workspace import Workspace

# Darts thrown per expected pore, in rounds. Where so many miss, another centre would have had a
# room of a few per cent of r².
DARTS = (2.0, 3.0, 4.0, 5.0, 6.0)
# Darts thrown at a time.
BATCH = 1 << 20


def scatter_pores(
    work: Workspace,
    surface: Surface,
    radius: float,
    seed: int,
    progress: Progress,
    fields: Fields | None = None,
) -> Points:
    """Pores of one sheet at least `radius` apart, so that hardly any more would fit.

    Times the mean of their spacing factors, where `fields` has such. Dart throwing, many at a time:
    those of a batch that no older pore is too close to are kept in the order of their priorities,
    as throwing them one by one would. Distances are Euclidean; surfaces that touch face to face
    (lips, eyelids) are kept apart by their normals. Pores come in spatial order. Which they are
    hangs on the place of each triangle in the map, its area and what is painted nearby; not on how
    many darts are thrown at a time.
    """
    fields = fields or Fields()
    with work.room() as room:
        darts = Darts(room, surface, fields, radius, seed, BATCH)
        a_room = PACKING / radius**2
        sieve = DartSelection(room, darts, radius, fields, a_room * darts.filled)
        every = sum(DARTS) * a_room * darts.room
        done = 0
        for turn, share in enumerate(DARTS):
            for thrown in darts.throws(turn, share * a_room):
                progress(min(done / every, 1.0), "pores")
                sieve.take(thrown)
                done += thrown.count
        return sieve.points()


def packed_radius(surface: Surface, fields: Fields, pores: float) -> float:
    """The radius at which about so many pores fit on the surface."""
    return float(np.sqrt(PACKING * total_room(surface, fields) / pores))
