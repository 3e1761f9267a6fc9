"""The OpenAPI document is complete, and its pages need no internet."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from api.asking import is_problem
from rhytid import __version__
from rhytid.api.app import create_app
from rhytid.domain.asset_settings import AssetSettings
from rhytid.domain.setting_fields import leaves
from rhytid.domain.settings_changes import CHANGEABLE
from rhytid.errors import SettingsError
from rhytid.support.settings import ServiceSettings


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    engine: Any = None
    return create_app(engine, ServiceSettings()).openapi()


def calls(document: dict[str, Any]) -> list[dict[str, Any]]:
    return [call for path in document["paths"].values() for call in path.values()]


def test_operation_ids_are_names_for_functions(document: dict[str, Any]) -> None:
    ids = [call["operationId"] for call in calls(document)]

    assert len(ids) > 20
    assert [name for name in ids if not re.fullmatch(r"[a-z]+([A-Z][a-z]+)+", name)] == []
    assert len(set(ids)) == len(ids)
    assert {"listAssets", "createAsset", "getTile", "streamJobEvents"} <= set(ids)


def dependencies(route: Any) -> set[str]:
    """Names of what a route asks for, directly or through others."""
    found, left = set(), list(route.dependant.dependencies)
    while left:
        one = left.pop()
        found.add(one.call.__name__)
        left += one.dependencies
    return found


def test_calls_that_take_a_slot_or_memory_may_be_refused_for_either() -> None:
    engine: Any = None
    app = create_app(engine, ServiceSettings())
    wanting = {}
    for route in app.state.routes:
        needed = dependencies(route) & {
            "_slot",
            "_memory",
            "drawing_of",
            "_positions",
            "read_parts",
        }
        if route.include_in_schema and needed:
            wanting[route.operation_id] = {503, 507} - set(route.responses)

    assert len(wanting) > 12
    assert {"getBins", "updateAsset", "putFrame", "createAsset", "getTile"} <= set(wanting)
    assert {name: missing for name, missing in wanting.items() if missing} == {}


def test_every_parameter_is_described(document: dict[str, Any]) -> None:
    parameters = [
        (call["operationId"], parameter)
        for call in calls(document)
        for parameter in call.get("parameters", [])
    ]

    assert len(parameters) > 50
    assert {p["in"] for _, p in parameters} == {"path", "query"}
    assert [(name, p["name"]) for name, p in parameters if not p.get("description")] == []


def test_every_property_is_described(document: dict[str, Any]) -> None:
    found = list(properties(document))

    assert len(found) > 150
    assert [where for where, schema in found if not schema.get("description")] == []


def properties(node: Any, where: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every property that holds a value of its own: bodies, answers, components."""
    if isinstance(node, list):
        for item in node:
            yield from properties(item, where)
    elif isinstance(node, dict):
        for name, schema in node.get("properties", {}).items():
            if "properties" not in schema:
                yield f"{where}.{name}", schema
        for key, value in node.items():
            yield from properties(value, f"{where}.{key}")


def test_every_reference_leads_somewhere(document: dict[str, Any]) -> None:
    names = set(re.findall(r"'#/components/schemas/(\w+)'", str(document)))

    assert {"AssetSettings", "SettingsChange", "Problem"} <= names
    assert names <= set(document["components"]["schemas"])


