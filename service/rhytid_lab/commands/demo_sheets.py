"""The demo's contact sheets: the frames that stretch most, a sheet each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from rhytid.baking.frame_names import FramePlace
from rhytid.console import counted
from rhytid.domain.tiles import busiest_udim, triangles_inside, udim_origin
from rhytid.durable import whole
from rhytid_lab.commands.demo_session import Session
from rhytid_lab.sheets.contact import contact_sheet, relative_rms
from rhytid_lab.sheets.contact_rows import METHODS
from rhytid_lab.sheets.stretch_colours import Performance

SHEETS = 4


def key_frames(sizes: Sequence[float], most: int = SHEETS) -> list[int]:
    """Indices of at most `most` frames, the largest first, with a part of the animation between.

    Each takes an eighth of the animation to both sides with it, rounded down: of a few key poses
    none is dropped. Frames below a fifth of the largest have little to show.
    """
    apart = len(sizes) // 8
    shown = [i for i, size in enumerate(sizes) if size >= 0.2 * max(sizes) > 0] or [0]
    left = sorted(shown, key=lambda i: -sizes[i])
    chosen: list[int] = []
    for index in left:
        if all(abs(index - other) > apart for other in chosen) and len(chosen) < most:
            chosen.append(index)
    return chosen


def write_sheets(session: Session, unit_mm: float) -> list[dict[str, Any]]:
    """A sheet for each key frame, and what it shows in figures, the most stretched first."""
    indices = key_frames(session.sizes)
    udim = busiest_udim(session.face.mesh)
    figures = []
    for index in counted(indices, "sheets", "sheet"):
        frame = session.frames[index]
        maps = _maps(session, frame, udim)
        with session.watch.step("contact sheet"):
            name = f"contact_{frame.label}.png"
            performance = _performance(session, frame, udim)
            note = f"Frame {frame.name}, UDIM {udim}."
            sheet = contact_sheet(performance, maps, unit_mm=unit_mm, note=note)
            with whole(session.out / name) as aside:
                sheet.save(aside)
        rms = relative_rms(maps["binned"], maps["redraw"])
        figures.append(
            {
                "frame": frame.label,
                "abs_p90": session.sizes[index],
                "relative_rms": rms,
                "sheet": name,
            }
        )
    return figures


def _maps(session: Session, frame: FramePlace, udim: int) -> dict[str, NDArray[Any]]:
    maps: dict[str, NDArray[Any]] = {}
    for method in METHODS:
        with session.watch.step(f"{method}, as npy"):
            map = session.map(frame, udim, method)
        maps[method] = map.array
    return maps


def _performance(session: Session, frame: FramePlace, udim: int) -> Performance:
    mesh, stretch = session.face.mesh, session.client.stretch(session.asset, frame.label)
    inside = triangles_inside(mesh, udim)
    return Performance(
        neutral=mesh.positions,
        deformed=session.face.frames.read(frame),
        faces=mesh.faces[inside],
        triangle_uv=mesh.triangle_uv()[inside] - udim_origin(udim),
        axes=stretch.axes[inside],
        ratios=stretch.ratios[inside],
    )
