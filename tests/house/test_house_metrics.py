"""The page of operation and the dashboard name the metrics that there are."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from api.fake_engine import FakeEngine
from house.syntax import ROOT
from rhytid.api.app import create_app
from rhytid.support.settings import ServiceSettings

DASHBOARD = ROOT / "docker" / "grafana" / "rhytid.json"
PAGE = ROOT / "docs" / "operate.md"
ROW = re.compile(r"\| `(\w+)` \| (\w+) \|([^|]*)\| [^|]+ \|")


@pytest.fixture(scope="module")
def families() -> dict[str, Any]:
    """Metrics by name, as a scrape finds them."""
    engine: Any = FakeEngine()
    app = create_app(engine, ServiceSettings())
    metrics = app.state.metrics
    metrics.figures.took("upload", 1)
    metrics.requests.labels("GET", "/", "200").inc()
    metrics.refused.labels("busy").inc()
    metrics.seconds.labels("/").observe(1.0)
    metrics.tiles.labels("redraw").inc()
    return {family.name: family for family in metrics.registry.collect()}


def test_the_page_has_every_metric_with_its_type_and_labels(families: dict[str, Any]) -> None:
    rows = {name: (type_, labels) for name, type_, labels in ROW.findall(PAGE.read_text())}
    wanted = {}
    for name, family in families.items():
        if name.startswith("rhytid_"):
            labels = {label for sample in family.samples for label in sample.labels} - {"le"}
            full = f"{name}_total" if family.type == "counter" else name
            wanted[full] = (family.type, labels)
    found = {
        name: (type_, set(re.findall(r"`(\w+)`", given))) for name, (type_, given) in rows.items()
    }
    assert {name: row for name, row in found.items() if name.startswith("rhytid_")} == wanted


def queries(node: Any) -> Iterator[str]:
    """What the dashboard asks Prometheus."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key in ("expr", "query") and isinstance(value, str):
                yield value
            else:
                yield from queries(value)
    elif isinstance(node, list):
        for one in node:
            yield from queries(one)


def asked() -> list[str]:
    return [q for q in queries(json.loads(DASHBOARD.read_text())) if q != "prometheus"]


def test_the_dashboard_asks_for_what_there_is(families: dict[str, Any]) -> None:
    samples = {sample.name for family in families.values() for sample in family.samples}
    named = {name for query in asked() for name in re.findall(r"\b(?:rhytid|process)_\w+", query)}
    assert named - samples == set()
    about_us = {name for name in families if name.startswith("rhytid_")}
    shown = {name for name in about_us if any(name in one for one in named)}
    assert about_us - shown == set()


def test_the_dashboard_asks_by_labels_that_there_are(families: dict[str, Any]) -> None:
    labels = {
        label for family in families.values() for s in family.samples for label in s.labels
    } | {"job", "instance", "le"}
    for query in asked():
        for names in re.findall(r"\bby \(([^)]*)\)", query):
            assert {name.strip() for name in names.split(",")} <= labels, query
        for names in re.findall(r"\{([^}]*)\}", query):
            assert set(re.findall(r"(\w+)(?:=~|!~|!=|=)", names)) <= labels, query


def test_every_panel_has_a_place_of_its_own() -> None:
    panels = json.loads(DASHBOARD.read_text())["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    cells = [
        (x, y)
        for at in (panel["gridPos"] for panel in panels)
        for x in range(at["x"], at["x"] + at["w"])
        for y in range(at["y"], at["y"] + at["h"])
    ]
    assert len(cells) == len(set(cells))
    assert max(x for x, _ in cells) < 24
