"""Files of scanned displacement: what is read, exactly, and what is refused, by name and place."""

from __future__ import annotations

import io
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from PIL import Image

from exr_images import channels, exr, exr_file, exr_of, raw_exr, window
from rhytid.errors import InputError, LimitError
from rhytid.formats import exr as exr_format
from rhytid.formats import scan_decoder, scans
from rhytid.formats.limits import MOST_SCAN_SIDE
from rhytid.formats.png import encode_png
from rhytid.formats.scan_headers import read_header
from rhytid.formats.scans import read_scan, read_scan_map, scan_udims

RNG = np.random.default_rng(30)
SIDE = 96
BYTES = RNG.integers(0, 256, (SIDE, 64), np.uint8)
SHORTS = RNG.integers(0, 65536, (SIDE, 64), np.uint16)
FLOATS = RNG.normal(0, 1, (SIDE, 64)).astype(np.float32)
HALVES = FLOATS.astype(np.float16)


def smooth(passes: int, seed: int) -> NDArray[np.float32]:
    """Noise whose waves are about `passes` texels long, rms 0.2 around 0.5."""
    row, column = np.meshgrid(*[np.fft.fftfreq(128)] * 2, indexing="ij")
    keep = np.exp(-((np.hypot(row, column) * passes) ** 2))
    noise = np.random.default_rng(seed).normal(0, 1, (128, 128))
    found = np.real(np.fft.ifft2(np.fft.fft2(noise) * keep))
    return (0.5 + 0.1 * found / found.std()).clip(0, 1).astype(np.float32)


BANDS = np.stack([smooth(40, 1), smooth(12, 2), smooth(3, 3)], axis=2)
ALIKE = np.stack([smooth(6, 4), smooth(6, 5), smooth(6, 6)], axis=2)
PHOTO = smooth(9, 7)[..., None] * np.array([1.0, 0.7, 0.6], np.float32) + 0.02 * (BANDS - 0.5)


def saved(texels: NDArray[Any], format: str, **options: Any) -> bytes:
    return image(Image.fromarray(texels), format, **options)


def image(picture: Image.Image, format: str, **options: Any) -> bytes:
    out = io.BytesIO()
    picture.save(out, format, **options)
    return out.getvalue()


def tiff_of(texels: NDArray[Any], kind: str, tmp_path: Path, compression: str = "none") -> bytes:
    """A TIFF that Pillow does not write."""
    oiio = pytest.importorskip("OpenImageIO")
    height, width, count = texels.shape
    spec = oiio.ImageSpec(width, height, count, kind)
    spec["compression"], spec["tiff:half"] = compression, 1
    out = oiio.ImageOutput.create(str(tmp_path / "x.tif"))
    assert out.open(str(tmp_path / "x.tif"), spec)
    assert out.write_image(texels)
    out.close()
    return (tmp_path / "x.tif").read_bytes()


def read(data: bytes, name: str = "face.1001.map") -> tuple[NDArray[Any], ...]:
    return read_scan_map(data, name, 1001).channels


def codes(texels: NDArray[Any]) -> NDArray[np.uint16]:
    return np.rint(texels * 65535).astype(np.uint16)


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize(
    ("data", "wanted"),
    [
        (saved(BYTES, "PNG"), BYTES),
        (saved(SHORTS, "PNG"), SHORTS),
        (saved(BYTES, "TIFF"), BYTES),
        (saved(BYTES, "TIFF", compression="tiff_lzw"), BYTES),
        (saved(SHORTS, "TIFF", compression="tiff_adobe_deflate"), SHORTS),
        (saved(SHORTS, "TIFF", big_tiff=True), SHORTS),
        (saved(SHORTS, "TIFF", tiffinfo={274: 1}), SHORTS),
        (saved(SHORTS.astype(">u2"), "TIFF"), SHORTS),
        (saved(FLOATS, "TIFF"), FLOATS),
        (exr(FLOATS), FLOATS),
        (exr(HALVES, channel="height"), HALVES),
        (exr(FLOATS, tiles=(32, 16), compression=OpenEXR.PIZ_COMPRESSION), FLOATS),
        (saved(np.stack([BYTES] * 3, axis=2), "PNG"), BYTES),
        (encode_png(np.stack([SHORTS] * 3, axis=2), {}), SHORTS),
        (exr_of({}, "RGB", np.stack([FLOATS] * 3, axis=2)), FLOATS),
        (saved(np.stack([BYTES, np.full_like(BYTES, 255)], axis=2), "PNG"), BYTES),
    ],
)
def test_values_are_those_of_the_file(data: bytes, wanted: NDArray[Any]) -> None:
    (found,) = read(data)
    np.testing.assert_array_equal(found, wanted, strict=True)


