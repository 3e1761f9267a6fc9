"""Skin packages of the fake engine: two small files."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from pathlib import Path

from api.fake_state import FakeState, Part
from rhytid.engine.messages import JobInfo, Package

FILES = {
    "manifest.json": b'{"format": "rhytid-skin"}\n',
    "textures/maps.1001.ktx2": bytes(range(256)) * 2000,
}


class FakePackages(Part):
    """A new one for every asset, after as many looks at its job as builds take."""

    def __init__(self, state: FakeState) -> None:
        super().__init__(state)
        self._jobs: dict[str, str] = {}
        self._folder = Path(tempfile.mkdtemp())
        atexit.register(shutil.rmtree, self._folder)

    def of(self, asset: str, levels: int = 1) -> Package | JobInfo:
        self.state.built(asset)
        job = self._jobs.get(asset)
        if job is None:
            job = self._jobs[asset] = self.state.start(asset, "package")
        if (info := self.state.jobs[job]).state != "done":
            return info
        folder = self._folder / f"{asset}-{levels}"
        for name, data in FILES.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(data)
        return Package(folder.name, folder, {name: len(data) for name, data in FILES.items()})
