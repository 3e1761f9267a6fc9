"""How much a build will be, as it is said before it begins."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np
import pytest

from rhytid.device.runtime import Device
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.mesh import Mesh
from rhytid.synthesis import build_size
from rhytid.synthesis.build_size import LESS, BuildSize, shares_of_time
from rhytid.synthesis.capacity import check_amount
from rhytid.synthesis.generate import synthesize
from rhytid.synthesis.seams import charts
from rhytid.synthesis.seams.charts import neighbours
from synthesis import sheets

MOST = 1 << 62


def larger(mesh: Mesh, factor: float) -> Mesh:
    return Mesh(mesh.positions * np.float32(factor), mesh.faces, mesh.uv, mesh.face_uv)


@pytest.mark.parametrize("mesh", [sheets.sheet(), sheets.tube()])
def test_as_many_wrinkles_are_made_as_were_said(device: Device, mesh: Mesh) -> None:
    settings = replace(sheets.wanted(1), wrinkles=None, spacing=0.02)
    wrinkles = check_amount(mesh, settings, None, MOST)
    made, size = synthesize(mesh, settings, device).graph, BuildSize.of(mesh, wrinkles)
    pores, drawn = made.counts()
    assert abs(size.wrinkles - drawn) < 0.15 * drawn
    assert abs(size.pores - pores) < 0.15 * pores


def test_what_the_size_is_found_by_is_found_once(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = []
    across = charts._across
    monkeypatch.setattr(charts, "_across", lambda mesh: found.append(1) or across(mesh))
    settings = AssetSettings.parse({"graph": {"wrinkles": 200}}).for_synthesis().graph
    mesh, before = sheets.sheet(), len(charts._found)
    BuildSize.of(mesh, 200)
    BuildSize.of(mesh, 200)
    synthesize(mesh, settings, device)
    assert len(found) == 1
    del mesh
    gc.collect()
    assert len(charts._found) <= before


def test_a_body_in_pores_of_a_face_is_told_to_be_long() -> None:
    """Three square metres at half a millimetre."""
    body = larger(sheets.sheet(), 180.0)  # cm
    graph = AssetSettings.parse({"unit": "cm"}).for_synthesis().graph
    size = BuildSize.of(body, check_amount(body, graph, None, MOST))
    assert 1.5e7 < size.wrinkles < 3e7
    assert 120 < size.seconds < 600
    assert 3.5e9 < size.nbytes < 8e9
    assert "million wrinkles" in str(size)
    assert "minutes on two cores" in str(size)
    assert LESS not in str(size)
    assert str(replace(size, seconds=2400.0)).endswith(LESS)


def test_seams_take_time_and_open_rims_do_not() -> None:
    whole, tube = (BuildSize.of(mesh, 10_000) for mesh in (sheets.sheet(), sheets.tube()))
    assert tube.seconds > 1.2 * whole.seconds
    for mesh, seams in ((sheets.sheet(), False), (sheets.tube(), True)):
        assert (build_size._measured(mesh, neighbours(mesh))[1] > 0.0) == seams


def test_what_is_done_once_takes_a_smaller_share_of_more_wrinkles() -> None:
    shares = {}
    for mesh, seams in ((sheets.sheet(), False), (sheets.tube(), True)):
        across = neighbours(mesh)
        for wrinkles in (10_000, 1_000_000):
            beginning, copying = shares_of_time(mesh, across, wrinkles)
            shares[seams, wrinkles] = beginning
            assert (copying > 0.0) == seams
            assert 0.0 < beginning + copying < 1.0
    assert shares[False, 10_000] > 0.9
    assert shares[False, 1_000_000] < 0.15
    assert shares[True, 10_000] < shares[False, 10_000]


@pytest.mark.parametrize(
    ("wrinkles", "seconds", "told"),
    [
        (12_345, 2.4, "about 12,000 wrinkles and 5,900 pores, 2 seconds on two cores, 1 GB"),
        (18_200_000, 2400.0, f"about 18 million wrinkles and 8.7 million pores, 40 minutes on "
         f"two cores, 1 GB; {LESS}"),
        (180_000_000, 7000.0, f"about 180 million wrinkles and 86 million pores, 2 hours on "
         f"two cores, 1 GB; {LESS}"),
    ],
)  # fmt: skip
def test_words(wrinkles: int, seconds: float, told: str) -> None:
    assert str(BuildSize(wrinkles, round(wrinkles / 2.1), seconds, 1e9)) == told
