"""An engine whose calls go to replicas: the same calls, and the same errors."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace
from typing import Any

from rhytid.device.figures import Figures
from rhytid.device.memory import usual_host_memory
from rhytid.engine.byte_budget import ByteBudget
from rhytid.engine.messages import DeviceInfo
from rhytid.engine.operations import OPERATIONS, Proxy
from rhytid.errors import BusyError, DeviceLostError
from rhytid.fleet.caller import FleetCaller
from rhytid.fleet.fleet_assets import SharedCalls
from rhytid.fleet.fleet_store import FleetStore
from rhytid.fleet.frame_versions import FrameVersions
from rhytid.fleet.jobs import JobNames
from rhytid.fleet.options import FleetOptions
from rhytid.fleet.remote_registry import RemoteFrameRegistry, ReplicaReports
from rhytid.processes.envelope import Request
from rhytid.processes.job_ledger import JobLedger
from rhytid.processes.remote_calls import RemoteCalls, UploadHolds
from rhytid.support.settings import ServiceSettings


class RayEngine(Proxy):
    """An engine on replicas of Ray Serve. There may be as many as there are ingresses: none of them
    knows what others do not.

    replicas: handle of their deployment.
    """

    def __init__(
        self,
        settings: ServiceSettings,
        options: FleetOptions,
        replicas: Any,
        registry: RemoteFrameRegistry,
    ) -> None:
        host_memory = settings.host_memory or usual_host_memory()
        self.memory = ByteBudget(host_memory, "RHYTID_HOST_MEMORY_MB")
        self._reports = ReplicaReports(registry)
        versions = FrameVersions()
        store = FleetStore.opened(settings, options)
        names = JobNames(store.files.job_key())
        self._caller = FleetCaller(replicas, versions, names, self._present)
        uploads = UploadHolds(self.memory)
        own = SharedCalls(self._caller, store).own
        super().__init__(RemoteCalls(self._caller, versions, JobLedger(), uploads, own))

    def close(self) -> None:
        """Look after the replicas no more; they belong to who started them."""
        self._reports.close()

    def well(self) -> bool:
        """True: Ray looks after replicas, and ends those that are not."""
        return True

    def mark(self, asset: str, frame: str) -> None:
        """None: replicas change what they have, and other ingresses have them do so."""

    def ready(self) -> bool:
        """Whether a kernel computes on the device of a replica; true where all of them are busy."""
        try:
            return bool(self._present() and self._caller.call(Request(OPERATIONS["ready"])))
        except BusyError:
            return True
        except DeviceLostError:
            return False

    def devices(self) -> list[DeviceInfo]:
        """The device of each replica, by the name of the replica."""
        return [
            replace(one.device, restarts=sum(one.restarts.values())) for one in self._reports.look()
        ]

    @property
    def figures(self) -> dict[str, Figures]:
        """What each device does, in the order of `devices`."""
        numbers = map(str, itertools.count())
        reports = self._reports.reports
        return {
            number: Figures(memoryview(bytearray(one.figures)))
            for number, one in zip(numbers, reports, strict=False)
        }

    @property
    def waiting(self) -> int:
        """Calls of this ingress that are not answered yet."""
        return self._caller.waiting

    @property
    def restarts(self) -> dict[str, int]:
        """How often the processes of devices were started again, by what had ended them; a replica
        that this ingress has lost counts as killed."""
        found = Counter({"killed": self._caller.lost})
        for one in self._reports.reports:
            found.update(one.restarts)
        return dict(found)

    def _present(self) -> bool:
        return bool(self._reports.look())
