"""A small frame to time, and peers that are made up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshes import deform
from pipeline.scenes import random_graph, settings_of, sheet
from rhytid.device.runtime import Device
from rhytid_lab.bench.frame import FrameBench

SIZE, WRINKLES = 256, 300


def small_bench(device: Device) -> FrameBench:
    """A deformed sheet with 300 wrinkles and 600 pores, ellipses, at 256² in tiles of 64²."""
    mesh = sheet()
    graph = random_graph(3, WRINKLES, half_width=(0.004, 0.02), length=(0.01, 0.1), metric=True)
    return FrameBench(device, mesh, graph, deform(mesh.positions, 2, 0.05), settings_of())


@dataclass
class Given:
    """A peer that gives what it was given."""

    found: NDArray[np.float32]
    released: bool = False

    def run(self) -> None:
        pass

    def result(self) -> NDArray[np.float32]:
        return self.found

    def release(self) -> None:
        self.released = True
