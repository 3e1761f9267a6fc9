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
    assert {name: len(steps) for name, steps in bins["steps"].items()} == {
        "wrinkles": 3, "pores": 3, "grain": 1,
    }  # fmt: skip
    assert (bins["bits"], bins["merge"], bins["depth_factored"]) == (8, "soft", True)


def test_a_mellow_merge_has_layers_of_bulges(client: httpx.Client) -> None:
    mellow = built(client, upload(bins={"merge": "mellow", "depth_factored": True}))
    bins = client.get(f"/v1/assets/{mellow}/bins").json()
    assert (bins["merge"], bins["depth_factored"]) == ("mellow", True)
    assert bins["layers"] == {
        "wrinkles": 4, "pores": 1, "wrinkle_bulges": 4, "pore_bulges": 1, "grain": 1,
    }  # fmt: skip
    assert bins["steps"].keys() == bins["layers"].keys()
    path = f"/v1/assets/{mellow}/bins/1001/0/1/2"
    for layer, count in bins["layers"].items():
        query = {"bin": count - 1, "sample": len(bins["steps"][layer]) - 1, "layer": layer}
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
        ("", 422, "query", "bin is missing: layer wrinkles has 4, 0 to 3"),
        ("?bin=0", 422, "query", "sample is missing: layer wrinkles has 3, 0 to 2"),
        ("?layer=pores", 422, "query", "sample is missing: layer pores has 3, 0 to 2"),
        ("?layer=grain&sample=1", 404, "not-found", "sample 1 of layer grain: 0 to 0"),
        ("?bin=x&sample=0", 422, "query", "query parameter bin is 'x'"),
        ("?bin=0&sample=0&colour=1", 422, "query", "unknown query parameter colour"),
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


@pytest.mark.parametrize(
    ("short", "whole"),
    [
        ({"layer": "grain"}, {"layer": "grain", "bin": 0, "sample": 0}),
        ({"layer": "pores", "sample": 2}, {"layer": "pores", "bin": 0, "sample": 2}),
    ],
)
def test_of_one_bin_or_sample_none_need_be_named(
    client: httpx.Client, asset: str, short: dict[str, str | int], whole: dict[str, str | int]
) -> None:
    path = f"/v1/assets/{asset}/bins/1001/0/0/0"
    first, second = (client.get(path, params=query) for query in (short, whole))
    np.testing.assert_array_equal(array_of(first), array_of(second))
    assert first.headers["etag"] == second.headers["etag"]


def test_the_documentation_says_that_bin_and_sample_may_be_left_out(client: httpx.Client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    path = "/v1/assets/{asset}/bins/{udim}/{level}/{row}/{column}"
    query = {p["name"]: p for p in paths[path]["get"]["parameters"] if p["in"] == "query"}
    assert not any(p["required"] for p in query.values())
    assert "more than one" in query["bin"]["description"]


def test_a_coarser_level_is_not_found_and_says_why(client: httpx.Client, asset: str) -> None:
    path = f"/v1/assets/{asset}/bins/1001/1/0/0"
    response = client.get(path, params={"bin": 0, "sample": 0})
    assert "level 0 only" in is_problem(response, 404, "not-found")


def test_the_documentation_says_that_maps_have_level_0_alone(client: httpx.Client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    said = paths["/v1/assets/{asset}/bins/{udim}/{level}/{row}/{column}"]["get"]["description"]
    assert "Level 0 only" in said
