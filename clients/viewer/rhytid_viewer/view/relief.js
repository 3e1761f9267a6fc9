// Slopes of heights, with levels, as the surface is shaded by them.

import { Program, Target, Textures } from './gl.js';

/** @typedef {import('./types.js').Manifest} Manifest */

// Where charts have fewer texels around them, slopes must not read beyond.
const ENOUGH_PADDING = 4;

const FILL = `#version 300 es
void main() {
  vec2 corner = vec2(float((gl_VertexID << 1) & 2), float(gl_VertexID & 2));
  gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}`;

// Heights over the largest one that is possible; their slopes by column and row, over a texel, those of
// the cubic B-spline through them; the square of the slope, whose mean over a coarser texel is what its
// own slope has lost.
const SLOPES = `precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
precision highp usampler2DArray;
uniform sampler2D u_heights;
uniform usampler2DArray u_triangles;
uniform usampler2D u_present;
uniform int u_none;     // the triangle of texels in none; -1: all may be read
uniform int u_page;     // texels a side of a page of u_triangles
uniform int u_pages;    // pages a row
uniform int u_cell;     // texels a side of a cell of u_present; 0: all are there
uniform float u_unit;
out vec4 o_relief;

#if GUARDED
bool readable(ivec2 at) {
  if (u_cell > 0 && texelFetch(u_present, at / u_cell, 0).r == 0u) return false;
  if (u_none < 0) return true;
  ivec2 page = at / u_page;
  ivec3 place = ivec3(at - page * u_page, page.y * u_pages + page.x);
  return texelFetch(u_triangles, place, 0).r != uint(u_none);
}

float height(ivec2 at, float otherwise) {
  at = clamp(at, ivec2(0), textureSize(u_heights, 0) - 1);
  return readable(at) ? texelFetch(u_heights, at, 0).r : otherwise;
}

// Of a texel that must not be read: the mean of those around it that may be.
float middle(ivec2 at) {
  if (readable(at)) return texelFetch(u_heights, at, 0).r;
  vec2 sum = vec2(0.0);
  for (int i = 0; i < 25; i++) {
    ivec2 other = at + ivec2(i % 5 - 2, i / 5 - 2);
    if (all(greaterThanEqual(other, ivec2(0))) && all(lessThan(other, textureSize(u_heights, 0))) && readable(other))
      sum += vec2(texelFetch(u_heights, other, 0).r, 1.0);
  }
  return sum.y > 0.0 ? sum.x / sum.y : 0.0;
}
#else
float height(ivec2 at, float otherwise) {
  return texelFetch(u_heights, clamp(at, ivec2(0), textureSize(u_heights, 0) - 1), 0).r;
}
float middle(ivec2 at) { return texelFetch(u_heights, at, 0).r; }
#endif

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float h = middle(at);
  #define H(x, y) height(at + ivec2(x, y), h)
  float a = H(-1, -1), b = H(1, -1), c = H(-1, 1), d = H(1, 1);
  vec2 slope = vec2(b - a + 4.0 * (H(1, 0) - H(-1, 0)) + d - c, c - a + 4.0 * (H(0, 1) - H(0, -1)) + d - b) / 12.0;
  slope /= u_unit;
  o_relief = vec4(h / u_unit, slope, dot(slope, slope));
}`;

export class Slopes {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Textures} textures
   * @param {Manifest} manifest
   */
  constructor(gl, textures, manifest) {
    this._gl = gl;
    this._textures = textures;
    /** @param {boolean} guarded whether some texels must not be read */
    const program = (guarded) =>
      new Program(gl, 'slopes', FILL, `#version 300 es\n#define GUARDED ${Number(guarded)}\n${SLOPES}`);
    this._guarded = program(true);
    // Every sampler needs a texture of its kind, read or not.
    this._nothing = textures.plain('R8_UINT', 1, 1);
    this._noTriangles = textures.array({
      format: 'R16_UINT', width: 1, height: 1, layers: 1, texels: new Uint16Array(1),
    });
    const padding = Number(manifest.settings.padding ?? 0);
    const guarded = padding < ENOUGH_PADDING;
    this._program = guarded ? this._guarded : program(false);
    this._uniforms = {
      u_none: guarded ? manifest.stretch.triangles : -1,
      u_page: manifest.triangles.size,
      u_pages: manifest.triangles.pages_a_row,
      u_unit: manifest.scale,
      u_cell: 0,
    };
  }

  /** Room for the slopes of a map. @param {number} side */
  room(side) {
    return new Target(this._gl, this._textures.filtered('RGBA16F', side), side, side);
  }

  /**
   * Fill a target of `room`, and its levels.
   * @param {Target} target
   * @param {WebGLTexture} heights
   * @param {WebGLTexture} triangles of the UDIM
   * @param {number[][]} [parts] where not all is to be filled
   */
  draw(target, heights, triangles, parts) {
    this._program.use(this._uniforms, {
      u_heights: heights,
      u_triangles: triangles,
      u_present: this._nothing,
    });
    this._finish(target, parts);
  }

  /**
   * The same of tiles, which lie in cells that are there or are not.
   * @param {Target} target
   * @param {WebGLTexture} heights
   * @param {WebGLTexture} present
   * @param {number} cell texels a side
   * @param {number[][]} parts to be filled
   */
  drawTiles(target, heights, present, cell, parts) {
    const uniforms = { ...this._uniforms, u_none: -1, u_cell: cell };
    this._guarded.use(uniforms, {
      u_heights: heights,
      u_triangles: this._noTriangles,
      u_present: present,
    });
    this._finish(target, parts);
  }

  /** @param {Target} target @param {number[][]} [parts] */
  _finish(target, parts) {
    const gl = this._gl;
    target.fill(parts);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, target.texture);
    gl.generateMipmap(gl.TEXTURE_2D);
  }
}
