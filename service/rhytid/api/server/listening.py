"""The socket of the server, and what is settled before the web framework is imported."""

from __future__ import annotations

import socket
import sys
from ipaddress import ip_address
from pathlib import Path

from rhytid.api.keys import check_mark, has_valid_key
from rhytid.errors import AccessError, InputError

LOOPBACK = "127.0.0.1"


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens; port 0 is a free one. Raises InputError naming the address."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family)
    except OSError as exc:
        # Python adds the address to the system's own words, which are enough.
        reason = str(exc.strerror).partition(" (while")[0]
        raise InputError(f"cannot listen on {host} port {port}: {reason}") from exc
    # Connections inherit it. Without, the end of an answer waits for the client to acknowledge its
    # beginning, which clients put off for 40 ms.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listening


def address_of(listening: socket.socket) -> str:
    """The URL of a listening socket."""
    host, port = listening.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def asks_keys(
    listening: socket.socket,
    keys: Path,
    *,
    without: bool,
    mark: Path | None = None,
    named: bool = False,
) -> bool | None:
    """The value of the setting `ask_keys` for a server on this socket.

    keys: file of the keys.  without: whether nobody is asked for a key.  mark: file that says that
    keys were asked for before.  named: whether the user named the file of the keys. Raises
    AccessError where the file should exist and does not, and where other machines reach the socket
    but no key is valid; StorageError where the file cannot be read.
    """
    if without:
        return False
    valid = has_valid_key(keys)
    if mark is not None:
        check_mark(keys, mark)
    if named and not keys.exists():
        raise AccessError(
            f"RHYTID_KEYS_FILE names {keys}, which is not there: is it mounted? Make a key with "
            "`rhytid keys create NAME`, or give --without-keys"
        )
    if ip_address(listening.getsockname()[0]).is_loopback:
        return None
    if not valid:
        raise AccessError(
            f"{address_of(listening)} can be reached from other machines, and {keys} has no valid "
            "API key: make one with `rhytid keys create NAME`, listen on 127.0.0.1, or give "
            "--without-keys where a proxy in front of the server knows who may use it"
        )
    return True


def allow_files(connections: int) -> None:
    """Raise the limit of open files of this process to what so many connections need, as far as the
    system allows. It is usually 1024. A request opens up to three files beside its connection."""
    if sys.platform != "win32":
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        needed = 4 * connections + 256
        most = needed if hard == resource.RLIM_INFINITY else min(needed, hard)
        if soft != resource.RLIM_INFINITY and soft < most:
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
