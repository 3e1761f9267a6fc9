"""The Python process of a device before it is told what it is for.

It imports what it needs at once, and then waits for its first message. So a server starts it first
of all, see `interpreter_ahead`, and imports its own parts meanwhile: this module imports little.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

from rhytid.device.loader import prepare_loader

# Heaps that glibc makes there at most, unless the environment says otherwise. By itself it makes 8
# per core, each with gaps of its own: after 15 minutes of mixed load on two cores 17 heaps took
# 300 MiB. Python runs one thread at a time, and the kernels of PoCL allocate nothing.
_ARENAS = "2"
# Lets glibc, from 2.35 on, ask Linux for pages of 2 MiB for all that malloc gives, the buffers of a
# processor among them: a core that reads them waits less often to learn where a page lies.
_TUNABLES, _LARGE_PAGES = "GLIBC_TUNABLES", "glibc.malloc.hugetlb"
# It gets the path of this process, not what lies in the folder that it is started in.
_CODE = (
    "import sys; sys.path[:] = sys.argv[1].split(sys.argv[2]); "
    "from rhytid.processes.child import main; main(*map(int, sys.argv[3:]))"
)


@dataclass(frozen=True)
class Interpreter:
    """A started process, and the near end of its control connection."""

    process: subprocess.Popen[bytes]
    control: Connection

    @classmethod
    def started(cls) -> Interpreter:
        """A new process. The system ends it together with the thread that calls this; raises
        OSError where it starts none."""
        prepare_loader()  # the folders that drivers need, once for all processes
        near, far = Pipe()
        with far:
            try:
                return cls(_spawned(far.fileno()), near)
            except BaseException:
                near.close()
                raise

    def end(self) -> None:
        """End a process that nothing was asked of."""
        self.control.close()
        self.process.kill()
        self.process.wait()


_begun: list[Interpreter] = []


@contextmanager
def interpreter_ahead() -> Iterator[None]:
    """Start a process for the first call of `next_interpreter` within the block, on the main
    thread; it ends with the block where nobody took it. Where the system starts none, that call
    finds it out."""
    with suppress(OSError):
        _begun.append(Interpreter.started())
    try:
        yield
    finally:
        while _begun:
            _begun.pop().end()


def next_interpreter() -> Interpreter:
    """The process that was begun, or a new one; raises as `Interpreter.started`."""
    try:
        return _begun.pop()
    except IndexError:
        return Interpreter.started()


def environment(given: Mapping[str, str]) -> dict[str, str]:
    """The environment of the process of a device: `given`, and what that does not say of malloc."""
    found = {"MALLOC_ARENA_MAX": _ARENAS, **given}
    if _LARGE_PAGES not in (said := found.get(_TUNABLES, "")):
        found[_TUNABLES] = ":".join([*filter(None, [said]), f"{_LARGE_PAGES}=1"])
    return found


def begin_again_as_device() -> None:
    """Where this process is the command `rhytid`, begin it again in the environment of the process
    of a device, unless it has that: what a command measures is then what a server takes. glibc
    reads the environment only as a process begins."""
    started = Path(sys.argv[0])
    named = "/".join(started.parts[-2:]) == "rhytid/__main__.py" or started.name == "rhytid"
    if sys.platform == "linux" and named and environment(os.environ) != dict(os.environ):
        with suppress(OSError):
            command = [sys.executable, *sys.orig_argv[1:]]
            os.execve(sys.executable, command, environment(os.environ))


def possible() -> bool:
    """Whether this system passes descriptors between processes; Windows does not."""
    return hasattr(socket, "send_fds") and hasattr(signal, "SIGKILL")


def _spawned(control: int) -> subprocess.Popen[bytes]:
    numbers = [str(number) for number in (control, os.getpid())]
    command = [sys.executable, "-c", _CODE, os.pathsep.join(sys.path), os.pathsep, *numbers]
    # A session of its own: an interrupt at the terminal is for the server, which ends it.
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        pass_fds=(control,),
        start_new_session=True,
        env=environment(os.environ),
    )
