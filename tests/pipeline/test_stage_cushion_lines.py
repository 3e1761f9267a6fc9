"""What lines of the cushions answer to stretch by: copies as their originals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes import deform
from pipeline.scenes import Scene, random_graph, settings_of, sheet
from rhytid.pipeline.elements import LineSources
from rhytid.pipeline.line_stretches import LineStretches
from rhytid.pipeline.redraw import R_ALONE, wrinkle_responder

HALF = 40
OF_COPIES = np.concatenate([np.full(HALF, -1), np.arange(HALF)]).astype(np.int32)
SETTINGS = settings_of(shape={"cushion": 0.7})


class Lines(Scene):
    """Lines of which the second half are copies of the first, at places and angles of their own."""

    def __init__(self, device, copy_of):
        graph = replace(random_graph(5, 2 * HALF), edge_copy_of=copy_of)
        super().__init__(device, sheet(), graph, SETTINGS)
        self.found = self.elements()
        self.of = np.argsort(self.found.wrinkle_rows[:-1])

    def ends(self):
        """(M, 2) r at both ends of each line of the graph, after another frame was there."""
        device, lines = self.device, LineStretches.allocate(self.device, self.found)
        for seed in (7, 3):
            stretch = self.stretch(deform(self.mesh.positions, seed, 0.15))
            responder = wrinkle_responder(device, self.settings, stretch, R_ALONE)
            lines.fill(device, self.found, self.settings, responder)
        ends = device.read(lines.ends, (self.found.wrinkles + 1, 2), np.float32)
        assert not ends[-1].any()
        return ends[:-1][self.of]

    def sources(self):
        """(triangle, directions) of each line of the graph."""
        lines = LineSources.read(self.device, self.found)
        return lines.triangle[self.of], lines.directions[self.of]


@pytest.fixture(scope="module")
def lines(device):
    return Lines(device, OF_COPIES), Lines(device, None)


def test_copies_have_the_stretch_of_their_originals(lines):
    found, alone = (made.ends() for made in lines)
    np.testing.assert_array_equal(found[HALF:], found[:HALF])
    np.testing.assert_array_equal(found[:HALF], alone[:HALF])
    assert np.abs(alone[HALF:] - alone[:HALF]).mean() > 0.02


def test_what_packages_say_of_copies_is_of_their_originals(lines):
    (triangle, directions), (own, along) = (made.sources() for made in lines)
    np.testing.assert_array_equal(triangle[HALF:], triangle[:HALF])
    np.testing.assert_array_equal(directions[HALF:], directions[:HALF])
    np.testing.assert_array_equal(triangle[:HALF], own[:HALF])
    np.testing.assert_array_equal(directions[:HALF], along[:HALF])
    assert (own[HALF:] != own[:HALF]).mean() > 0.5
    assert np.abs(along[HALF:] - along[:HALF]).mean() > 0.2
