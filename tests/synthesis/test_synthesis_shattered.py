"""Meshes whose UV lie in shreds: what is looked at over seams is bounded, and can be stopped."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.domain.graph import WrinkleGraph
from rhytid.domain.mesh import Mesh
from rhytid.errors import CancelledError
from rhytid.support import cancellation
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.seams import border_places
from rhytid.synthesis.seams.border_places import MOST_PAIRS, BorderPlaces
from synthesis import sheets

Indices = np.ndarray[Any, np.dtype[np.int32]]


def shreds(n: int) -> Mesh:
    """A sheet of n x n squares each triangle of which is an island of its own."""
    whole = sheets.sheet(n=n)
    count = len(whole.faces)
    across = int(np.ceil(np.sqrt(count)))
    place = np.stack(np.divmod(np.arange(count), across), axis=1)[:, None]
    uv = (np.array([[0.05, 0.05], [0.95, 0.05], [0.5, 0.95]]) + place) / across
    return Mesh(
        whole.positions, whole.faces, uv.reshape(-1, 2), np.arange(3 * count).reshape(-1, 3)
    )


def shuffled(mesh: Mesh, order: Callable[[Indices], Indices]) -> Mesh:
    return Mesh(mesh.positions, mesh.faces, mesh.uv, order(mesh.face_uv))


def by_rows(face_uv: Indices) -> Indices:
    return np.random.default_rng(1).permutation(face_uv)


def by_corners(face_uv: Indices) -> Indices:
    return np.random.default_rng(1).permutation(face_uv.ravel()).reshape(-1, 3)


MESHES = {
    "islands": lambda: shreds(10),
    "shuffled faces": lambda: shuffled(sheets.sheet(n=10), by_rows),
    "shuffled corners": lambda: shuffled(sheets.sheet(n=10), by_corners),
}


class Looks:
    """Counts pairs of elements and places of borders that are looked at."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.most = self.total = self.most_of_one = 0
        reached = BorderPlaces.reached

        def counted(places: BorderPlaces, *about: Any) -> Any:
            who, place = reached(places, *about)
            self.most, self.total = max(self.most, len(who)), self.total + len(who)
            self.most_of_one = max(self.most_of_one, int(np.bincount(who, minlength=1).max()))
            return who, place

        monkeypatch.setattr(BorderPlaces, "reached", counted)


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Looks:
    return Looks(monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("kind", MESHES)
def test_what_is_looked_at_is_bounded(device: Device, looks: Looks, kind: str) -> None:
    """At once, and in all: by some thousand places for each wrinkle."""
    graph = synthesize(MESHES[kind](), sheets.wanted(200), device).graph
    assert looks.most <= MOST_PAIRS
    assert looks.most_of_one <= border_places.MOST_PLACES
    assert 0 < looks.total < 20_000 * len(graph.edge_weight)


@pytest.mark.slow
def test_elements_are_followed_alike_however_many_at_once(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = shreds(4)
    whole = synthesize(mesh, sheets.wanted(150), device).graph
    monkeypatch.setattr(border_places, "MOST_PAIRS", 9000)
    monkeypatch.setattr("rhytid.synthesis.seams.seams.MOST_PAIRS", 9000)
    looks = Looks(monkeypatch)
    parts = synthesize(mesh, sheets.wanted(150), device).graph
    assert 0 < looks.most <= 9000
    assert_same(whole, parts)


def test_what_reaches_too_many_places_is_not_copied(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = shreds(4)
    whole = synthesize(mesh, sheets.wanted(150), device).graph
    monkeypatch.setattr(border_places, "MOST_PLACES", 0)
    none = synthesize(mesh, sheets.wanted(150), device).graph
    assert len(none.edge_weight) < len(whole.edge_weight)
    assert none.counts() == whole.counts()


@pytest.mark.parametrize("kind", MESHES)
def test_the_search_over_seams_stops_at_its_next_look(
    device: Device, looks: Looks, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    def stop() -> None:
        if looks.total:
            raise CancelledError("enough")

    with cancellation.scope(stop), pytest.raises(CancelledError):
        synthesize(MESHES[kind](), sheets.wanted(500), device)
    assert looks.total == looks.most


def assert_same(one: WrinkleGraph, other: WrinkleGraph) -> None:
    for name, values in vars(one).items():
        if isinstance(values, np.ndarray):
            np.testing.assert_array_equal(values, getattr(other, name), err_msg=name)
