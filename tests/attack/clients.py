"""Clients that stall: they send part of what they must, or read nothing of what they get."""

from __future__ import annotations

import socket
from contextlib import suppress

from attack.served import Attacked

HEAD = b'--b\r\nContent-Disposition: form-data; name="mesh"; filename="m.obj"\r\n\r\n'


def connected(server: Attacked) -> socket.socket:
    """A connection to the server."""
    return socket.create_connection(server.address, timeout=30)


def not_reading(server: Attacked, path: str) -> socket.socket:
    """A connection on which something large was asked for, and whose answer stays unread."""
    connection = connected(server)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    return connection


def sending(server: Attacked, sent: int, declared: int) -> socket.socket:
    """A connection on which so many bytes of an upload were sent."""
    connection = connected(server)
    head = (
        "POST /v1/assets HTTP/1.1\r\nHost: localhost\r\n"
        "Content-Type: multipart/form-data; boundary=b\r\n"
        f"Content-Length: {declared}\r\n\r\n"
    )
    connection.sendall(head.encode() + HEAD)
    for _ in range(sent >> 20):
        connection.sendall(bytes(1 << 20))
    return connection


def is_open(connection: socket.socket) -> bool:
    """Whether the server has not closed a connection; reads what it sent before."""
    connection.setblocking(False)
    with suppress(OSError):
        while connection.recv(1 << 16):
            pass
        return False
    try:
        connection.sendall(b"x")
    except OSError:
        return False
    return True
