"""The exceptions that rhytid raises on purpose.

::

    RhytidError
    ├── InputError               the caller's input is wrong; the message says what and where
    │   ├── MeshError
    │   ├── GraphError
    │   ├── FrameError
    │   │   └── ShapesError      expressions of a mesh
    │   ├── SettingsError
    │   ├── SnapshotError        a file that is no snapshot of an asset, or a damaged one
    │   ├── StrictError          something is probably wrong, and the caller asked to be strict
    │   └── QueryError           an address, a method or a format that does not exist
    ├── NotFoundError            no such asset, frame, job, UDIM or tile
    ├── ConflictError            the request is right, but not in the present state
    │   ├── NotReadyError        the asset is still building (``retry_after`` seconds)
    │   ├── ChangingError        the settings change while they are used (``retry_after`` seconds)
    │   ├── ReadOnlyError        ``neutral`` cannot be written
    │   └── ChangedError         the asset has changed since the caller began to read it
    ├── LimitError               the request exceeds a limit; the message has both numbers
    │   ├── FrameMemoryError     the memory for frames is full
    │   └── HostMemoryError      one request needs more memory than all may hold together
    ├── BusyError                the queue of the device is full (``retry_after`` seconds)
    │   ├── HostBusyError        other requests hold the memory (``retry_after`` seconds)
    │   ├── FetchingError        the asset comes from the shared store (``retry_after`` seconds)
    │   └── DrainingError        the server is shutting down (``retry_after`` seconds)
    ├── AccessError              the caller may not do this
    │   ├── ApiKeyError          the request has no API key, or none that is valid
    │   └── ScopeError           the API key does not allow this
    ├── QuotaError               the caller asks for more than it may (``retry_after`` seconds)
    ├── CancelledError           the caller cancelled the job
    ├── FarmError                a cluster does not answer, or its workers cannot do the work
    ├── StorageError             the store is damaged or cannot be written
    │   ├── DiskFullError        the disk has no room for what was to be written
    │   ├── TooManyFilesError    as many files are open as may be (``retry_after`` seconds)
    │   ├── StoreFormatError     another version of rhytid wrote the store or the asset
    │   ├── SharedStoreError     the shared store cannot be used (``retry_after`` seconds)
    │   └── SharedDamageError    an object of the shared store is not what was written
    └── DeviceError
        ├── NoDeviceError        no OpenCL device computes here; the message names ways to get one
        ├── KernelBuildError     a kernel does not compile; carries the build log
        ├── DeviceMemoryError    the request does not fit the device memory budget
        ├── DeviceLostError      the process of the device restarts (``retry_after`` seconds)
        └── FatalRequestError    the process of the device ended twice at this request

Messages of `StorageError`, `DeviceError` and `KernelBuildError` may hold paths and build logs of
this machine. Callers elsewhere get the text of `public` in their place.
"""

from __future__ import annotations


class RhytidError(Exception):
    """Base of every deliberate error."""

    # The text that callers elsewhere get in place of the message; None for the message itself.
    public: str | None = None


def public_message(error: BaseException) -> str:
    """The text of an error for callers elsewhere."""
    if not isinstance(error, RhytidError):
        return f"internal error: {type(error).__name__}"
    return str(error) if error.public is None else error.public


class InputError(RhytidError):
    """The caller's input is wrong."""


class MeshError(InputError):
    """A mesh that cannot be used; names the element."""


class GraphError(InputError):
    """A wrinkle graph that cannot be used; names the array and the element."""


class FrameError(InputError):
    """Frame positions or a frame name that cannot be used."""


class ShapesError(FrameError):
    """Expressions that cannot be used; names the array or the expression and the vertex."""


class SettingsError(InputError):
    """A setting that is unknown, of the wrong type or out of range; names its path."""


class SnapshotError(InputError):
    """A file that is no snapshot of an asset, or a damaged one; names the place in it."""


class StrictError(InputError):
    """Something is probably wrong, and the caller asked to be strict; `warnings` has all of it."""

    def __init__(self, message: str, warnings: tuple[object, ...] = ()) -> None:
        super().__init__(message)
        self.warnings = warnings


class QueryError(InputError):
    """An address, a method or a format that does not exist."""


class NotFoundError(RhytidError):
    """No such asset, frame, job, UDIM or tile."""


class ConflictError(RhytidError):
    """The request is right, but not in the present state."""


class NotReadyError(ConflictError):
    """The asset is still building."""

    retry_after = 1


class ChangingError(ConflictError):
    """The settings of the asset change again and again while a map is drawn."""

    retry_after = 1


class ReadOnlyError(ConflictError):
    """The frame ``neutral`` always exists and cannot be written."""


class ChangedError(ConflictError):
    """The asset has changed since the caller began to read it."""


class LimitError(RhytidError):
    """The request exceeds a limit of this server."""


class FrameMemoryError(LimitError):
    """The memory for frames is full."""


class HostMemoryError(LimitError):
    """One request needs more memory than all may hold together."""


class BusyError(RhytidError):
    """The queue of the device is full."""

    retry_after = 1


class HostBusyError(BusyError):
    """Other requests hold the memory, and it did not come free in time."""

    retry_after = 5


class FetchingError(BusyError):
    """The asset is being fetched from the shared store."""

    retry_after = 1


class DrainingError(BusyError):
    """The server is shutting down; the next one will take the request."""

    retry_after = 5


class AccessError(RhytidError):
    """The caller may not do this."""


class ApiKeyError(AccessError):
    """The request has no API key, or none that is valid."""


class ScopeError(AccessError):
    """The API key of the request does not allow this; names the scope that does."""


class QuotaError(RhytidError):
    """The caller asks for more than it may."""

    def __init__(self, message: str, retry_after: int = 1) -> None:
        super().__init__(message)
        self.retry_after = retry_after


class CancelledError(RhytidError):
    """The caller cancelled the job."""


class FarmError(RhytidError):
    """A cluster does not answer, or its workers cannot do the work."""


class StorageError(RhytidError):
    """The store is damaged or cannot be written."""

    public = "the store failed: the server's log has the reason"


class DiskFullError(StorageError):
    """The disk has no room for what was to be written; none of it is kept."""

    public = (
        "the disk of the server is full: free some of it, or delete assets; "
        "what found no room is not kept"
    )


class TooManyFilesError(StorageError):
    """As many files are open as this process, or the system, may have."""

    retry_after = 5
    public = "the server has as many files open as it may: ask again"


class StoreFormatError(StorageError):
    """Another version of rhytid wrote the store or the asset, and this one cannot read it."""

    public = (
        "another version of rhytid stored this, and this one cannot read it: "
        "update the server, or delete the asset"
    )


class SharedStoreError(StorageError):
    """The shared store cannot be reached, or refuses; names the object."""

    retry_after = 5
    public = "the shared store cannot be used: the server's log has the reason"


class SharedDamageError(StorageError):
    """An object of the shared store is not what was written; names the object."""

    public = "the asset is damaged in the shared store: send it again"


class DeviceError(RhytidError):
    """The OpenCL runtime failed."""

    public: str | None = "the device failed: the server's log has the reason"


class NoDeviceError(DeviceError):
    """No OpenCL device computes here."""

    public = None


class KernelBuildError(DeviceError):
    """A kernel does not compile; the message carries the build log."""


class DeviceMemoryError(DeviceError):
    """The request does not fit the device memory budget."""

    public = None


class DeviceLostError(DeviceError):
    """The process of the device has ended, or is starting."""

    retry_after = 5
    public = None


class FatalRequestError(DeviceError):
    """The process of the device ended twice at this request, which is not tried again."""

    public = None
