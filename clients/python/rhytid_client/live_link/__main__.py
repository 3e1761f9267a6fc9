"""`python -m rhytid_client.live_link`: faces of Live Link Face in, files of tiles out."""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import suppress
from pathlib import Path

from rhytid_client import Client, ProblemError, RhytidError, npy
from rhytid_client.live.messages import Address, LiveAnswer, LiveTile
from rhytid_client.live_link.bridge import Bridge
from rhytid_client.live_link.packet import ARKIT
from rhytid_client.live_link.receiver import PORT, FaceReceiver
from rhytid_client.saving import write_whole


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(
        prog="python -m rhytid_client.live_link",
        description="Draw the skin of a face that the app Live Link Face films: its packets in, "
        "the newest displacement of each tile as .npy out.",
    )
    made.add_argument("asset", help="id of an asset that was sent with named shapes")
    made.add_argument("--url", default="http://127.0.0.1:8717", help="the server")
    made.add_argument("--key-file", type=Path, help="file with an API key, where one is needed")
    made.add_argument("--host", default="", help="address to listen on (default: all)")
    made.add_argument("--port", type=int, default=PORT, help=f"UDP port (default: {PORT})")
    made.add_argument("--subject", help="whose face; else of whom the first packet is")
    made.add_argument(
        "--tile", action="append", required=True, type=_tile, metavar="UDIM/LEVEL/ROW/COLUMN",
        help="a tile that is wanted; repeat it",
    )  # fmt: skip
    made.add_argument("--method", default="binned", help="as of tiles (default: binned)")
    made.add_argument("--tolerance", type=float, default=0.0, help="mesh units; see docs/live.md")
    made.add_argument("--out", type=Path, default=Path(), help="folder (default: this one)")
    return made


def _tile(text: str) -> Address:
    parts = text.split("/")
    if len(parts) != 4 or not all(part.isascii() and part.isdigit() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not udim/level/row/column")
    udim, level, row, column = map(int, parts)
    return udim, level, row, column


class _Files:
    """Replaces the file of a tile as a whole, and says once a second how it goes."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._since = folder, time.monotonic()
        self._frames = self._tiles = self._dropped = 0

    def tile(self, tile: LiveTile) -> None:
        path = self._folder / f"{'.'.join(map(str, tile.address))}.npy"
        write_whole(path, npy.encode(tile.array))
        self._tiles += 1

    def answer(self, answer: LiveAnswer | ProblemError) -> None:
        if isinstance(answer, ProblemError):
            print(answer, file=sys.stderr)
            return
        self._frames, self._dropped = self._frames + 1, self._dropped + answer.dropped
        if time.monotonic() - self._since >= 1.0:
            print(
                f"{self._frames} frames, {self._tiles} tiles, {self._dropped} dropped", flush=True
            )
            self._since, self._frames, self._tiles, self._dropped = time.monotonic(), 0, 0, 0


def main() -> int:
    """Run until interrupted; 1 where the connection ended by itself."""
    given = parser().parse_args()
    with suppress(KeyboardInterrupt):
        try:
            files = _Files(given.out)
            key = given.key_file.read_text("utf-8") if given.key_file else None
            with (
                Client(given.url, key=key) as client,
                FaceReceiver(given.host, given.port, given.subject) as faces,
                client.live(
                    given.asset, tiles=given.tile, method=given.method, shapes=ARKIT,
                    tolerance=given.tolerance,
                ) as live,
            ):  # fmt: skip
                missing = ", ".join(live.asset.unknown)
                print(f"listening on port {faces.port}; not in the asset: {missing or 'none'}")
                Bridge(faces, live, files.tile, files.answer).run()
        except (RhytidError, OSError) as error:
            print(f"rhytid_client.live_link: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
