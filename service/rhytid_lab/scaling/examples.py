"""The worked examples of docs/scaling.md: a film, and a studio's service."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rhytid_lab.bench.paper_times import PAPER_SECONDS, PAPER_SIZE, PAPER_WRINKLES
from rhytid_lab.scaling.capacity import Limits, Service, Shared, film, full
from rhytid_lab.scaling.constants import Constants
from rhytid_lab.scaling.figures import Run, read_frame, read_runs
from rhytid_lab.scaling.model import Cost, Head, Model

_MEASURED = Path(__file__).parent / "measured"
DEVICES = (10, 100, 1000, 10_000)
FILM = Head(PAPER_SIZE, PAPER_WRINKLES)
FILM_FRAMES, FILM_HEADS = 100_000, 12
# As many texels and wrinkles per texel as a sixteenth of the film's head.
STUDIO = Head(PAPER_SIZE // 4, PAPER_WRINKLES // 16)
# Requests per second of one process: an answer in 2.4 ms, of docs/reliability.md.
_ANSWERS = 1 / 2.4e-3
_CHUNK, _VERTICES = 10, 9409


def measured_runs() -> list[Run]:
    """The runs that the model is checked against."""
    return read_runs(_MEASURED / "runs.json")


def one_core() -> Model:
    """A device and a host of one core together, as measured: constants from the run of one process
    at 1024² by redraw, and from frames of two densities."""
    frames = [read_frame(_MEASURED / f"bench_{name}.json") for name in ("dense", "sparse")]
    least = min(run.size for run in measured_runs())
    runs = [run for run in measured_runs() if (run.size, run.workers) == (least, 1)]
    return Model(replace(Constants.of(frames, runs, shared=True), device="one core of the EPYC"))


def paper_device() -> Model:
    """A GPU that draws in the times of the paper (section 3, an RTX 3090), beside the host that was
    measured here. Its times go by texels alone, at the paper's density of wrinkles."""
    known = one_core().constants
    texels = PAPER_SIZE**2
    return Model(
        replace(
            known,
            device="RTX 3090 of the paper",
            redraw=(PAPER_SECONDS["redraw"] / texels, 0.0),
            precompute=(PAPER_SECONDS["precompute"] / texels, 0.0),
            binned=PAPER_SECONDS["binned"] / texels,
        )
    )


def film_cost(model: Model, method: str, devices: int, processes: int) -> Cost:
    """The whole film on so many devices, with a store of `Limits`."""
    return model.job(
        FILM,
        method,
        FILM_FRAMES,
        heads=FILM_HEADS,
        devices=devices,
        processes=processes,
        store=Limits().store_write,
    )


def film_shared(model: Model, method: str, processes: int) -> list[Shared]:
    """What the film's devices share."""
    return film(model, FILM, method, processes, _CHUNK, _VERTICES, Limits())


def studio_shared(misses: float) -> list[Shared]:
    """What the devices of a service share, each drawing half of its time at most.

    misses: share of the requests that load a head.
    """
    service = Service(STUDIO, "binned", 512, 0.5, _ANSWERS, misses)
    return service.shared(paper_device(), Limits())


def breaking(shared: Sequence[Shared]) -> list[str]:
    """By DEVICES, what is used up, in the order in which it was, and how many times over."""
    return [
        "; ".join(f"{one.name} ×{one.used(devices):,.3g}" for one in full(shared, devices)) or "–"
        for devices in DEVICES
    ]
