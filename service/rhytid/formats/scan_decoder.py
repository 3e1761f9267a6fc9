"""The process that decodes one file of scanned displacement and ends; `scans` starts it.

It decodes what its header promised: values as they are in the file, without colour management.
Pillow reads grey and what has 8 bits, the OpenEXR library EXR. Several channels of 16 bits or of
floats, which Pillow would round to 8 bits, are read by OpenImageIO where that is installed.
Arguments: path, a ScanHeader as JSON. Standard output: READY, a line of JSON, then the channels one
after another.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rhytid.formats.exr_decoder import READY, limit_memory
from rhytid.formats.scan_headers import ScanHeader

Channels = tuple[NDArray[Any], ...]
# The answer where OpenImageIO would be needed.
NO_READER = "no reader"


class NoReaderError(Exception):
    """OpenImageIO is not installed."""


def written(header: ScanHeader) -> str:
    """A header as an argument of the process."""
    return json.dumps(asdict(header))


def main() -> None:
    """Decode the image that the arguments name; any exception or signal says that it is damaged."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries warn on standard output
    given = json.loads(sys.argv[2])
    header = ScanHeader(**{**given, "names": tuple(given["names"])})
    _import_readers(header)
    out.write(READY)
    out.flush()
    limit_memory(header.width * header.height * len(header.names), header.nbytes)
    try:
        channels = decode(Path(sys.argv[1]), header)
    except NoReaderError:
        out.write(json.dumps(NO_READER).encode() + b"\n")
    else:
        out.write(json.dumps(channels[0].dtype.str[1:]).encode() + b"\n")
        for channel in channels:
            out.write(np.ascontiguousarray(channel).data)
    out.flush()


def decode(path: Path, header: ScanHeader) -> Channels:
    """The channels (H, W) of a file, all of one type, in the order of `header.names`.

    Raises what the libraries raise, ValueError where the image is not the one that its header
    promised, NoReaderError without OpenImageIO.
    """
    if header.format == "exr":
        found = _exr(path, header.names)
    elif _is_wide(header):
        found = _open_image(path)
    else:
        found = _pillow(path, header)
    shapes = {channel.shape for channel in found}
    if len(found) != len(header.names) or shapes != {(header.height, header.width)}:
        raise ValueError("not the channels and the size of the header")
    dtype = np.result_type(*found)
    if dtype.str[1:] not in ("u1", "u2", "f2", "f4"):
        raise ValueError(f"texels of {dtype}")
    return tuple(channel.astype(dtype.newbyteorder("="), copy=False) for channel in found)


def _is_wide(header: ScanHeader) -> bool:
    """Whether Pillow would round it, or does not read it."""
    return header.dtype == "f2" or (len(header.names) > 1 and header.dtype != "u1")


def _exr(path: Path, names: tuple[str, ...]) -> Channels:
    import OpenEXR

    file = OpenEXR.File(str(path), separate_channels=True)
    # A file that is cut short raises nothing: it just has no parts.
    channels = file.channels() if file.parts else {}
    return tuple(channels[name].pixels for name in names)


def _pillow(path: Path, header: ScanHeader) -> Channels:
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None  # the header is checked already
    kind = [header.format.upper()]
    if header.format == "png":
        with Image.open(path, formats=kind) as image:
            image.verify()  # every chunk and its checksum, to the end
    with Image.open(path, formats=kind) as image:
        if "transparency" in image.info:
            raise ValueError("a colour that is transparent")
        values = np.asarray(image)
    # 16 bits are `I;16` or `I` by the version of the library; their numbers are the same.
    values = values.astype(header.dtype, copy=False)
    return tuple(np.moveaxis(values, 2, 0)) if values.ndim == 3 else (values,)


def _open_image(path: Path) -> Channels:
    try:
        import OpenImageIO
    except ImportError as error:
        raise NoReaderError from error
    plain = OpenImageIO.ImageSpec()
    plain["oiio:UnassociatedAlpha"] = 1  # else colours are multiplied by it
    file = OpenImageIO.ImageInput.open(str(path), plain)
    if file is None:
        raise ValueError(OpenImageIO.geterror())
    values = file.read_image("native")
    wrong = file.has_error
    file.close()
    if wrong or values is None:
        raise ValueError("the image cannot be read")
    return tuple(np.moveaxis(np.asarray(values), 2, 0))


def _import_readers(header: ScanHeader) -> None:
    """Import what will be needed before the memory is limited."""
    if header.format == "exr":
        import OpenEXR  # noqa: F401
    elif not _is_wide(header):
        import PIL.Image  # noqa: F401
    else:
        with suppress(ImportError):
            import OpenImageIO  # noqa: F401