def test_a_jpeg_is_read() -> None:
    (found,) = read(saved(np.full((32, 48), 130, np.uint8), "JPEG"))
    np.testing.assert_array_equal(found, np.full((32, 48), 130, np.uint8), strict=True)


def test_bands_keep_their_order_and_their_bits(tmp_path: Path) -> None:
    wanted = np.moveaxis(codes(BANDS), 2, 0)
    for data in (
        encode_png(codes(BANDS), {}),
        tiff_of(codes(BANDS), "uint16", tmp_path, "lzw"),
    ):
        np.testing.assert_array_equal(np.stack(read(data)), wanted, strict=True)
    found = np.stack(read(exr_of({}, "RGB", BANDS)))
    np.testing.assert_array_equal(found, np.moveaxis(BANDS, 2, 0), strict=True)
    (half,) = read(tiff_of(HALVES[..., None], "half", tmp_path))
    np.testing.assert_array_equal(half, HALVES, strict=True)


def test_without_its_reader_a_file_names_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    code = scans._START.replace("from rhytid", "sys.modules['OpenImageIO'] = None; from rhytid", 1)
    monkeypatch.setattr(scans, "_START", code)
    wanted = r"has 3 channels of 16 bits, which OpenImageIO reads: .*\[tx\].*, or save it as EXR"
    with pytest.raises(InputError, match=wanted):
        read(encode_png(codes(BANDS), {}))


def palette() -> bytes:
    return image(Image.fromarray(BYTES).convert("P"), "PNG")


def pages() -> bytes:
    one = Image.fromarray(SHORTS)
    return image(one, "TIFF", save_all=True, append_images=[one])


def cut(data: bytes, share: float = 0.6) -> bytes:
    return data[: int(len(data) * share)]


def with_value(value: float, row: int, column: int) -> NDArray[np.float32]:
    texels = FLOATS.copy()
    texels[row, column] = value
    return texels


def transparent() -> bytes:
    return saved(np.stack([BYTES, BYTES.T.reshape(BYTES.shape)], axis=2), "PNG")


def normals() -> NDArray[np.uint8]:
    slopes = ALIKE[..., :2] * 2 - 1
    whole = np.dstack([slopes, np.ones((128, 128))])
    whole /= np.linalg.norm(whole, axis=2, keepdims=True)
    return np.rint((whole * 0.5 + 0.5) * 255).astype(np.uint8)


def parts() -> bytes:
    kinds = [OpenEXR.Part({}, {"Y": FLOATS}, name) for name in ("a", "b")]
    return exr_file(OpenEXR.File(kinds))


def of_names(*names: str) -> bytes:
    file = OpenEXR.File({}, {name: np.ascontiguousarray(FLOATS) for name in names})
    return exr_file(file)


def huge_png(side: int) -> bytes:
    data = bytearray(saved(BYTES, "PNG"))
    data[16:24] = struct.pack(">II", side, side)
    return bytes(data)


