"""The application that `serve deploy` takes, as far as Ray checks it without running it."""

from __future__ import annotations

import asyncio
import pickle
import signal
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.types import Message, Receive, Scope, Send

from api.fake_engine import FakeEngine
from api.patch import upload
from rhytid.api.keys import READ, new_key, write_keys
from rhytid.api.request_memory import LAST
from rhytid.errors import AccessError, DeviceError, SettingsError
from rhytid.fleet.app import application, asking, deployment, ingress_app, local_fleet
from rhytid.fleet.options import FleetOptions
from rhytid.support.settings import ServiceSettings


def config_of(**options: Any) -> Any:
    replicas = deployment(ServiceSettings(), FleetOptions(**options))
    return replicas._bound_deployment._deployment_config


def test_the_count_of_replicas_is_fixed_or_follows_the_load() -> None:
    fixed, moving = config_of(least=3, most=3), config_of(least=2, most=8, calls=10)
    assert (fixed.num_replicas, fixed.autoscaling_config) == (3, None)
    found = moving.autoscaling_config
    assert (found.min_replicas, found.max_replicas) == (2, 8)
    assert found.target_ongoing_requests == 5
    assert moving.max_ongoing_requests == 10


def test_a_replica_asks_for_its_share_of_a_machine() -> None:
    replicas = deployment(ServiceSettings(), FleetOptions(cpus=2.0, gpus=1.0))
    wanted = replicas._bound_deployment.ray_actor_options
    assert (wanted["num_cpus"], wanted["num_gpus"]) == (2.0, 1.0)


def test_the_application_is_made_of_options(tmp_path: Path) -> None:
    given = {"store": str(tmp_path), "without_keys": "true"}
    made = application({**given, "replicas": "2", "ingresses": "3"})
    assert made._bound_deployment.num_replicas == 3
    with pytest.raises(SettingsError, match="no option 'device' of a fleet"):
        application({"device": "0"})


def test_ray_that_does_not_start_leaves_the_signals_of_the_server(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(**given: Any) -> None:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        raise ConnectionError("nobody is there")

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("ray.init", fail)
    made = local_fleet(ServiceSettings(), FleetOptions(), "10.0.0.1:6379")
    with pytest.raises(DeviceError, match=r"no Ray answers at 10\.0\.0\.1:6379: nobody"), made:
        pass
    assert signal.getsignal(signal.SIGTERM) == before


def test_an_ingress_of_ray_asks_for_keys(tmp_path: Path) -> None:
    with pytest.raises(AccessError, match=r"keys\.json has no valid API key.*without_keys=true"):
        application({"store": str(tmp_path)})
    settings = ServiceSettings(store=tmp_path)
    _, key = new_key("pipeline", {READ})
    write_keys(settings.key_file, [key])
    assert asking(settings, FleetOptions()).ask_keys is True
    assert asking(settings, FleetOptions(without_keys=True)).ask_keys is False
    with pytest.raises(SettingsError, match="without_keys is 'yes': must be true or false"):
        application({"store": str(tmp_path), "without_keys": "yes"})


def test_large_answers_reach_the_proxy_of_ray() -> None:
    """It is in another process: messages are pickled."""
    app = ingress_app(FakeEngine(), ServiceSettings())

    async def proxied(scope: Scope, receive: Receive, send: Send) -> None:
        async def sent(message: Message) -> None:
            await send(pickle.loads(pickle.dumps(message)))

        await app(scope, receive, sent)

    async def large_map() -> bytes:
        through = httpx.ASGITransport(app=proxied)
        async with httpx.AsyncClient(transport=through, base_url="http://localhost") as client:
            made = (await client.post("/v1/assets", files=upload())).json()
            await client.get(f"/v1/jobs/{made['job']}/events")
            path = f"/v1/assets/{made['id']}/frames/neutral/maps/1001"
            return (await client.get(path, params={"format": "npy"})).content

    assert len(asyncio.run(large_map())) > LAST
