"""Skin packages of the fake engine: two small files."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from pathlib import Path

from api.fake_state import FakeState, Part
from rhytid.engine.messages import JobInfo, Package
from rhytid.errors import ChangedError
from rhytid.storage.packages import read_archive, write_archive

FILES = {
    "index.html": b"<!doctype html>\n",
    "manifest.json": b'{"format": "rhytid-skin"}\n',
    "textures/maps.1001.ktx2": bytes(range(256)) * 2000,
}


class FakePackages(Part):
    """A new one for every asset, after as many looks at its job as builds take. Its key is the
    asset's and `version`, which a test may change."""

    def __init__(self, state: FakeState) -> None:
        super().__init__(state)
        self.version = 1
        self._jobs: dict[str, str] = {}
        self._folder = Path(tempfile.mkdtemp())
        atexit.register(shutil.rmtree, self._folder)

    def of(
        self, asset: str, levels: int = 1, key: str | None = None, begin: bool = True
    ) -> Package | JobInfo | None:
        self.state.built(asset)
        now = f"{asset}-{levels}-{self.version}"
        if key not in (None, now):
            raise ChangedError("the asset has changed: begin again")
        job = self._jobs.get(now)
        if job is None:
            if not begin:
                return None
            job = self._jobs[now] = self.state.start(asset, "package")
        if (info := self.state.jobs[job]).state != "done":
            return info
        file = self._folder / f"{now}.zip"
        if not file.exists():
            archive(FILES, file)
        with file.open("rb") as opened:
            return Package(now, file, file.stat().st_size, read_archive(opened, file))


def archive(contents: dict[str, bytes], file: Path) -> None:
    """A package with these files."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in contents.items():
            (Path(folder) / name).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / name).write_bytes(data)
        write_archive(Path(folder), file, lambda: None)
