"""Images that the tests write themselves, decoded in their own process."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest

from exr_images import exr, raw_exr
from rhytid.formats.exr_decoder import decode

RNG = np.random.default_rng(7)
NOISE = RNG.random((37, 53)).astype(np.float32)
SMOOTH = np.linspace(0, 1, 37 * 53, dtype=np.float32).reshape(37, 53).round(2)
PAINTED = np.hypot(*np.mgrid[-150:150, -150:150]).clip(90, 91).astype(np.float32) - 90
LOSSLESS = ["NO", "RLE", "ZIPS", "ZIP", "PIZ"]
DWA = ["DWAA", "DWAB"]


@pytest.fixture
def decoded(tmp_path):
    def of(data, shape):
        path = tmp_path / "x.exr"
        path.write_bytes(data)
        return decode(path, shape[1], shape[0])

    return of


def by(name):
    return {"compression": getattr(OpenEXR, f"{name}_COMPRESSION")}


def exact(texels):
    """Codes before they are rounded."""
    return texels.astype(np.float64) * 65535


@pytest.mark.parametrize("texels", [NOISE, SMOOTH, SMOOTH[:1, :1], SMOOTH[:16], SMOOTH[:, :1]])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("compression", LOSSLESS)
@pytest.mark.parametrize(
    "layout",
    [{}, {"lineOrder": OpenEXR.DECREASING_Y}, {"tiles": (16, 32)}, {"tiles": (64, 16)}],
)
def test_values_become_the_nearest_codes(decoded, texels, dtype, compression, layout):
    texels = texels.astype(dtype)
    wrong, codes = decoded(exr(texels, **by(compression), **layout), texels.shape)
    assert wrong is None
    np.testing.assert_array_equal(codes, np.round(exact(texels)).astype(np.uint16), strict=True)


def test_more_than_a_band_of_rows_is_read(decoded):
    texels = RNG.random((700, 3)).astype(np.float32)
    _, codes = decoded(exr(texels, **by("PIZ")), texels.shape)
    np.testing.assert_array_equal(codes, np.round(exact(texels)).astype(np.uint16), strict=True)


# Half floats keep 11 bits and PXR24 keeps 16 of a float, but all of a half.
@pytest.mark.parametrize(
    ("compression", "dtype", "most"),
    [
        ("PXR24", np.float16, 0.5),
        ("PXR24", np.float32, 1.5),
        ("B44", np.float16, 0.02 * 65535),
        ("B44A", np.float16, 0.02 * 65535),
        ("B44", np.float32, 0.5),
        ("DWAA", np.float16, 0.02 * 65535),
        ("DWAB", np.float32, 0.02 * 65535),
    ],
)
@pytest.mark.parametrize("layout", [{}, {"tiles": (64, 64)}])
def test_what_loses_is_near(decoded, compression, dtype, most, layout):
    ramp = np.linspace(0, 1, 300 * 300).reshape(300, 300).astype(dtype)
    wrong, codes = decoded(exr(ramp, **by(compression), **layout), ramp.shape)
    assert wrong is None
    assert np.abs(codes - exact(ramp)).max() <= most


@pytest.mark.parametrize("compression", DWA)
def test_white_of_a_compression_that_overshoots_is_white(decoded, compression, tmp_path):
    data = exr(PAINTED, **by(compression))
    wrong, codes = decoded(data, PAINTED.shape)
    file = OpenEXR.File(str(tmp_path / "x.exr"), separate_channels=True)
    assert file.channels()["Y"].pixels.max() > 1.005
    assert wrong is None
    assert codes.max() == 65535
    assert np.abs(codes - exact(PAINTED)).max() <= 0.02 * 65535


@pytest.mark.parametrize("value", [1.001, 1.1, -0.25, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("row", [0, 255, 256, 299])
def test_a_value_that_is_no_share_is_told_with_its_place(decoded, row, value):
    texels = np.full((300, 64), 0.5, np.float32)
    texels[row, 41], texels[299, 63] = value, 7
    wrong, _ = decoded(exr(texels), texels.shape)
    assert wrong == (41, row, str(np.float32(value)))


@pytest.mark.parametrize("compression", DWA)
@pytest.mark.parametrize("value", [1.1, -0.1])
def test_what_loses_is_refused_further_outside(decoded, compression, value):
    texels = np.full((300, 64), 0.5, np.float32)
    texels[256:, 32:] = value
    wrong, _ = decoded(exr(texels, **by(compression)), texels.shape)
    assert wrong is not None
    assert (wrong.column, wrong.row) == (32, 256)
    assert abs(float(wrong.value) - value) < 0.01


STEP = 0.5 / 65535


@pytest.mark.parametrize(
    ("value", "code"),
    [(0.0, 0), (-0.0, 0), (0.5, 32768), (1.0, 65535), (1 + 0.9 * STEP, 65535), (-0.9 * STEP, 0)],
)
def test_what_rounds_to_a_code_is_that_code(decoded, value, code):
    wrong, codes = decoded(exr(np.full((2, 2), value, np.float32)), (2, 2))
    assert wrong is None
    assert codes.tolist() == [[code] * 2] * 2


@pytest.mark.parametrize("compression", ["NO", "PXR24"])
@pytest.mark.parametrize("value", [1 + 2.2 * STEP, -2.2 * STEP])
def test_half_a_step_outside_is_refused_where_nothing_is_lost(decoded, compression, value):
    wrong, _ = decoded(exr(np.full((2, 2), value, np.float32), **by(compression)), (2, 2))
    assert wrong is not None
    assert (wrong.column, wrong.row) == (0, 0)
    assert abs(float(wrong.value) - value) < 0.5 * STEP


def test_other_attributes_change_nothing(decoded):
    odd = {"owner": ("string", "für".encode()), "comments": ("string", b"a" * 1000)}
    _, codes = decoded(raw_exr(**odd), (2, 2))
    assert codes.tolist() == [[0, 16384], [32768, 65535]]


def test_another_image_than_was_expected_is_refused(decoded):
    for data in (exr(SMOOTH[:2, :3]), exr(np.zeros((2, 2), np.uint32))):
        with pytest.raises(ValueError, match="not one channel of the size in the header"):
            decoded(data, (2, 2))
