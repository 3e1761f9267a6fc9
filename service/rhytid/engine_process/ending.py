"""How a process of a device ended, and whether what it worked on is to blame."""

from __future__ import annotations

import signal
from dataclasses import dataclass

from rhytid.device.watch import Purpose

# Signals of faults in the process itself. SIGKILL comes from elsewhere: of somebody, or of a system
# that is short of memory.
_FAULTS = {signal.SIGSEGV, signal.SIGABRT, signal.SIGFPE, signal.SIGILL}
if hasattr(signal, "SIGBUS"):
    _FAULTS.add(signal.SIGBUS)


@dataclass(frozen=True)
class Ending:
    """Why a process is no more.

    kind: fault, one of its own; late, a call of the driver took too long; killed, from elsewhere.
    reason: in words.  purpose: what the driver worked for.
    """

    kind: str
    reason: str
    purpose: Purpose

    @property
    def blames(self) -> bool:
        """Whether what the driver worked for may have caused it."""
        return self.kind in ("fault", "late")


def ending_of(status: int, late: float | None, purpose: Purpose) -> Ending:
    """Of a process with this exit status.  late: seconds that a call of the driver had, where the
    process was ended because they were over."""
    if late is not None:
        reason = f"a call of the OpenCL driver took more than {late:g} seconds"
        return Ending("late", reason, purpose)
    if status >= 0:
        return Ending("fault", f"it ended with status {status}", purpose)
    name = signal.Signals(-status).name
    kind = "fault" if -status in _FAULTS else "killed"
    return Ending(kind, f"it ended by {name}", purpose)
