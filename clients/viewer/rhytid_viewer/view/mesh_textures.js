// The posed mesh on the GPU: textures of positions, normals and gradients, and static corners.

import { Textures } from './gl.js';

/** @typedef {import('./types.js').SkinPackage} SkinPackage */
/** @typedef {import('./pose.js').Pose} Pose */

const A_ROW = 1024;
const CROSSING = 1 << 30; // marks triangles that are drawn in several UDIMs, a part in each

/** How a vertex shader reads them. */
export const MESH = `
precision highp float;
precision highp int;
precision highp sampler2D;
uniform sampler2D u_positions;
uniform sampler2D u_normals;
uniform sampler2D u_gradients; // of u, of v: two texels of each triangle
uniform sampler2D u_stretch;
uniform int u_triangles_a_row;
in uint a_vertex;
in uint a_triangle;
in vec2 a_uv;
uint triangle_of() { return a_triangle & ${CROSSING - 1}u; }
bool crosses() { return a_triangle >= ${CROSSING}u; }

vec3 position_of(uint i) { return texelFetch(u_positions, ivec2(i & ${A_ROW - 1}u, i / ${A_ROW}u), 0).xyz; }
vec3 normal_of(uint i) { return texelFetch(u_normals, ivec2(i & ${A_ROW - 1}u, i / ${A_ROW}u), 0).xyz; }
vec3 gradient_of(uint t, int axis) {
  int at = 2 * int(t) + axis;
  return texelFetch(u_gradients, ivec2(at & ${A_ROW - 1}, at / ${A_ROW}), 0).xyz;
}
vec4 stretch_of(uint t, int half_) {
  int row = int(t) / u_triangles_a_row;
  return texelFetch(u_stretch, ivec2(2 * (int(t) - row * u_triangles_a_row) + half_, row), 0);
}
`;

export class MeshTextures {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Textures} textures
   * @param {SkinPackage} skinPackage
   */
  constructor(gl, textures, { mesh, manifest }) {
    this._gl = gl;
    this._textures = textures;
    this._vertices = padded(mesh.vertex.length);
    this._halves = padded(2 * manifest.stretch.triangles);
    this.positions = textures.plain('RGBA32F', A_ROW, this._vertices.length / 4 / A_ROW);
    this.normals = textures.plain('RGBA32F', A_ROW, this._vertices.length / 4 / A_ROW);
    this.gradients = textures.plain('RGBA32F', A_ROW, this._halves.length / 4 / A_ROW);
    /** UDIMs that every triangle reaches into. */
    this.udims = udimsOf(mesh, manifest.udims);
    /** Whether triangles cross borders of UDIMs. */
    this.crossing = this.udims.some((those) => those.length > 1);
    /** The corners to draw by UDIM: the first, and how many. @type {Map<number, [number, number]>} */
    this.parts = new Map();
    /** All corners. */
    this.corners = 3 * this.udims.reduce((sum, those) => sum + those.length, 0);
    this._corners = this._order(mesh, manifest.udims);
  }

  /** @param {Pose} pose */
  write(pose) {
    this._vectors(this.positions, pose.positions);
    this._vectors(this.normals, pose.normals);
    this._halves.set(pose.gradients);
    this._textures.write(this.gradients, 'RGBA32F', 0, 0, A_ROW, this._halves.length / 4 / A_ROW, this._halves);
  }

  /** Buffers of the corners, for a program. @param {import('./gl.js').Program} program */
  vertexArray(program) {
    const gl = this._gl, found = gl.createVertexArray();
    gl.bindVertexArray(found);
    for (const [name, { buffer, size }] of Object.entries(this._corners)) {
      const at = program.attribute(name);
      if (at < 0) continue;
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(at);
      if (size === 1) gl.vertexAttribIPointer(at, 1, gl.UNSIGNED_INT, 0, 0);
      else gl.vertexAttribPointer(at, size, gl.FLOAT, false, 0, 0);
    }
    gl.bindVertexArray(null);
    return found;
  }

  /** @param {WebGLTexture} texture @param {Float32Array} values */
  _vectors(texture, values) {
    const out = this._vertices;
    for (let i = 0, at = 0; i < values.length; i += 3, at += 4) {
      out[at] = values[i];
      out[at + 1] = values[i + 1];
      out[at + 2] = values[i + 2];
    }
    this._textures.write(texture, 'RGBA32F', 0, 0, A_ROW, out.length / 4 / A_ROW, out);
  }

  /** @param {import('./types.js').PackageMesh} mesh @param {number[]} udims */
  _order(mesh, udims) {
    const vertices = new Uint32Array(this.corners), triangles = new Uint32Array(this.corners);
    const uvs = new Float32Array(2 * this.corners);
    let to = 0;
    for (const udim of udims) {
      const first = to, [column, row] = origin(udim);
      this.udims.forEach((those, triangle) => {
        if (!those.includes(udim)) return;
        for (let corner = 0; corner < 3; corner++, to++) {
          const vertex = mesh.indices[3 * triangle + corner];
          vertices[to] = vertex;
          triangles[to] = those.length > 1 ? triangle | CROSSING : triangle;
          uvs[2 * to] = mesh.uvs[2 * vertex] - column;
          uvs[2 * to + 1] = mesh.uvs[2 * vertex + 1] + row;
        }
      });
      this.parts.set(udim, [first, to - first]);
    }
    return {
      a_vertex: this._buffer(vertices, 1),
      a_triangle: this._buffer(triangles, 1),
      a_uv: this._buffer(uvs, 2),
    };
  }

  /** @param {ArrayBufferView} values @param {number} size numbers of a corner */
  _buffer(values, size) {
    const gl = this._gl, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    return { buffer, size };
  }
}

/** Column and row of a UDIM. @param {number} udim */
export function origin(udim) {
  return [(udim - 1001) % 10, Math.floor((udim - 1001) / 10)];
}

/** UDIM at a place. @param {number} u @param {number} v down */
export function udimAt(u, v) {
  return 1001 + Math.floor(u) + 10 * Math.floor(1 - v);
}

/**
 * The UDIMs that every triangle reaches into by more than rounding; the first is that of its middle.
 * @param {import('./types.js').PackageMesh} mesh @param {number[]} udims that there are
 */
function udimsOf({ uvs, indices }, udims) {
  return Array.from({ length: indices.length / 3 }, (_, t) => {
    const corners = [0, 1, 2].map((corner) => 2 * indices[3 * t + corner]);
    const us = corners.map((at) => uvs[at]), vs = corners.map((at) => 1 - uvs[at + 1]);
    const middle = 1001 + Math.floor((us[0] + us[1] + us[2]) / 3) + 10 * Math.floor((vs[0] + vs[1] + vs[2]) / 3);
    const found = [middle];
    for (let row = inside(Math.min(...vs), 1); row <= inside(Math.max(...vs), -1); row++)
      for (let column = inside(Math.min(...us), 1); column <= inside(Math.max(...us), -1); column++)
        found.push(1001 + column + 10 * row);
    const there = found.filter((udim, i) => udims.includes(udim) && found.indexOf(udim) === i);
    return there.length ? there : [udims[0]];
  });
}

/** The whole part of a bound that lies a little further inside. @param {number} at @param {number} sign */
function inside(at, sign) {
  return Math.floor(at + sign * 1e-5);
}

/** Room for so many texels of four floats in whole rows. @param {number} texels */
function padded(texels) {
  return new Float32Array(4 * A_ROW * Math.ceil(texels / A_ROW));
}
