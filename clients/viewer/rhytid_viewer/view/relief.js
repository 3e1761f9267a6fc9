// Slopes of heights, with levels, as the surface is shaded by them.

import { Program, Target, Textures } from './gl.js';

/** @typedef {import('./types.js').Manifest} Manifest */

// Where charts have fewer texels around them, slopes must not read beyond.
const ENOUGH_PADDING = 4;
/** Slopes are over such a part of the map. */
export const PARTS = 128;

const FILL = `#version 300 es
void main() {
  vec2 corner = vec2(float((gl_VertexID << 1) & 2), float(gl_VertexID & 2));
  gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}`;

// Heights over the largest one that is possible; slopes by column and row, half the difference of both
// neighbours or the whole one to that which may be read; and their products. Slopes are rises over a
// part of 1 / PARTS of the map, of any level, so that half floats have them well. Where there is no skin
// slopes and products are 0, and so is the last number: levels have means over all texels, which
// are divided by its mean (Olano and Baker 2010, "LEAN mapping", with weights).
const SLOPES = `precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
precision highp usampler2DArray;
uniform sampler2D u_heights;
uniform usampler2DArray u_triangles;
uniform usampler2D u_present;
uniform int u_none;     // the triangle of texels in none; -1: all have skin
uniform int u_page;     // texels a side of a page of u_triangles
uniform int u_pages;    // pages a row
uniform int u_cell;     // texels a side of a cell of u_present; 0: all are there
uniform float u_unit;
layout(location = 0) out vec4 o_relief;
layout(location = 1) out vec4 o_moments;

bool skin(ivec2 at) {
  if (u_cell > 0 && texelFetch(u_present, at / u_cell, 0).r == 0u) return false;
  if (u_none < 0) return true;
  ivec2 page = at / u_page;
  ivec3 place = ivec3(at - page * u_page, page.y * u_pages + page.x);
  return texelFetch(u_triangles, place, 0).r != uint(u_none);
}

bool readable(ivec2 at) {
  if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, textureSize(u_heights, 0)))) return false;
  return GUARDED == 0 || skin(at);
}

// Of a texel that must not be read: the mean of those around it that may be.
float middle(ivec2 at) {
  if (readable(at)) return texelFetch(u_heights, at, 0).r;
  vec2 sum = vec2(0.0);
  for (int i = 0; i < 25; i++) {
    ivec2 other = at + ivec2(i % 5 - 2, i / 5 - 2);
    if (readable(other)) sum += vec2(texelFetch(u_heights, other, 0).r, 1.0);
  }
  return sum.y > 0.0 ? sum.x / sum.y : 0.0;
}

float rise(ivec2 at, ivec2 way, float h) {
  vec2 sum = vec2(0.0);
  if (readable(at + way)) sum += vec2(texelFetch(u_heights, at + way, 0).r - h, 1.0);
  if (readable(at - way)) sum += vec2(h - texelFetch(u_heights, at - way, 0).r, 1.0);
  return sum.x / max(sum.y, 1.0);
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float h = middle(at), weight = float(skin(at));
  vec2 slope = vec2(rise(at, ivec2(1, 0), h), rise(at, ivec2(0, 1), h));
  slope *= weight * float(textureSize(u_heights, 0).x) / (float(${PARTS}) * u_unit);
  o_relief = vec4(h / u_unit, slope, weight);
  o_moments = vec4(slope.x * slope, slope.y * slope.y, weight);
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
      u_none: manifest.stretch.triangles,
      u_page: manifest.triangles.size,
      u_pages: manifest.triangles.pages_a_row,
      u_unit: manifest.scale,
      u_cell: 0,
    };
  }

  /** Room for heights and slopes of a map. @param {number} side @param {boolean} [products] for those of slopes, too */
  room(side, products = false) {
    const beside = products ? [this._textures.filtered('RGBA16F', side)] : [];
    return new Target(this._gl, this._textures.filtered('RGBA16F', side), side, side, { beside });
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
    for (const texture of [target.texture, ...target.beside]) {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.generateMipmap(gl.TEXTURE_2D);
    }
  }

  /**
   * Mean slopes by column and row and the means of their products, five of every texel of a level: mesh
   * units over the side of the map; 0 where there is no skin.
   * @param {Target} target of `room` with products
   * @param {number} level
   */
  read(target, level) {
    const side = target.width >> level, out = new Float32Array(5 * side * side);
    const [relief, products] = [target.texture, ...target.beside].map((texture) => this._level(texture, level, side));
    const unit = PARTS * this._uniforms.u_unit;
    for (let i = 0; i < side * side; i++) {
      const weight = relief[4 * i + 3];
      if (weight === 0) continue;
      for (let k = 0; k < 2; k++) out[5 * i + k] = (unit * relief[4 * i + 1 + k]) / weight;
      for (let k = 0; k < 3; k++) out[5 * i + 2 + k] = (unit * unit * products[4 * i + k]) / weight;
    }
    return out;
  }

  /** @param {WebGLTexture} texture @param {number} level @param {number} side */
  _level(texture, level, side) {
    const gl = this._gl, held = gl.createFramebuffer(), out = new Float32Array(4 * side * side);
    gl.bindFramebuffer(gl.FRAMEBUFFER, held);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, level);
    gl.readPixels(0, 0, side, side, gl.RGBA, gl.FLOAT, out);
    gl.deleteFramebuffer(held);
    return out;
  }
}
