"""Other implementations, which rhytid is timed beside.

One module per implementation; each has CASES, from the name of a case to what prepares a run of
it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from typing import Protocol

from rhytid.domain.asset_settings import PRESETS
from rhytid_lab.bench.scene import Floats, Scene

# Texels per side from which on the precomputed maps are too large for a host that holds them twice.
_LARGEST_BINNED = 8192
# Cases in which wrinkles are drawn.
_OF_LINES = ("redraw", "neutral")
# By name: the package that it needs, and the cases that it does.
PEERS = {
    "opengl": ("moderngl", ("redraw", "neutral", "binned")),
    "numba": ("numba", ("redraw", "neutral", "binned")),
    "numpy": ("numpy", ("stretch", "redraw", "neutral", "binned")),
    "opencv": ("cv2", ("convolved",)),
}


def cases_of(name: str) -> tuple[str, ...]:
    """Return the cases that an implementation does."""
    return PEERS[name][1]


def runs_on_host(name: str) -> bool:
    """Whether an implementation runs on the processor, whatever device rhytid has."""
    return name != "opengl"


def prepare(name: str, case: str, scene: Scene) -> Run:
    """Return a run of a case of `cases_of(name)`; raises Unsupported with the reason."""
    package = PEERS[name][0]
    if find_spec(package) is None:
        raise Unsupported("not installed")
    if case == "binned":
        _check_maps(scene)
    elif case != "stretch":
        _check_flat(scene, case)
    found: Run = import_module(f"rhytid_lab.bench.peers.with_{name}").CASES[case](scene)
    return found


def _check_maps(scene: Scene) -> None:
    """Raise Unsupported for precomputed maps that the peers do not blend."""
    if scene.size > _LARGEST_BINNED:
        raise Unsupported(
            f"left out: over {_LARGEST_BINNED} texels per side its maps are too large"
        )
    bins = scene.settings.bins
    if bins != replace(PRESETS["paper"].bins, r_max=bins.r_max):
        raise Unsupported("left out: it blends the maps of the preset `paper` alone")


def _check_flat(scene: Scene, case: str) -> None:
    """Raise Unsupported for skin that the peers do not draw: that of graphs other than those of the
    preset `paper`."""
    lines, shape = scene.wrinkles, scene.settings.shape
    more = (lines.stiffness, lines.waves, lines.slopes, lines.partners, lines.shares, lines.cushion)
    if case in _OF_LINES and any(one is not None for one in more):
        raise Unsupported(
            "left out: it draws straight lines of one width alone; these bend, taper, or meet"
        )
    if shape.grain > 0.0 or shape.undulation > 0.0:
        raise Unsupported("left out: it draws no grain and no swells")


class Unsupported(Exception):
    """Raised where an implementation cannot be timed here; the message says why."""


class Run(Protocol):
    """One case of one implementation; all that stays from frame to frame is made already."""

    def run(self) -> None:
        """Run it once, to its end; the result stays where it was made."""
        ...

    def result(self) -> Floats:
        """The result of the last run, on the host, as of FrameBench.result."""
        ...

    def release(self) -> None:
        """Release everything."""
        ...


@dataclass
class HostRun:
    """A run of a function that leaves its result in the host's memory."""

    work: Callable[[], Floats]
    made: Floats | None = None

    def run(self) -> None:
        """Call the function."""
        self.made = self.work()

    def result(self) -> Floats:
        """Its result."""
        assert self.made is not None
        return self.made

    def release(self) -> None:
        """Forget its result."""
        self.made = None
