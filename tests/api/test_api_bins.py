"""The precomputed maps over HTTP."""

from __future__ import annotations

import httpx
import numpy as np
import pytest

from api.asking import array_of, built, is_problem
from api.patch import upload


def test_the_manifest_counts_what_there_is(client: httpx.Client, asset: str) -> None:
    bins = client.get(f"/v1/assets/{asset}/bins").json()
    assert len(bins["angles"]) == bins["layers"]["wrinkles"] == 4
    assert len(bins["samples"]) == 3
    assert {len(steps) for steps in bins["steps"].values()} == {3}
    assert (bins["bits"], bins["merge"], bins["depth_factored"]) == (8, "soft", True)


def test_a_mellow_merge_has_layers_of_bulges(client: httpx.Client) -> None:
    mellow = built(client, upload(bins={"merge": "mellow", "depth_factored": True}))
    bins = client.get(f"/v1/assets/{mellow}/bins").json()
    assert (bins["merge"], bins["depth_factored"]) == ("mellow", True)
    assert bins["layers"] == {
        "wrinkles": 4, "pores": 1, "wrinkle_bulges": 4, "pore_bulges": 1,
    }  # fmt: skip
    assert bins["steps"].keys() == bins["layers"].keys()
    path = f"/v1/assets/{mellow}/bins/1001/0/1/2"
    for layer, count in bins["layers"].items():
        query = {"bin": count - 1, "sample": 2, "layer": layer}
        assert array_of(client.get(path, params=query)).shape == (64, 64)
        beyond = client.get(path, params={**query, "bin": count})
        assert layer in is_problem(beyond, 404, "not-found")


def test_a_tile_of_codes_is_int8(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/bins/1001/0/1/2"
    response = client.get(path, params={"bin": 2, "sample": 1})
    codes = array_of(response)
    assert (codes.dtype, codes.shape) == (np.int8, (64, 64))
    pores = client.get(path, params={"bin": 0, "sample": 1, "layer": "pores"})
    assert array_of(pores).shape == (64, 64)
    known = {"If-None-Match": response.headers["etag"]}
    again = client.get(path, params={"bin": 2, "sample": 1}, headers=known)
    assert (again.status_code, again.content) == (304, b"")


@pytest.mark.parametrize(
    ("query", "status", "kind", "what"),
    [
        ("", 422, None, "query parameter bin is missing"),
        ("?bin=0", 422, None, "query parameter sample is missing"),
        ("?bin=x&sample=0", 422, None, "query parameter bin is 'x'"),
        ("?bin=0&sample=0&colour=1", 422, None, "unknown query parameter colour"),
        ("?bin=0&bin=1&sample=0", 422, "query", "'bin'"),
        ("?bin=4&sample=0", 404, "not-found", "bin 4"),
        ("?bin=0&sample=3", 404, "not-found", "sample 3"),
        ("?bin=0&sample=0&layer=hair", 404, "not-found", "hair"),
        ("?bin=0&sample=0&layer=pore_bulges", 404, "not-found", "pore_bulges"),
    ],
)
def test_bad_queries_are_refused(
    client: httpx.Client, asset: str, query: str, status: int, kind: str | None, what: str
) -> None:
    response = client.get(f"/v1/assets/{asset}/bins/1001/0/0/0{query}")
    assert what in is_problem(response, status, kind)


def test_a_coarser_level_is_not_found_and_says_why(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/bins/1001/1/0/0"
    response = client.get(path, params={"bin": 0, "sample": 0})
    assert "level 0 only" in is_problem(response, 404, "not-found")


def test_the_documentation_says_that_maps_have_level_0_alone(client: httpx.Client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    said = paths["/v1/assets/{asset}/bins/{udim}/{level}/{row}/{column}"]["get"]["description"]
    assert "Level 0 only" in said