def huge_tiff(side: int) -> bytes:
    """A header of `side`² texels and the data of few."""
    data = saved(SHORTS, "TIFF")
    for old in (64, SIDE):
        for kind in (3, 4):
            width = 256 if old == 64 else 257
            entry = struct.pack("<HHII", width, kind, 1, old)
            data = data.replace(entry, struct.pack("<HHII", width, 4, 1, side))
    return data


def turned(orientation: int) -> bytes:
    return saved(SHORTS, "TIFF", tiffinfo={274: orientation})


def tiff_with_an_empty_tag() -> bytes:
    """Its subfile type has no value."""
    entry = struct.pack("<HHII", 254, 4, 0, 0)
    return saved(SHORTS, "TIFF", tiffinfo={254: 0}).replace(
        struct.pack("<HHII", 254, 4, 1, 0), entry
    )


WRONG: dict[str, tuple[Callable[[], bytes], str]] = {
    "a text": (lambda: b"v 0 0 0\n", "must be EXR, PNG, TIFF or JPEG, by its first bytes"),
    "nothing": (lambda: b"", "must be EXR, PNG, TIFF or JPEG"),
    "a cut EXR": (lambda: cut(exr(FLOATS)), "a damaged EXR image, or one that is cut short"),
    "a cut PNG": (lambda: cut(saved(SHORTS, "PNG")), "a damaged PNG image, or one that is cut"),
    "a cut TIFF": (lambda: cut(saved(SHORTS, "TIFF"), 0.2), "a damaged TIFF image"),
    "a cut JPEG": (lambda: cut(saved(BYTES, "JPEG")), "a damaged JPEG image"),
    "a JPEG that ends early": (lambda: cut(saved(BYTES, "JPEG"), 0.01), "it has no frame"),
    "no number": (
        lambda: exr(with_value(np.nan, 70, 13)),
        "the texel of column 13, row 70 is nan",
    ),
    "infinity": (
        lambda: saved(with_value(-np.inf, 95, 0), "TIFF"),
        "the texel of column 0, row 95 is -inf",
    ),
    "a palette": (palette, "has a palette: save it as grey"),
    "one bit": (lambda: image(Image.fromarray(BYTES).convert("1"), "PNG"), "has 1 bits per texel"),
    "inks of TIFF": (
        lambda: image(Image.fromarray(PHOTO_BYTES).convert("CMYK"), "TIFF"),
        r"has inks \(CMYK\)",
    ),
    "inks of JPEG": (
        lambda: image(Image.fromarray(PHOTO_BYTES).convert("CMYK"), "JPEG"),
        r"has inks \(CMYK\): must be grey",
    ),
    "a TIFF that lies upside down": (lambda: turned(4), r"lies turned \(orientation 4\): save it"),
    "a TIFF with an empty tag": (tiff_with_an_empty_tag, "a damaged TIFF image: it has no tag 254"),
    "pages": (pages, "has 2 pages: must have one"),
    "whole numbers": (
        lambda: saved(SHORTS.astype(np.int32), "TIFF"),
        "has signed codes of 32 bits: must be codes of 8 or 16 bits, or floats",
    ),
    "transparency": (transparent, "has transparency: save it without"),
    "colours": (
        lambda: saved(PHOTO_BYTES, "PNG"),
        r"has colours or vectors: two of its channels rise and fall together \(correlation 1\.00\)",
    ),
    "normals": (lambda: saved(normals(), "PNG"), "is a normal map: must be displacement"),
    "vectors by channels": (
        lambda: of_names("X", "Y", "Z"),
        "has channels X, Y and Z: vector displacement, of three directions",
    ),
    "vectors by values": (
        lambda: exr_of({}, "RGB", ALIKE - 0.5),
        r"two are as fine as one another .* vector displacement",
    ),
    "two channels": (lambda: of_names("R", "G"), "has channels G, R: must have one, or R, G and B"),
    "five channels": (lambda: of_names(*"ABCDE"), "has 5 channels .*: must have 1 to 4"),
    "parts": (parts, "has several parts: must have one"),
    "a window": (
        lambda: raw_exr(displayWindow=window(3, 3)),
        r"has data window .* must be the same, from \(0, 0\) on",
    ),
    "counts": (lambda: raw_exr(channels=channels("Y", kind=0)), "has texels of uint"),
    "few texels": (lambda: saved(BYTES[:8], "PNG"), "has 64 x 8 texels: at least 16 a side"),
}
PHOTO_BYTES = np.rint(PHOTO.clip(0, 1) * 255).astype(np.uint8)


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize("what", WRONG)
def test_what_is_no_relief_is_refused_by_name(what: str) -> None:
    make, wanted = WRONG[what]
    with pytest.raises(InputError, match=f"(?s)^face.1001.map.*{wanted}"):
        read_scan([("face.1001.map", make())], [1001])


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize("word", ["vdm", "Vector", "VDisp"])
def test_vectors_are_known_by_the_name_of_their_file(word: str) -> None:
    data = exr_of({}, "RGB", BANDS)
    with pytest.raises(InputError, match="is named so, and has three channels that differ: vector"):
        read(data, f"head_{word}.1001.exr")
    assert len(read(data, "head_vdmat.1001.exr")) == 3


