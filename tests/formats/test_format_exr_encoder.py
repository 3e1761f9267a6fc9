"""EXR files that are written here are those of the OpenEXR library, but for their compressed
bytes."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rhytid.errors import QueryError
from rhytid.exports.textures import COMPRESSIONS
from rhytid.formats import exr_encoder
from rhytid.formats.exr import decode_exr
from rhytid.formats.exr_encoder import exr_body, renamed

FACTS = {"frame": "0007", "udim": 1001, "scale": 0.5, "a_name_of_more_than_thirty_one_letters": "x"}
RANDOM = np.random.default_rng(5)
SMOOTH = np.sin(np.arange(70 * 300).reshape(70, 300) / 900).astype(np.float32)


def written(texels: NDArray[np.float32], dtype: str = "float32", compression: str = "zip") -> bytes:
    body = exr_body(lambda start, stop: texels[start:stop], texels.shape[:2], dtype, compression)
    return b"".join(body.parts({**FACTS, "minimum": body.minimum, "maximum": body.maximum}))


def by_the_library(texels: NDArray[Any], compression: str, path: Path) -> dict[str, object]:
    """The header of a file that the library writes."""
    ends = {"minimum": float(texels.min()), "maximum": float(texels.max())}
    method = "NO" if compression == "none" else compression.upper()
    fixed = {
        "compression": getattr(OpenEXR, f"{method}_COMPRESSION"),
        "type": OpenEXR.scanlineimage,
    }
    OpenEXR.File({**FACTS, **ends, **fixed}, {"Y": texels}).write(str(path))
    return dict(OpenEXR.File(str(path), header_only=True).header())


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("dtype", ["float32", "float16"])
def test_files_have_the_texels_and_the_header_of_the_library(
    dtype: str, compression: str, tmp_path: Path
) -> None:
    texels, header = decode_exr(written(SMOOTH, dtype, compression))

    if compression == "dwaa":
        np.testing.assert_allclose(texels, SMOOTH, atol=0.02)
    else:
        np.testing.assert_array_equal(texels, SMOOTH.astype(dtype), strict=True)
    expected = by_the_library(SMOOTH.astype(dtype), compression, tmp_path / "library.exr")
    assert {k: str(v) for k, v in header.items()} == {k: str(v) for k, v in expected.items()}


@given(
    height=st.integers(1, 40),
    width=st.integers(1, 9),
    strip=st.integers(1, 200),
    noise=st.sampled_from([0.0, 1e-3, 1.0]),
    dtype=st.sampled_from(["float32", "float16"]),
    compression=st.sampled_from(["zip", "zips", "none"]),
)
def test_maps_of_any_size_are_read_back(
    height: int, width: int, strip: int, noise: float, dtype: str, compression: str
) -> None:
    texels = RANDOM.normal(0.1, noise, (height, width)).astype(np.float32)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exr_encoder, "_STRIP", strip)
        found, header = decode_exr(written(texels, dtype, compression))

    np.testing.assert_array_equal(found, texels.astype(dtype), strict=True)
    assert header["minimum"] == float(texels.astype(dtype).min())
    assert header["maximum"] == float(texels.astype(dtype).max())


@pytest.mark.filterwarnings("ignore:overflow encountered in cast")
@pytest.mark.parametrize("largest", [1e-7, 1.0, 65519.0, 65520.0, 1e30, np.inf, np.nan])
@pytest.mark.parametrize("sign", [1, -1])
def test_half_floats_are_those_of_numpy_whatever_a_map_holds(largest: float, sign: int) -> None:
    texels = RANDOM.normal(0.0, 3e-6, (64, 32)).astype(np.float32)
    texels[40, 7] = sign * largest
    data = written(texels, "float16", "none")

    blocks = np.frombuffer(data[-64 * (8 + 32 * 2) :], np.uint8).reshape(64, -1)
    assert blocks[:, 8:].tobytes() == texels.astype("<f2").tobytes()


def test_what_zip_cannot_shrink_is_stored_as_it_is() -> None:
    noise = RANDOM.integers(0, 2**32, (16, 64), np.uint32) & 0xBFFFFFFF  # no NaN
    data = written(noise.view(np.float32))

    assert data.endswith(noise.tobytes())
    assert len(written(SMOOTH.round(1))) < SMOOTH.nbytes / 2


def test_another_reader_reads_them(tmp_path: Path) -> None:
    image = importlib.import_module("OpenImageIO")
    for dtype, compression in (("float32", "zip"), ("float16", "zips"), ("float32", "none")):
        path = tmp_path / f"{compression}.exr"
        path.write_bytes(written(SMOOTH, dtype, compression))
        file = image.ImageInput.open(str(path))
        spec = file.spec()
        assert spec.get_string_attribute("compression") == compression
        assert spec.get_string_attribute("frame") == "0007"
        np.testing.assert_array_equal(file.read_image(image.FLOAT)[..., 0], SMOOTH.astype(dtype))


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("name", ["0007", "1", "a name of more letters"])
def test_a_renamed_file_differs_in_the_name_alone(name: str, compression: str) -> None:
    data = written(SMOOTH, compression=compression)

    texels, header = decode_exr(b"".join(renamed(data, "frame", name)))

    before, facts = decode_exr(data)
    np.testing.assert_array_equal(texels, before, strict=True)
    assert {k: str(v) for k, v in header.items()} == {
        **{k: str(v) for k, v in facts.items()},
        "frame": name,
    }


def test_a_file_without_the_attribute_is_not_renamed() -> None:
    with pytest.raises(KeyError):
        renamed(written(SMOOTH), "absent", "1")


def test_an_unknown_compression_is_an_error() -> None:
    with pytest.raises(QueryError, match="compression 'rar' is unknown"):
        written(SMOOTH, compression="rar")
