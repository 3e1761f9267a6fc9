"""Rendered frames beside each other, with words on them, and the film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

GAP = 6
WHITE = (255, 255, 255)


def row(paths: Sequence[Path], words: Sequence[str]) -> Image.Image:
    """Pictures of one size side by side, each with its words in the lower left."""
    images = [_labelled(path, word) for path, word in zip(paths, words, strict=True)]
    width, height = images[0].size
    sheet = Image.new("RGB", (len(images) * (width + GAP) - GAP, height), WHITE)
    for i, image in enumerate(images):
        sheet.paste(image, (i * (width + GAP), 0))
    return sheet


def stack(rows: Sequence[Image.Image]) -> Image.Image:
    """Rows of one size below each other."""
    width, height = rows[0].size
    sheet = Image.new("RGB", (width, len(rows) * (height + GAP) - GAP), WHITE)
    for i, image in enumerate(rows):
        sheet.paste(image, (0, i * (height + GAP)))
    return sheet


def film(frames: Sequence[Image.Image], path: Path, fps: float, quality: int) -> None:
    """A WebP that repeats."""
    first, *others = frames
    timing = {"duration": round(1000 / fps), "loop": 0}
    first.save(path, save_all=True, append_images=others, quality=quality, method=6, **timing)


def contact(frames: Sequence[Image.Image], columns: int, share: float) -> Image.Image:
    """All frames on one sheet, each made smaller, to look for what jumps."""
    width, height = (round(share * side) for side in frames[0].size)
    sheet = Image.new("RGB", (columns * width, -(-len(frames) // columns) * height), WHITE)
    for i, frame in enumerate(frames):
        small = frame.resize((width, height), Image.Resampling.LANCZOS)
        sheet.paste(small, (i % columns * width, i // columns * height))
    return sheet


def _labelled(path: Path, words: str) -> Image.Image:
    image = Image.open(path).convert("RGB")
    size = max(image.height // 30, 12)
    place = (size // 2, image.height - 3 * size // 2)
    font = ImageFont.load_default(size)
    draw = ImageDraw.Draw(image)
    draw.text(place, words, fill=WHITE, font=font, stroke_width=1, stroke_fill=(40, 40, 40))
    return image