@pytest.mark.parametrize("make", [huge_png, huge_tiff])
def test_bombs_are_refused_before_they_are_decoded(
    make: Callable[[int], bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Above the most texels by the header; below it the decoder finds that there is not enough."""
    side = 2 * MOST_SCAN_SIDE
    assert read_header(make(4096), "x").width == 4096
    with pytest.raises(InputError, match=r"^face.1001.map: a damaged"):
        read(make(4096))
    monkeypatch.setattr(scans, "answer_of", lambda *_: pytest.fail("it is decoded"))
    with pytest.raises(LimitError, match=f"{side} x {side} texels: at most {MOST_SCAN_SIDE}"):
        read_scan([("face.1001.map", make(side))], [1001])


def test_maps_together_have_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scans, "MOST_BYTES", 3 * SHORTS.nbytes - 1)
    files = [(f"d.{udim}.png", saved(SHORTS, "PNG")) for udim in (1001, 1002, 1003)]
    with pytest.raises(LimitError, match=r"d\.1003\.png: maps up to it have 36864 bytes"):
        read_scan(files, [1001, 1002, 1003])


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits it")
def test_the_decoder_has_room_for_the_image_and_little_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    greedy = "d._pillow = lambda p, h: (bytearray(2 << 30), read(p, h))[1]"
    code = f"import rhytid.formats.scan_decoder as d; read = d._pillow; {greedy}; main()"
    monkeypatch.setattr(scans, "_START", scans._START.replace("main()", code))
    with pytest.raises(InputError, match="a damaged PNG image"):
        read(saved(BYTES, "PNG"))
    monkeypatch.setattr(scans, "_START", scans._START.replace("2 << 30", "200 << 20"))
    (found,) = read(saved(BYTES, "PNG"))
    np.testing.assert_array_equal(found, BYTES, strict=True)


def test_a_decoder_that_does_not_end_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scans, "_SECONDS", 1)
    monkeypatch.setattr(scans, "_START", "import time; time.sleep(60)")
    with pytest.raises(InputError, match=r"face\.1001\.map: not decoded within 1 s"):
        read(saved(BYTES, "PNG"))


@pytest.mark.parametrize("answer", ["", "null\\n", '"u2"\\n12', '"O"\\n12345678', "5\\n", "[]\\n"])
def test_another_answer_is_a_damaged_image(monkeypatch: pytest.MonkeyPatch, answer: str) -> None:
    code = f"import os; os.write(1, b'ready\\n{answer}')"
    monkeypatch.setattr(scans, "_START", code)
    with pytest.raises(InputError, match="a damaged PNG image"):
        read(saved(BYTES, "PNG"))


def test_a_process_that_may_crash_decodes_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    monkeypatch.setattr(exr_format, "_begun", told.append)
    monkeypatch.setattr(scans, "answer_of", lambda *_: pytest.fail("in another process"))
    (found,) = read(saved(SHORTS, "PNG"))
    np.testing.assert_array_equal(found, SHORTS, strict=True)
    with pytest.raises(InputError, match="a damaged PNG image"):
        read(cut(saved(SHORTS, "PNG")))
    monkeypatch.setitem(sys.modules, "OpenImageIO", None)
    with pytest.raises(InputError, match="which OpenImageIO reads"):
        read(encode_png(codes(BANDS), {}))
    assert told == ["face.1001.map"] * 3


def test_every_cut_of_a_header_is_an_input_error() -> None:
    for data in (saved(SHORTS, "TIFF"), saved(BYTES, "JPEG"), saved(SHORTS, "TIFF", big_tiff=True)):
        for end in range(0, len(data), max(len(data) // 300, 1)):
            for noise in (b"", b"\xff" * 8):
                with suppress(InputError, LimitError):
                    read_header(data[:end] + noise, "x")


def test_udims_are_found_in_names() -> None:
    both = (1001, 1002)
    for name, udim in (
        ("d.1002.exr", 1002),
        ("head_1001.png", 1001),
        ("shot.1002.0007.exr", 1002),
        ("head.4096.1001.tif", 1001),
        ("1002.tif", 1002),
        ("head.1024.1001.tif", 1001),
    ):
        assert scan_udims([f"/maps/{name}"], both) == {f"/maps/{name}": udim}
    for name in ("disp.png", "disp_4096.jpg", "disp_1024.png"):
        assert scan_udims([name], [1001]) == {name: 1001}


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["d.1005.exr"], "d.1005.exr is of UDIM 1005, which has no mesh; the mesh has 1001, 1002"),
        (["d.exr"], "d.exr names no UDIM; the mesh has 1001, 1002: name every map by its UDIM"),
        (["d.1001.exr", "e.1001.exr"], "e.1001.exr and d.1001.exr are both of UDIM 1001"),
        (["d_u1_v1.exr"], "d_u1_v1.exr names no UDIM"),
        (["d.1001.exr"], "no map of UDIM 1002, which the mesh has; scan.partial allows it"),
    ],
)
def test_wrong_udims_are_told(names: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_scan([(name, exr(FLOATS)) for name in names], [1001, 1002])


@pytest.mark.usefixtures("decoded_here")
def test_maps_of_one_scan_are_alike() -> None:
    first = ("d.1001.exr", exr(FLOATS))
    for other, said in (
        (saved(SHORTS, "PNG"), "d.1002.x has 16 bits, d.1001.exr has float: one scale"),
        (exr_of({}, "RGB", BANDS), "d.1002.x has 3 channels that differ, d.1001.exr has 1"),
    ):
        with pytest.raises(InputError, match=said):
            read_scan([first, ("d.1002.x", other)], [1001, 1002])
    files = [("a.1001.png", saved(BYTES, "PNG")), ("d.1002.x", saved(SHORTS, "PNG"))]
    with pytest.raises(InputError, match=r"d\.1002\.x has 16 bits, a\.1001\.png has 8 bits"):
        read_scan(files, [1001, 1002])
    found = read_scan([first, ("d.1002.x", exr(HALVES[:32]))], [1001, 1002])
    assert [(m.udim, m.shape, m.kind) for m in found.values()] == [
        (1001, (SIDE, 64), "float"),
        (1002, (32, 64), "half"),
    ]


def test_the_decoder_refuses_another_image_than_was_promised(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(saved(BYTES[:32], "PNG"))
    with pytest.raises(ValueError, match="not the channels and the size of the header"):
        scan_decoder.decode(path, read_header(saved(BYTES, "PNG"), "x"))
