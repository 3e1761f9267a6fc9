"""A sheet of controls: of each a few patches of skin side by side, named, with their values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from rhytid.pictures.images import Picture
from rhytid.pictures.legends import INK, font
from rhytid.pictures.sheet import Panel, sheet

# Pixels of a patch's side, of the strip with its value, and between patches of a control.
PATCH, _STRIP, _BETWEEN = 220, 22, 4
_LABEL_SIZE = 14
# Controls beside each other.
ACROSS = 3


@dataclass(frozen=True, eq=False)
class LabelledPatch:
    """picture: (PATCH, PATCH, 3) uint8.  label: the value that it shows."""

    label: str
    picture: Picture


def control_sheet(shown: Mapping[str, Sequence[LabelledPatch]], caption: str) -> Image.Image:
    """The patches of each control in a panel of its name, ACROSS panels a row."""
    panels = [Panel(name, _beside(patches)) for name, patches in shown.items()]
    rows = [panels[start : start + ACROSS] for start in range(0, len(panels), ACROSS)]
    return sheet(rows, caption)


def _beside(patches: Sequence[LabelledPatch]) -> Picture:
    gap = np.full((PATCH + _STRIP, _BETWEEN, 3), 255, np.uint8)
    parts = [part for patch in patches for part in (gap, _labelled(patch))]
    return np.concatenate(parts[1:], axis=1)


def _labelled(patch: LabelledPatch) -> Picture:
    """The patch with its label below."""
    image = Image.new("RGB", (PATCH, PATCH + _STRIP), "white")
    image.paste(Image.fromarray(np.ascontiguousarray(patch.picture)), (0, 0))
    middle = (PATCH / 2, PATCH + _STRIP / 2)
    draw = ImageDraw.Draw(image)
    draw.text(middle, patch.label, fill=INK, font=font(_LABEL_SIZE), anchor="mm")
    return np.asarray(image)
