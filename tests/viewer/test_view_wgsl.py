"""Chromium takes every shader of a package in WGSL. Its WebGPU runs on the processor."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from exports.skin_package.variants import whole_shaders
from rhytid.exports.skin_package.manifest import Manifest
from viewer.conftest import CHROMIUM
from viewer.looking import FLAGS

if TYPE_CHECKING:
    from playwright.sync_api import Page, Playwright

pytestmark = pytest.mark.browser
WEBGPU = ("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader")
COMPILE = """async (texts) => {
    const device = await (await navigator.gpu.requestAdapter()).requestDevice();
    device.pushErrorScope("validation");
    const said = await Promise.all(texts.map(async (code) => {
        const { messages } = await device.createShaderModule({ code }).getCompilationInfo();
        return messages.map((one) => `${one.type} in line ${one.lineNum}: ${one.message}`);
    }));
    return [said, (await device.popErrorScope())?.message ?? ""];
}"""


@pytest.fixture
def page(playwright: Playwright, package: str) -> Iterator[Page]:
    """Of a browser with WebGPU, at an address of this machine, where pages have it."""
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS, *WEBGPU])
    found = browser.new_page()
    found.goto(f"{package}manifest.json")
    yield found
    browser.close()


def test_every_shader_in_wgsl_compiles(page: Page, store: Path) -> None:
    file = store.parent / "package" / "manifest.json"
    manifest = Manifest.model_validate_json(file.read_bytes())
    of = {text: name for name, _, text in whole_shaders(manifest, "wgsl")}
    said, error = page.evaluate(COMPILE, list(of))

    assert {name: one for name, one in zip(of.values(), said, strict=True) if one} == {}
    assert error == ""
    assert {stage for _, stage, _ in whole_shaders(manifest, "wgsl")} == {"vert", "frag", "comp"}
