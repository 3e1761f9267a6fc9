"""Control maps from images: by name, then by the UDIM of each."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from rhytid.domain import painted_maps
from rhytid.errors import InputError, LimitError
from rhytid.formats.painted import read_controls


def png(code, side=4):
    stream = io.BytesIO()
    Image.fromarray(np.full((side, side), code, np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def test_images_are_told_apart_by_name_and_udim():
    files = {
        "density": [("a.1002.png", png(255)), ("a.1001.png", png(0))],
        "region_lip": [("lip.1001.png", png(51))],
    }
    found = read_controls(files, (1001, 1002))
    assert {name: list(maps) for name, maps in found.maps.items()} == {
        "density": [1001, 1002],
        "region_lip": [1001],
    }
    assert found.maps["density"][1002].min() == 255
    assert found.maps["region_lip"][1001].max() == 51
    assert read_controls({}, (1001,)) is None


def test_what_has_no_place_is_named():
    with pytest.raises(InputError, match=r"x\.png names no UDIM.*as in density\.1001\.png"):
        read_controls({"density": [("x.png", png(0))]}, (1001, 1002))
    with pytest.raises(InputError, match=r"b\.1001\.png and a\.1001\.png are both"):
        read_controls({"turn": [("a.1001.png", png(0)), ("b.1001.png", png(0))]}, (1001,))
    with pytest.raises(InputError, match=r"a\.exr: a damaged EXR image"):
        read_controls({"scale": [("a.exr", b"v/1\x01")]}, (1001,))


def test_the_limit_is_of_all_controls(monkeypatch):
    monkeypatch.setattr(painted_maps, "MOST_TEXELS", 31)
    files = {"density": [("a.png", png(0))], "turn": [("b.png", png(0))]}
    with pytest.raises(LimitError, match=r"b\.png: control .* 32 texels in all: at most 31"):
        read_controls(files, (1001,))