def schema_leaves(schema: dict[str, Any], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    for name, inner in schema["properties"].items():
        if "properties" in inner:
            yield from schema_leaves(inner, f"{path}{name}.")
        else:
            yield path + name, inner


def answered(document: dict[str, Any]) -> dict[str, Any]:
    """The schema of the settings, less what answers do not have."""
    schema = document["components"]["schemas"]["AssetSettings"]
    kept = {name: one for name, one in schema["properties"].items() if "writeOnly" not in one}
    assert schema["properties"].keys() - kept.keys() == {"scan"}
    return {**schema, "properties": kept}


def test_the_schema_of_the_settings_has_their_defaults(document: dict[str, Any]) -> None:
    schemas = document["components"]["schemas"]
    found = {n: s["default"] for n, s in schema_leaves(answered(document))}

    assert found == leaves(AssetSettings().as_json())
    assert set(schemas["SettingsChange"]["properties"]) == set(CHANGEABLE)


def nested(name: str, value: Any) -> Any:
    for part in reversed(name.split(".")):
        value = {part: value}
    return value


def test_the_schema_of_the_settings_refuses_what_the_service_refuses(
    document: dict[str, Any],
) -> None:
    tried = 0
    for name, rule in schema_leaves(answered(document)):
        whole = "integer" in rule["type"]
        step = 1 if whole else 1e-3
        wrong: list[Any] = [[]]
        if "enum" in rule:
            wrong += ["nothing of this", 3.25]
        elif "maxLength" in rule:
            wrong += ["x" * (rule["maxLength"] + 1), ""]
        elif "maximum" in rule:
            wrong += [rule["minimum"] - step, rule["maximum"] + step]
        else:
            wrong += [-1.0] + ([0.0] if "exclusiveMinimum" in rule else [])
        if "null" not in rule["type"]:
            wrong.append(None)
        for value in wrong:
            tried += 1
            with pytest.raises(SettingsError, match=f"^{re.escape(name)} is "):
                AssetSettings().changed(nested(name, value))
    assert tried > 150


# So that no setting limits another.
WIDE = {
    "resolution": 16384,
    "tile_size": 64,
    "response": {"log_stretch_limit": 4.0},
    "bins": {"r_max": 0.01, "tilt": False},
}


def test_the_service_takes_what_the_schema_of_the_settings_allows(
    document: dict[str, Any],
) -> None:
    base = AssetSettings().changed(WIDE)
    tried = 0
    for name, rule in schema_leaves(answered(document)):
        ends = [rule[end] for end in ("minimum", "maximum") if end in rule]
        ends += [1e-6, 1e6] if "exclusiveMinimum" in rule else []
        ends += [None] if "null" in rule["type"] else []
        for value in (*rule.get("enum", []), *ends):
            tried += 1
            assert leaves(base.changed(nested(name, value)).as_json())[name] == value
    assert tried > 100


def test_settings_are_sent_as_that_schema(document: dict[str, Any]) -> None:
    assets = document["paths"]["/v1/assets"]
    form = assets["post"]["requestBody"]["content"]["multipart/form-data"]
    assert form["schema"]["properties"]["settings"]["$ref"].endswith("/AssetSettings")
    assert form["encoding"]["settings"]["contentType"] == "application/json"
    change = document["paths"]["/v1/assets/{asset}"]["patch"]["requestBody"]["content"]
    assert change["application/json"]["schema"]["$ref"].endswith("/SettingsChange")


def test_the_event_stream_has_its_media_type(
    client: httpx.Client, asset: str, document: dict[str, Any]
) -> None:
    answers = document["paths"]["/v1/jobs/{job}/events"]["get"]["responses"]
    assert list(answers["200"]["content"]) == ["text/event-stream"]
    job = client.get(f"/v1/assets/{asset}").json()["job"]
    with client.stream("GET", f"/v1/jobs/{job}/events") as events:
        assert events.headers["content-type"].split(";")[0] == "text/event-stream"


BROWSER = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"


def test_the_root_says_where_to_go(client: httpx.Client) -> None:
    answer = client.get("/")
    assert answer.headers["vary"] == "Accept"
    told = answer.json()
    assert (told.pop("name"), told.pop("version")) == ("rhytid", __version__)
    assert set(told) >= {"docs", "openapi", "assets"}

    page = client.get("/", headers={"Accept": BROWSER})
    assert page.headers["content-type"].startswith("text/html")
    assert "<canvas" in page.text
    assert all(client.get(place).status_code == 200 for place in told.values())
    is_problem(client.get("/", headers={"Accept": "image/png"}), 406)


def test_the_docs_load_nothing_from_elsewhere(client: httpx.Client) -> None:
    page = client.get("/docs")
    assert page.headers["content-type"].startswith("text/html")
    loaded = re.findall(r'(?:src|href)="([^"]+)"', page.text)

    assert len(loaded) == 3
    assert re.findall(r"https?://[^\s\"']+", page.text) == []
    assert re.search(r'"validatorUrl": null', page.text)
    kinds = [client.get(place).headers["content-type"].split(";")[0] for place in loaded]
    assert kinds == ["text/css", "image/png", "text/javascript"]
    assert b"SwaggerUIBundle" in client.get("/docs/swagger-ui-bundle.js").content
    assert client.get("/docs/..%2f__init__.py").status_code == 404
    is_problem(client.get("/docs/__init__.py"), 404)
    assert client.get("/redoc").status_code == 404


def test_a_file_is_called_as_the_client_accepts_it(client: httpx.Client, asset: str) -> None:
    """Its own type, or octets where that alone is accepted; the bytes are the same."""
    path = f"/v1/assets/{asset}/mesh"
    own = client.get(path)
    assert own.headers["content-type"] == "model/gltf-binary"
    for accept in ("*/*", "model/*, application/octet-stream;q=0.5", "application/json"):
        answer = client.get(path, headers={"Accept": accept})
        assert answer.headers["content-type"] == "model/gltf-binary"
    for accept in ("application/octet-stream", "application/json, application/octet-stream;q=0.1"):
        answer = client.get(path, headers={"Accept": accept})
        assert answer.headers["content-type"] == "application/octet-stream"
        assert "Accept" in answer.headers["vary"]
        assert answer.content == own.content
        listed = client.get("/v1/assets", headers={"Accept": accept})
        assert listed.headers["content-type"] == "application/json"
