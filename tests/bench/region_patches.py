"""Every region by itself, as a picture:

    python tests/bench/region_patches.py docs/images/regions.jpg [--device D]

20 mm of each, grown on a flat sheet in cm with the default settings and `graph.region`, without
expressions. Texels are 0.023 mm wide.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.domain.skin import REGIONS
from rhytid.engine.engine import open_device
from rhytid.engine.frames import NEUTRAL_FRAME
from rhytid.pictures.sheet import Panel, scale_bar, sheet
from rhytid.pictures.surface_patch import Frame, surface_patch
from rhytid.support.settings import ServiceSettings
from rhytid.synthesis.generate import synthesize
from rhytid_lab.bench.skin import Skin
from rhytid_lab.samples.grids import flat_sheet

# Centimetres: a side of the sheet, and of what is seen of it.
SIDE, SEEN = 2.4, 2.0
QUADS, TEXELS, PIXELS, ACROSS = 24, 1024, 420, 4
LIGHT = 30.0
CAPTION = (
    "20 mm of each region on a flat sheet, without expressions, all in one scale; light from the "
    f"upper left at {LIGHT:g}°."
)


def panel(device: Device, mesh: Mesh, region: str) -> Panel:
    """The middle of the sheet with the skin of a region."""
    sizes = {"resolution": TEXELS, "tile_size": TEXELS, "graph": {"region": region}}
    settings = AssetSettings.parse(sizes).for_synthesis()
    made = synthesize(mesh, settings.graph, device, unit=settings.length_unit)
    skin = Skin(device, mesh, made.graph, settings.resolved(made.spacing))
    view = Frame.at(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    patch = surface_patch(mesh.positions[mesh.faces], mesh.triangle_uv(), view, SEEN, PIXELS)
    picture = patch.picture(skin.map(NEUTRAL_FRAME, "neutral"), LIGHT)
    skin.release()
    return Panel(region.replace("_", " "), scale_bar(picture, 0.5 * PIXELS / SEEN, "5 mm"))


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--device")
    arguments = parser.parse_args()
    device, mesh = open_device(ServiceSettings(), arguments.device), flat_sheet(SIDE, QUADS)
    found = [panel(device, mesh, region) for region in REGIONS]
    rows = [found[start : start + ACROSS] for start in range(0, len(found), ACROSS)]
    sheet(rows, CAPTION).save(arguments.out, quality=88)


if __name__ == "__main__":
    main()
