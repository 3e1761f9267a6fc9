"""Skin at rest, stretched and compressed, by both methods, as a picture:

    python tests/bench/stretched_rows.py docs/images/stretched.jpg [--device D]

10 mm of a cheek and of a forehead, grown on a flat sheet with the default settings, which is
stretched evenly: 1.3 times across and 0.85 times along, and 0.7 times across. Each is shaded as it
lies on the stretched sheet, lit from the upper left at 45° and at 15°. Texels are 0.04 mm wide at
rest, as on a face at 8192².
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.engine.engine import open_device
from rhytid.engine.frames import NEUTRAL_FRAME, Frame
from rhytid.pictures.sheet import Panel, scale_bar, sheet
from rhytid.pictures.surface_patch import Frame as View
from rhytid.pictures.surface_patch import surface_patch
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.generate import synthesize
from rhytid_lab.bench.skin import Skin
from rhytid_lab.contact_sheets import GRAZING, STEEP
from rhytid_lab.samples.grids import flat_sheet

REGIONS = ("cheek", "forehead")
STRETCHES = ((1.3, 0.85), (0.7, 1.0))
# Centimetres: a side of the sheet, and of what is seen of it.
SIDE, SEEN = 2.0, 1.0
QUADS, TEXELS, PIXELS = 16, 512, 340
CAPTION = (
    "10 mm of skin on a flat sheet, at rest and stretched evenly: (across, along) in brackets. "
    "Each region under light from the upper left at 45 and at 15 degrees, all in one scale."
)


def skin_of(device: Device, mesh: Mesh, region: str) -> Skin:
    """Grown on the sheet; maps for the fast method as `bake` calibrates them for STRETCHES."""
    sizes = {"resolution": TEXELS, "tile_size": TEXELS, "graph": {"region": region}}
    settings = AssetSettings.parse(sizes).for_synthesis()
    made = synthesize(mesh, settings.graph, device)
    reach = float(np.abs(np.log(STRETCHES)).max())
    return Skin(device, mesh, made.graph, settings.resolved(made.spacing).with_r_max(reach))


def panels(mesh: Mesh, skin: Skin, region: str, light: float) -> list[Panel]:
    """At rest, then by both methods under each of STRETCHES."""
    title = f"{region}, light at {light:g}°: rest"
    found = [panel(mesh, skin, (1.0, 1.0), "neutral", title, light)]
    for across, along in STRETCHES:
        for method in ("redraw", "binned"):
            title = f"{method} ({across:g}, {along:g})"
            found.append(panel(mesh, skin, (across, along), method, title, light))
    return found


def panel(
    mesh: Mesh, skin: Skin, stretch: tuple[float, float], method: str, title: str, light: float
) -> Panel:
    """The middle of the stretched sheet."""
    moved = (mesh.positions * np.array([*stretch, 1.0])).astype(np.float32)
    frame = NEUTRAL_FRAME if method == "neutral" else Frame.of(moved)
    view = View.at(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    patch = surface_patch(moved[mesh.faces], mesh.triangle_uv(), view, SEEN, PIXELS)
    picture = patch.picture(skin.map(frame, method), light)
    return Panel(title, scale_bar(picture, 0.2 * PIXELS / SEEN, "2 mm"))


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--device")
    arguments = parser.parse_args()
    device, mesh = open_device(ServiceSettings(), arguments.device), flat_sheet(SIDE, QUADS)
    rows = []
    for region in REGIONS:
        skin = skin_of(device, mesh, region)
        rows += [panels(mesh, skin, region, light) for light in (STEEP, GRAZING)]
        skin.release()
    sheet(rows, CAPTION).save(arguments.out, quality=88)


if __name__ == "__main__":
    main()
