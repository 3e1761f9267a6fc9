"""A bucket of an object store that speaks S3, as the backend of a shared store."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from typing_extensions import override

from rhytid.domain.wording import install_hint
from rhytid.errors import InputError, SharedStoreError
from rhytid.storage.shared.backend import SHARED_STORE, Backend, Found, reached, too_large
from rhytid.support import cancellation
from rhytid.support.atomic_files import sync_file

# Seconds to connect, and without a byte: of what is small, for which callers wait, and of the rest.
_CONNECT, _QUICK, _SILENT = 3, 5, 20
# How often what fails for lack of a connection is tried, by botocore times by s3fs.
_ATTEMPTS, _TRIES = 1, 3
# Bytes of a part, and parts that are sent at once: this much of a large object is in memory.
_PART, _AT_ONCE = 16 << 20, 2
# Bytes of a marker, at most.
_MARKER = 1 << 16


class BucketBackend(Backend):
    """Objects of a bucket, below a prefix, by fsspec and s3fs.

    An object is visible once all of it was sent. Keys, region and endpoint are those that other
    programs of S3 take: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_ENDPOINT_URL, a profile, or
    the role of the machine. Raises InputError where the extra `s3` is not installed.
    """

    fresh = 1.0

    def __init__(self, url: str) -> None:
        self._url = url.rstrip("/")
        self._bucket = self._url.removeprefix("s3://").partition("/")[0]
        self._files, self._small = _file_system(_SILENT), _file_system(_QUICK)

    def __str__(self) -> str:
        return self._url

    @override
    def check(self) -> None:
        with reached(f"{self} cannot be read"):
            # Asks for one object: a prefix may hold many.
            self._small.call_s3("list_objects_v2", Bucket=self._bucket, MaxKeys=1)

    @override
    def claim(self) -> None:
        data = self.read(SHARED_STORE.marker, _MARKER)
        if data is not None:
            SHARED_STORE.reads(data, self)
            return
        with suppress(SharedStoreError):  # it may only be read
            self.write(SHARED_STORE.marker, SHARED_STORE.text())

    @override
    def find(self, name: str) -> Found | None:
        with reached(f"{self._path(name)} cannot be read"), suppress(FileNotFoundError):
            return _found(self._small.info(self._path(name), refresh=True))
        return None

    @override
    def read(self, name: str, most: int) -> bytes | None:
        found = self.find(name)
        if found is not None and found.nbytes > most:
            raise too_large(self, name, found.nbytes, most)
        with reached(f"{self._path(name)} cannot be read"), suppress(FileNotFoundError):
            return bytes(self._small.cat_file(self._path(name)))
        return None

    @override
    def fetch(self, name: str, to: Path) -> bool:
        with reached(f"{self._path(name)} cannot be fetched"):
            try:
                self._files.get_file(self._path(name), str(to), callback=_asking())
            except FileNotFoundError:
                return False
            sync_file(to)
        return True

    @override
    def write(self, name: str, data: bytes) -> None:
        with reached(f"{self._path(name)} cannot be written"):
            self._files.pipe_file(self._path(name), data)

    @override
    def local(self, name: str) -> Path | None:
        return None

    @override
    def send(self, name: str, source: Path) -> None:
        with reached(f"{self._path(name)} cannot be written"):
            self._files.put_file(
                str(source),
                self._path(name),
                callback=_asking(),
                chunksize=_PART,
                max_concurrency=_AT_ONCE,
            )

    @override
    def put(self, name: str, pieces: Iterable[bytes | memoryview]) -> None:
        with reached(f"{self._path(name)} cannot be written"), NamedTemporaryFile() as aside:
            aside.writelines(pieces)
            aside.flush()
            self.send(name, Path(aside.name))

    @override
    def create(self, name: str, data: bytes) -> bool:
        with reached(f"{self._path(name)} cannot be written"):
            try:
                self._files.pipe_file(self._path(name), data, mode="create")
            except FileExistsError:
                return False
        return True

    @override
    def names(self, folder: str) -> list[str]:
        return list(self.found(folder))

    @override
    def found(self, folder: str) -> dict[str, Found]:
        with reached(f"{self._path(folder)} cannot be listed"), suppress(FileNotFoundError):
            listed = self._small.ls(self._path(folder), detail=True, refresh=True)
            files = {str(one["name"]).rpartition("/")[2]: one for one in listed}
            return {name: _found(files[name]) for name in sorted(files)}
        return {}

    @override
    def remove(self, name: str) -> bool:
        known = self.find(name) is not None
        with reached(f"{self._path(name)} cannot be removed"), suppress(FileNotFoundError):
            self._files.rm_file(self._path(name))
        return known

    def _path(self, name: str) -> str:
        return f"{self._url}/{name}"


def _found(info: Any) -> Found:
    """What s3fs says of an object, or of a folder, which has no revision."""
    modified = info.get("LastModified")
    return Found(
        str(info.get("ETag", "")), int(info["size"]), modified.timestamp() if modified else 0.0
    )


def _asking() -> Any:
    """Told of each piece of a transfer, on another thread: raises there where this thread is to
    stop."""
    from fsspec import Callback  # type: ignore[import-untyped]

    class Asking(Callback):  # type: ignore[misc]
        asked = staticmethod(cancellation.current_check())

        def relative_update(self, inc: int = 1) -> None:
            self.asked()

    return Asking()


def _file_system(silent: int) -> Any:
    """The file system of fsspec, with nothing remembered of what it has seen.  silent: seconds
    without a byte after which it is asked again."""
    try:
        from s3fs import S3FileSystem
    except ImportError as exc:
        raise InputError(
            f"a shared store on s3:// needs the extra s3; {install_hint('s3')} ({exc})"
        ) from exc
    limits = {
        "connect_timeout": _CONNECT,
        "read_timeout": silent,
        "retries": {"total_max_attempts": _ATTEMPTS},
    }
    files = S3FileSystem(
        config_kwargs=limits, use_listings_cache=False, skip_instance_cache=True, anon=False
    )
    files.retries = _TRIES
    return files
