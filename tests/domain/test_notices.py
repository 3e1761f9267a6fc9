"""What is said of an asset that is no mistake."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from meshes import bumpy_grid
from rhytid.domain import notices
from rhytid.domain.asset_settings import MOST_WRINKLES, AssetSettings
from rhytid.domain.lengths import Lengths
from rhytid.domain.mesh import Mesh
from rhytid.domain.notices import (
    LARGE_WRINKLES,
    build_notice,
    grain_notice,
    preset_notice,
    spacing_of_count,
    texel_notice,
)
from rhytid.domain.uv_layout import usual_uv_length
from rhytid_lab.samples.face import procedural_face


def told(uv_length: float, **settings: Any) -> str:
    found = grain_notice(AssetSettings.parse(settings), uv_length)
    assert [notice.code for notice in found] in ([], ["grain-not-drawn"])
    return found[0].detail if found else ""


def test_grain_shorter_than_two_texels_is_told_with_what_would_draw_it() -> None:
    """0.2 mm on 20 cm of skin, UV 1 long: 0.098 mm a texel at 2048."""
    assert told(20.0, resolution=2048) == ""
    detail = told(21.0, resolution=2048)
    assert "waves are 0.2 mm long, and at 2048 x 2048 texels carry waves from 0.205 mm on" in detail
    assert "resolution 4096 draws it, so would shape.grain_size 0.0205" in detail
    assert told(21.0, resolution=2048, shape={"grain_size": 0.0206}) == ""
    assert "no resolution draws it" in told(1e3, resolution=2048)


@pytest.mark.parametrize(
    "settings", [{"shape": {"grain": 0}}, {"preset": "paper"}, {"unit": "ell"}]
)
def test_without_grain_and_before_its_size_is_known_nothing_is_told(
    settings: dict[str, Any],
) -> None:
    assert told(100.0, **settings) == ""


def test_the_face_at_half_the_usual_resolution_has_no_grain() -> None:
    length = usual_uv_length(procedural_face(16).mesh)
    assert told(length) == ""
    assert "resolution 4096 draws it" in told(length, resolution=1024)


def test_the_length_is_that_of_the_longest_direction() -> None:
    grid = bumpy_grid(10, seed=1)
    flat = grid.positions * np.array([3.0, 1.0, 0.0], np.float32)
    mesh = Mesh(flat, grid.faces, grid.uv, grid.face_uv)
    uv = mesh.triangle_uv()
    corners = mesh.positions[mesh.faces].astype(float)
    inverse = np.linalg.inv(np.swapaxes(uv[:, 1:] - uv[:, :1], 1, 2))
    steps = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2) @ inverse
    longest = np.linalg.svd(steps, compute_uv=False)[:, 0]
    area = np.linalg.norm(np.cross(*np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)), axis=1)
    shorter = area[longest < usual_uv_length(mesh) * (1 - 1e-9)].sum() / area.sum()
    longer = area[longest > usual_uv_length(mesh) * (1 + 1e-9)].sum() / area.sum()
    assert max(shorter, longer) <= 0.5


def test_a_number_of_wrinkles_says_which_lengths_follow() -> None:
    given = {"graph": {"wrinkles": 300, "age": 65}}
    settings = AssetSettings.parse(given).with_lengths(Lengths.of(0.25, 65))
    told = spacing_of_count(settings, 0.251, 300)
    assert told == (
        "300 wrinkles fix the spacing, and depths follow it: pores are 2.51 mm apart (usually 0.5 "
        "mm), furrows of strength 1 are 0.6 mm deep (usually 0.12 mm), grain 0.012 mm and "
        "undulation 0.108 mm rms"
    )
    other = AssetSettings.parse({**given, "unit": "ell"}).with_lengths(Lengths.of(0.25))
    assert (
        "pores are 0.251 ell apart, furrows of strength 1 are 0.0375 ell deep,"
        in spacing_of_count(other, 0.251, 300)
    )


def test_another_number_of_wrinkles_than_asked_for_is_said_with_the_reason() -> None:
    given = {"graph": {"wrinkles": 600, "density": 0.5}}
    settings = AssetSettings.parse(given).with_lengths(Lengths.of(0.25))
    assert spacing_of_count(settings, 0.251, 300).startswith("600 wrinkles fix the spacing")
    assert spacing_of_count(settings, 0.251, 263).startswith(
        "263 have grown, not 300: that many are for skin of density 0.5 everywhere, and regions of "
        "the face and what is painted have other densities; 600 wrinkles fix the spacing"
    )


@pytest.mark.parametrize(
    ("resolution", "uv_length", "would"),
    [
        (1024, 250.0, "a resolution of 2048 would do"),
        (2048, 1000.0, "a resolution of 8192 would do"),
        (4096, 5000.0, "no resolution would do: use UDIMs"),
        (2048, 250.0, None),
    ],
)
def test_fewer_than_four_texels_between_pores(
    resolution: int, uv_length: float, would: str | None
) -> None:
    settings = AssetSettings.parse({"unit": "mm", "resolution": resolution}).for_synthesis()
    found = texel_notice(settings, uv_length)
    assert [notice.code for notice in found] == ([] if would is None else ["few-texels"])
    if would is not None:
        assert found[0].detail.endswith(would)
        assert "pores are 0.5 mm apart" in found[0].detail
        assert f"longer side of texels is {uv_length / resolution:.3g} mm at" in found[0].detail


def test_spacing_that_came_out_goes_before_that_of_the_settings() -> None:
    settings = AssetSettings.parse({"unit": "mm", "resolution": 1024}).for_synthesis()
    assert texel_notice(settings, 250.0, spacing=1.0) == ()
    assert texel_notice(AssetSettings(), 250.0) == ()  # not known yet


@pytest.mark.parametrize(("wrinkles", "count"), [(LARGE_WRINKLES, 0), (18_000_000, 1)])
def test_a_large_build(wrinkles: int, count: int) -> None:
    found = build_notice(wrinkles)
    assert len(found) == count
    assert all("about 18 million wrinkles" in notice.detail for notice in found)
    assert not any("are refused" in notice.detail for notice in found)


def test_more_than_a_graph_holds_is_said_to_be_refused() -> None:
    (found,) = build_notice(MOST_WRINKLES + 1)
    assert found.detail.endswith("more than the 40 million that a graph holds are refused")


def test_notices_of_the_same_settings_are_worded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    worded, length = [], notices._length
    monkeypatch.setattr(notices, "_length", lambda *given: worded.append(1) or length(*given))
    settings = AssetSettings.parse({"resolution": 512})
    for _ in range(3):
        assert grain_notice(settings, 31.0)
        assert texel_notice(settings, 31.0, 0.05)
    assert len(worded) == 4


def test_a_preset_tells_what_else_it_changed() -> None:
    before = AssetSettings.parse({"response": {"folds": 0.5}, "shape": {"grain": 0.05}})
    sent = {"preset": "best", "shape": {"grain": 0.04}}
    (notice,) = preset_notice(before, before.changed(sent), sent)
    assert notice.code == "preset-set"
    assert "these too: response.folds is 1.0, was 0.5. To keep one" in notice.detail
    assert preset_notice(before, before.changed({"depth": 0.1}), {"depth": 0.1}) == ()


def test_a_preset_that_changes_nothing_else_is_not_told() -> None:
    usual, sent = AssetSettings(), {"preset": "paper", "bins": {"tilt": False}}
    assert preset_notice(usual, usual.changed({"preset": "best"}), {"preset": "best"}) == ()
    (notice,) = preset_notice(usual, usual.changed(sent), sent)
    assert "shape.cushion is 0.0, was 0.7" in notice.detail
    assert "bins.tilt" not in notice.detail
