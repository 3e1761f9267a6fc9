"""The manifests for Kubernetes and compose name what there is: settings, ports, health checks."""

from __future__ import annotations

import re
from typing import Any

import pytest
import yaml

from house.syntax import ROOT
from rhytid.api.access import OPEN, ROUTES
from rhytid.support.settings import ServiceSettings

DOCKER = ROOT / "docker"
COMPOSE = ("compose.yaml", "compose.workers.yaml")
NGINX = (DOCKER / "workers" / "nginx.conf").read_text(encoding="utf-8")
PORT = 8717


def documents(name: str) -> list[dict[str, Any]]:
    return list(yaml.safe_load_all((DOCKER / name).read_text(encoding="utf-8")))


def manifest(kind: str) -> dict[str, Any]:
    (found,) = [one for one in documents("kubernetes/rhytid.yaml") if one["kind"] == kind]
    return found


def pod() -> dict[str, Any]:
    spec: dict[str, Any] = manifest("StatefulSet")["spec"]["template"]["spec"]
    return spec


def container() -> dict[str, Any]:
    (found,) = pod()["containers"]
    return dict(found)


def services(name: str) -> dict[str, dict[str, Any]]:
    (found,) = documents(name)
    return dict(found["services"])


def environments() -> dict[str, dict[str, str]]:
    """The variables of every server."""
    found = {"kubernetes": manifest("ConfigMap")["data"]}
    for file in COMPOSE:
        for name, service in services(file).items():
            found[f"{file}: {name}"] = service.get("environment", {})
    return found


@pytest.mark.parametrize("place", environments())
def test_variables_are_settings(place: str) -> None:
    given = environments()[place]
    ours = {name: value for name, value in given.items() if name.startswith("RHYTID_")}
    asked: set[str] = set()

    class Recording(dict[str, str]):
        def get(self, key: str, default: Any = None) -> Any:
            asked.add(key)
            return super().get(key, default)

    plain = {name: re.sub(r"\$\{\w+:-(.*)\}", r"\1", value) for name, value in ours.items()}
    ServiceSettings.from_environment(Recording(plain))

    assert set(ours) <= asked
    assert set(given) == set(ours)


def test_probes_ask_what_the_api_answers_to_anybody() -> None:
    probes = {name: container()[name]["httpGet"] for name in PROBES}

    assert {name: probe["path"] for name, probe in probes.items()} == PROBES
    assert all(ROUTES[f"GET {path}"] == OPEN for path in PROBES.values())
    assert {probe["port"] for probe in probes.values()} == {"http"}


PROBES = {
    "startupProbe": "/healthz",
    "livenessProbe": "/healthz",
    "readinessProbe": "/readyz",
}


def test_ports_are_that_of_the_image() -> None:
    assert f"EXPOSE {PORT}" in (DOCKER / "Dockerfile").read_text()
    assert container()["ports"] == [{"name": "http", "containerPort": PORT}]
    (port,) = manifest("Service")["spec"]["ports"]
    assert (port["port"], port["targetPort"]) == (PORT, "http")
    assert services("compose.workers.yaml")["proxy"]["ports"] == [f"127.0.0.1:{PORT}:{PORT}"]
    assert set(re.findall(r"(?:listen |:)(\d{4,5});?", NGINX)) == {str(PORT)}


def test_parts_of_the_manifest_belong_together() -> None:
    labels = manifest("StatefulSet")["spec"]["template"]["metadata"]["labels"]
    assert manifest("StatefulSet")["spec"]["selector"]["matchLabels"] == labels
    assert manifest("Service")["spec"]["selector"] == labels
    assert manifest("StatefulSet")["spec"]["serviceName"] == manifest("Service")["metadata"]["name"]
    assert container()["envFrom"] == [
        {"configMapRef": {"name": manifest("ConfigMap")["metadata"]["name"]}}
    ]


def test_what_is_mounted_is_there() -> None:
    claims = {
        c["metadata"]["name"] for c in manifest("StatefulSet")["spec"]["volumeClaimTemplates"]
    }
    volumes = claims | {volume["name"] for volume in pod()["volumes"]}
    mounts = {mount["name"]: mount["mountPath"] for mount in container()["volumeMounts"]}

    assert set(mounts) == volumes
    assert mounts["store"] == "/data"
    assert manifest("ConfigMap")["data"]["RHYTID_KEYS_FILE"].startswith(f"{mounts['keys']}/")
    assert "RHYTID_STORE=/data" in (DOCKER / "Dockerfile").read_text()


def test_one_server_uses_one_store() -> None:
    assert manifest("StatefulSet")["spec"]["replicas"] == 1
    stores = [
        next(volume for volume in service["volumes"] if volume.endswith(":/data"))
        for name, service in services("compose.workers.yaml").items()
        if name != "proxy"
    ]
    assert len(set(stores)) == len(stores) == 2


def test_nobody_is_root_and_the_root_is_read_only() -> None:
    assert pod()["securityContext"]["runAsNonRoot"] is True
    assert f"USER {pod()['securityContext']['runAsUser']}:" in (DOCKER / "Dockerfile").read_text()
    own = container()["securityContext"]
    assert (own["readOnlyRootFilesystem"], own["allowPrivilegeEscalation"]) == (True, False)
    assert own["capabilities"] == {"drop": ["ALL"]}
    for file in COMPOSE:
        for service in services(file).values():
            assert service["read_only"] is True
            assert service["cap_drop"] == ["ALL"]


def test_there_is_time_to_drain() -> None:
    drain = int(manifest("ConfigMap")["data"]["RHYTID_DRAIN_SECONDS"])

    assert pod()["terminationGracePeriodSeconds"] > drain
    assert ServiceSettings().drain_seconds < 30
    for file in COMPOSE:
        waits = [s["stop_grace_period"] for n, s in services(file).items() if n != "proxy"]
        assert set(waits) == {"30s"}


def test_the_patch_for_a_gpu_meets_the_container() -> None:
    (patch,) = documents("kubernetes/gpu.yaml")
    (patched,) = patch["spec"]["template"]["spec"]["containers"]

    assert patched["name"] == container()["name"]
    assert patched["resources"]["limits"] == {"nvidia.com/gpu": 1}
    assert "AS nvidia" in (DOCKER / "Dockerfile").read_text()


def test_the_proxy_knows_every_server_and_finds_assets() -> None:
    servers = set(re.findall(r"server (\w+):", NGINX))
    (pattern,) = re.findall(r'"~(\^/v1/assets/\S+)"', NGINX)
    path = "/v1/assets/0123456789abcdef/frames/a/tiles/1001/0/0/0"
    found = re.match(pattern.replace("?<", "?P<"), path)

    assert servers == set(services("compose.workers.yaml")) - {"proxy"}
    assert found is not None
    assert found["id"] == "0123456789abcdef"
    assert any(route.split(" ")[1].startswith("/v1/assets/{asset}/frames") for route in ROUTES)


def test_the_proxy_is_believed_and_limits_its_callers() -> None:
    found = services("compose.workers.yaml")
    address = found["proxy"]["networks"]["default"]["ipv4_address"]
    (most,) = re.findall(r"limit_conn callers (\d+);", NGINX)

    assert found["worker1"]["environment"]["RHYTID_PROXIES"] == address
    assert found["worker2"]["environment"]["RHYTID_PROXIES"] == address
    assert int(most) <= ServiceSettings().connections // 8


def test_the_proxy_takes_what_the_server_takes() -> None:
    (largest,) = re.findall(r"client_max_body_size (\d+)m;", NGINX)

    assert int(largest) << 20 == ServiceSettings().upload_limit
