"""Files of shine of host applications, read by another reader than wrote them."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rhytid.formats.png import read_texts
from rhytid_client import png
from rhytid_client.hosts import baking

MOMENTS = np.random.default_rng(2).uniform(0.01, 0.1, (8, 8, 5)).astype(np.float32)


@pytest.mark.parametrize("quick", [False, True])
def test_a_file_says_what_roughness_it_is_of(tmp_path: Path, quick: bool) -> None:
    file = tmp_path / "shine.png"
    file.write_bytes(baking.shine(MOMENTS, 0.3, quick=quick))
    assert read_texts(file.read_bytes(), file.name)["base_roughness"] == "0.3"
    assert baking.roughness_of(file) == 0.3


def test_a_file_that_does_not_say_it_is_of_none(tmp_path: Path) -> None:
    file = tmp_path / "shine.png"
    assert baking.roughness_of(file) is None
    for data in (b"", b"no PNG", png.rgb16(np.zeros((2, 2, 3), np.uint16))):
        file.write_bytes(data)
        assert baking.roughness_of(file) is None
    file.write_bytes(png.rgb16(np.zeros((2, 2, 3), np.uint16), {"base_roughness": "rough"}))
    assert baking.roughness_of(file) is None


def test_quick_files_have_the_same_pixels() -> None:
    codes = [
        np.asarray(Image.open(BytesIO(baking.shine(MOMENTS, 0.3, quick=quick))))
        for quick in (False, True)
    ]
    assert np.array_equal(*codes)
