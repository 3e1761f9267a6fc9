"""Images find their UDIM by their names, or are refused by them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from rhytid.domain import painted_maps as domain
from rhytid.errors import InputError, LimitError
from rhytid.formats.painted import read_stiffness


def png(value, side=2):
    stream = io.BytesIO()
    Image.fromarray(np.full((side, side), value, np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def values(files, udims):
    return {u: int(m[0, 0]) for u, m in read_stiffness(files, udims).maps.items()}


NAMES = ["a.1002.png", "a_1002.PNG", "1002.png", "v2.tmp.1002.png", "maps/1002.png"]


@pytest.mark.parametrize("name", NAMES)
def test_the_number_before_the_extension_is_the_udim(name):
    assert values([(name, png(7))], (1001, 1002)) == {1002: 7}


def test_every_udim_has_its_own_and_may_have_none():
    files = [("a.1011.png", png(9)), ("a.1001.png", png(5))]
    assert values(files, (1001, 1002, 1011)) == {1001: 5, 1011: 9}


@pytest.mark.parametrize(
    "name", ["stiffness", "v.1001.d/a", "a.png", "a.11002.png", "face1002.png", "a.102.png"]
)
def test_a_lone_image_without_number_is_of_the_only_udim(name):
    assert values([(name, png(7))], (1012,)) == {1012: 7}
    with pytest.raises(InputError, match=f"{name} names no UDIM; the mesh has 1001, 1002"):
        values([(name, png(7))], (1001, 1002))
    with pytest.raises(InputError, match=f"{name} names no UDIM"):
        values([("a.1012.png", png(7)), (name, png(7))], (1012,))


def test_a_udim_twice_or_without_mesh_is_refused():
    with pytest.raises(InputError, match=r"b\.1001\.png and a\.1001\.png are both of UDIM 1001"):
        values([("a.1001.png", png(1)), ("b.1001.png", png(1))], (1001,))
    with pytest.raises(InputError, match=r"a\.1003\.png is of UDIM 1003, which has no mesh"):
        values([("a.1003.png", png(1))], (1001,))


def test_a_damaged_image_is_named():
    with pytest.raises(InputError, match=r"a\.1001\.png: not a PNG or OpenEXR image"):
        values([("a.1001.png", b"x")], (1001,))


def test_decoding_stops_at_the_limit(monkeypatch):
    monkeypatch.setattr(domain, "MOST_TEXELS", 150)
    files = [("a.1001.png", png(1, 10)), ("a.1002.png", png(1, 10)), ("a.1003.png", b"never read")]
    with pytest.raises(LimitError, match=r"a\.1002\.png: .* 200 texels in all: at most 150"):
        values(files, (1001, 1002, 1003))
