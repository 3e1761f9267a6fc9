"""The service as host applications talk to it: what goes wrong is Trouble, and calls that are more
than one request."""

from __future__ import annotations

import re
import secrets
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from numpy.typing import ArrayLike, NDArray

from rhytid_client.choices import Layer, Method, Sampling, TileFormat
from rhytid_client.errors import RhytidError
from rhytid_client.hosts.meshes import MeshArrays
from rhytid_client.hosts.trouble import Trouble, message_of
from rhytid_client.hosts.work import Step
from rhytid_client.plain_client import PlainClient
from rhytid_client.results import Asset
from rhytid_client.warned import silent

CONNECT_SECONDS = 3.0
WAIT_SECONDS = 30.0
POLL_SECONDS = 0.2
# Part of the names of frames on the server, so that two hosts with one mesh do not meet.
SESSION = secrets.token_hex(4)


def address(text: str) -> str:
    """The address of a server as a user writes it, with http:// where it has no scheme; raises
    Trouble where it is none."""
    given = text.strip()
    url = given if "://" in given else f"http://{given}"
    try:
        parts = urlsplit(url)
        usable = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:  # a port that is no number
        usable = False
    if not usable:
        raise Trouble(f"{given!r} is not the address of a server: it is like http://127.0.0.1:8717")
    return url


@dataclass(frozen=True)
class Drawing:
    """How maps are asked for."""

    method: Method = "redraw"
    sampling: Sampling = "smooth"
    format: TileFormat = "exr"
    layer: Layer = "displacement"
    level: int = 0


@dataclass(frozen=True)
class Scan:
    """Displacement that a mesh has already.

    files: EXR, PNG, TIFF or JPEG, paths or bytes by UDIM.  settings: `scan_settings` of the client.
    """

    files: Mapping[int, Path | bytes]
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class Server:
    """The address of a service.  key: of its API, as `rhytid keys create` prints it; empty where
    the service asks for none."""

    url: str = "http://127.0.0.1:8717"
    key: str = field(default="", repr=False)

    @contextmanager
    def client(self) -> Iterator[PlainClient]:
        """A client; what goes wrong with it is raised as Trouble."""
        try:
            # They come with the results, too, from where hosts show them.
            with silent():
                yield PlainClient(
                    address(self.url), key=self.key, connect=CONNECT_SECONDS, max_wait=WAIT_SECONDS
                )
        except (RhytidError, ValueError) as exc:
            raise Trouble(message_of(exc, self.url)) from exc

    def tested(self) -> str:
        """What the service computes on, in words; raises Trouble."""
        with self.client() as client:
            if not client.ready():
                raise Trouble("The server answers, but its device does not compute")
            used = [device.name for device in client.devices() if device.selected]
        return f"Connected: {used[0] if used else 'device unknown'}"

    def sending(
        self,
        mesh: MeshArrays | Path,
        settings: Mapping[str, Any],
        shapes: Mapping[str, NDArray[Any]] | None = None,
        name: str | None = None,
        scan: Scan | None = None,
    ) -> Generator[Step, None, Asset]:
        """Send a mesh, arrays or the path of a file, and wait until its skin is grown.

        shapes: expressions, positions (V, 3) by name.  name: of arrays, for people.  scan: its
        lines are traced in place of a growth. Closed, it ends the job. Raises Trouble.
        """
        yield 0.0, "sending", 0.0
        with self.client() as client:
            file = None if name is None else re.sub(r"[/:\\]", "_", name) + ".npz"
            made = client.create_asset(
                mesh, name=file, settings=settings, shapes=shapes, **_scan_of(scan)
            )
        asset = yield from self._built(made)
        if asset.state == "failed":
            what = "grow wrinkles on this mesh" if scan is None else "trace this displacement"
            raise Trouble(f"The server cannot {what}: {asset.reason}")
        return replace(asset, warnings=tuple(dict.fromkeys((*made.warnings, *asset.warnings))))

    def _built(self, asset: Asset) -> Generator[Step, None, Asset]:
        job = asset.job or ""
        try:
            while asset.state == "building":
                with self.client() as client:
                    now = client.job(job)
                    asset = client.asset(asset)
                yield now.progress, now.stage, POLL_SECONDS
        except GeneratorExit:
            with suppress(Trouble), self.client() as client:
                client.cancel(job)
            raise
        return asset

    def calibrating(self, asset: Asset | str, positions: ArrayLike) -> Generator[Step, None, None]:
        """Set the range of the precomputed maps from a frame, positions (V, 3), and wait for them.

        Closed, it ends the job. Raises Trouble.
        """
        yield 0.0, "sending", 0.0
        with self.client() as client:
            job = client.calibrate(asset, positions)
        try:
            while not job.ended:
                yield job.progress, job.stage, POLL_SECONDS
                with self.client() as client:
                    job = client.job(job.id)
        except GeneratorExit:
            with suppress(Trouble), self.client() as client:
                client.cancel(job)
            raise
        if job.state != "done":
            raise Trouble(f"The precomputed maps were not made: {job.detail or job.state}")

    def drawn(
        self,
        asset: Asset | str,
        who: str,
        positions: ArrayLike,
        udims: Iterable[int],
        drawing: Drawing,
    ) -> tuple[dict[int, bytes], tuple[str, ...]]:
        """The maps of positions (V, 3) as files by UDIM, and warnings; raises Trouble.

        who: names the mesh among those of this process.
        """
        [maps], warnings = self.drawn_each(asset, who, positions, udims, [drawing])
        return maps, warnings

    def drawn_each(
        self,
        asset: Asset | str,
        who: str,
        positions: ArrayLike,
        udims: Iterable[int],
        drawings: Iterable[Drawing],
    ) -> tuple[list[dict[int, bytes]], tuple[str, ...]]:
        """As `drawn`, of several drawings; the frame is sent once."""
        udims = list(udims)
        frame = f"host-{SESSION}-{who}"
        with self.client() as client:
            stored = client.put_frame(asset, frame, positions)
            try:
                maps = [
                    {udim: _map(client, asset, frame, udim, drawing) for udim in udims}
                    for drawing in drawings
                ]
            finally:
                with suppress(RhytidError):
                    client.delete_frame(asset, frame)
        return maps, tuple(str(warning) for warning in stored.warnings)

    def bound(self, asset: Asset) -> float:
        """How far heights of an asset may be from 0, in its unit; raises Trouble.

        It is what white of a 16-bit PNG stands for, one number for all frames: 4.8 times the depth
        of a wrinkle of strength 1.
        """
        with self.client() as client:
            tile = client.tile(asset, "neutral", asset.udims[0], 0, 0, 0, format="png")
        if tile.scale is None:
            raise Trouble(f"{self.url} does not say how high its maps are")
        return tile.scale


def _scan_of(scan: Scan | None) -> dict[str, Any]:
    return {} if scan is None else {"scan": scan.files, "scan_settings": scan.settings}


def _map(client: PlainClient, asset: Asset | str, frame: str, udim: int, how: Drawing) -> bytes:
    tile = client.map(
        asset, frame, udim,
        method=how.method, sampling=how.sampling, format=how.format,
        layer=how.layer, level=how.level,
    )  # fmt: skip
    return bytes(tile.content)
