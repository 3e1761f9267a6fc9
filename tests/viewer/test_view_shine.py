"""What a package has for shine, in Chromium: passes of slopes, and roughness from their moments."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rhytid.exports.textures.shine import gloss
from viewer.looking import Look

pytestmark = pytest.mark.browser
RUN = """async ({vertex, fragments, size, given}) => {
  const { Program, Target, Textures } = await import(new URL('viewer/view/gl.js', location.href));
  const view = rhytid.face.view, gl = view.canvas.getContext('webgl2');
  const textures = new Textures(gl), names = {};
  view._heights.begin(view._pose.stretch);
  names.rhytid_heights = view._heights.draw(1001);
  names.rhytid_triangles = view._heights.triangles(1001);
  for (const [name, values] of Object.entries(given)) {
    names[name] = textures.plain('RGBA32F', values.length / 4, 1);
    const texels = Float32Array.from(values);
    textures.write(names[name], 'RGBA32F', 0, 0, values.length / 4, 1, texels);
  }
  return fragments.map((fragment) => {
    const target = new Target(gl, textures.plain('RGBA32F', ...size), ...size);
    new Program(gl, 'test', vertex, fragment).use({}, names);
    target.fill();
    const out = new Float32Array(4 * size[0] * size[1]);
    gl.readPixels(0, 0, ...size, gl.RGBA, gl.FLOAT, out);
    const bytes = new Uint8Array(out.buffer);
    let text = '';
    for (let i = 0; i < bytes.length; i += 32768)
      text += String.fromCharCode(...bytes.subarray(i, i + 32768));
    return btoa(text);
  });
}"""
HEAD = "#version 300 es\nprecision highp float;\nprecision highp sampler2D;\n"
MATERIAL = """
uniform sampler2D slopes;
uniform sampler2D products;
uniform sampler2D axes;
out vec4 found;
void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 moments = texelFetch(products, at, 0), by = texelFetch(axes, at, 0);
    RhytidShine s = rhytid_shine(texelFetch(slopes, at, 0), moments, by.xy, by.zw, 0.35);
    found = vec4(s.roughness, s.axis);
}
"""
Texels = NDArray[Any]


class Package:
    """The package that a page shows, and programs that are run on it."""

    def __init__(self, folder: Path, look: Look) -> None:
        self._folder, self._look = folder, look
        self.manifest = json.loads((folder / "manifest.json").read_text())
        self.shaders = self.manifest["shaders"]["glsl-es-300"]

    def read(self, file: str) -> str:
        return (self._folder / file).read_text()

    def run(self, fragments: list[str], side: int, rows: int, **given: Texels) -> list[Texels]:
        """(rows, side, 4) of every fragment shader.  given: textures of one row, by name."""
        values = {name: texels.ravel().tolist() for name, texels in given.items()}
        vertex = self.read(self.shaders["vertex"])
        asked = {"vertex": vertex, "fragments": fragments, "size": [side, rows], "given": values}
        texts = self._look.page.evaluate(RUN, asked)
        read = [np.frombuffer(base64.b64decode(text), "<f4") for text in texts]
        return [one.reshape(rows, side, 4).astype(float) for one in read]


@pytest.fixture(scope="module")
def shown(store: Path, package: str, open_lasting: Callable[..., Look]) -> Package:
    return Package(store.parent / "package", open_lasting(package).ready())


def test_passes_give_slopes_of_the_heights(shown: Package) -> None:
    texts = [shown.read(file) for file in shown.shaders["moments"].values()]
    # The heights themselves, and where there is skin.
    body = "vec3 slope = rhytid_slope_of(texel);"
    read = (
        texts[0]
        .replace(body, "vec2 slope = rhytid_drawn(texel);")
        .replace("vec4(slope.x, slope.y, 0.0, slope.z)", "vec4(slope.x, slope.y, 0.0, 1.0)")
    )
    slopes, products, given = shown.run([*texts, read], 512, 512)
    heights, skin = given[..., 0], given[..., 1]
    assert 0.2 < skin.mean() < 0.99

    x, y = (skin * rises(heights, skin, axis) for axis in (1, 0))
    x, y = (one * 512 / 128 / shown.manifest["scale"] for one in (x, y))
    assert np.abs(x).max() > 0.1
    np.testing.assert_allclose(slopes, np.stack([x, y, 0 * x, skin], -1), atol=1e-5)
    np.testing.assert_allclose(products, np.stack([x * x, x * y, y * y, skin], -1), atol=1e-5)


def rises(heights: Texels, skin: Texels, axis: int) -> Texels:
    """Half the differences along an axis, and whole ones where one neighbour is no skin."""
    h, there = (np.pad(np.moveaxis(one, axis, 0), ((1, 1), (0, 0))) for one in (heights, skin))
    up = there[2:] * (h[2:] - h[1:-1]) + there[:-2] * (h[1:-1] - h[:-2])
    found: Texels = np.moveaxis(up / np.maximum(there[2:] + there[:-2], 1.0), 0, axis)
    return found


def test_its_roughness_is_that_of_bake(shown: Package) -> None:
    rng, count = np.random.default_rng(4), 64
    slope_unit = 128.0 * shown.manifest["scale"]
    samples = rng.normal(size=(count, 30, 2)) @ rng.normal(size=(count, 2, 2)) * 0.3
    samples[0] = samples[0][:1]  # all alike
    by = rng.normal(scale=0.2 / slope_unit, size=(count, 2, 2))
    mine, surface = moments(samples), moments(slope_unit * samples @ by)
    share, one = rng.uniform(0.2, 1.0, (count, 1)), np.ones((count, 1))
    found = shown.run(
        [f"{HEAD}{shown.read(shown.shaders['libraries']['shine'])}{MATERIAL}"], count, 1,
        slopes=np.hstack([mine[:, :2], one, one]) * share,
        products=np.hstack([mine[:, 2:], one]) * share,
        axes=by,
    )[0][0]  # fmt: skip

    wanted = gloss(surface, 0.35)
    np.testing.assert_allclose(found[:, :2], wanted.roughness, atol=2e-4)
    clear = np.ptp(wanted.roughness, axis=-1) > 0.01
    assert clear.sum() > 30
    assert (1 - (found[:, 2:] * wanted.axis).sum(-1))[clear].max() < 1e-3


def moments(slopes: Texels) -> Texels:
    """(n, 5) of slopes (n, k, 2)."""
    x, y = np.moveaxis(slopes, -1, 0)
    return np.stack([one.mean(1) for one in (x, y, x * x, x * y, y * y)], -1)
