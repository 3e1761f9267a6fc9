// Principal axes of the stretch as short lines in the middle of triangles.

import { Program, Textures } from './gl.js';
import { spread } from './spread.js';
import { MESH, MeshTextures } from './mesh_textures.js';

const SPACING = 16; // CSS pixels between triangles with lines, at least
const VERTEX = `#version 300 es
${MESH}
uniform highp usampler2D u_corners; // of every triangle its vertices, and how far from others it stands
uniform mat4 u_matrix;
uniform vec2 u_picture;         // pixels
uniform vec3 u_eye;
uniform float u_density;        // pixels a CSS pixel
uniform float u_focal;          // pixels a mesh unit at distance 1
flat out vec3 v_colour;
out float v_across;

const vec3 STRETCHED = vec3(1.0, 0.78, 0.30), COMPRESSED = vec3(0.35, 0.85, 1.0);

vec4 seen(vec3 p) { return u_matrix * vec4(p, 1.0); }
vec2 pixel(vec4 clip) { return 0.5 * clip.xy / clip.w * u_picture; }

void main() {
  int line = gl_VertexID / 6, corner = gl_VertexID % 6;
  uint t = uint(line / 2);
  bool first = line % 2 == 0;
  uvec4 found = texelFetch(u_corners, ivec2(t & 1023u, t / 1024u), 0);
  vec3 a = position_of(found.x), b = position_of(found.y), c = position_of(found.z);
  vec3 middle = (a + b + c) / 3.0, n = cross(b - a, c - a);
  vec4 centre = seen(middle);
  float apart = uintBitsToFloat(found.w) * u_focal / max(centre.w, 1e-9);
  vec4 axes = stretch_of(t, 0);
  vec2 logs = stretch_of(t, 1).xy;
  float amount = first ? logs.x : logs.y;
  vec2 axis = first ? axes.xy : axes.zw;
  bool shown = dot(n, u_eye - middle) > 0.0 && apart > ${SPACING}.0 * u_density && abs(amount) > 0.01;
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  v_colour = vec3(0.0);
  v_across = 0.0;
  if (!shown || centre.w <= 0.0) return;
  // Along u and v (v down) on the surface: dual to their gradients.
  vec3 gu = gradient_of(t, 0), gv = gradient_of(t, 1), up = normalize(n);
  vec3 du = cross(gv, up), dv = cross(up, gu);
  vec3 along = axis.x * du / dot(du, gu) - axis.y * dv / dot(dv, gv);
  float size = length(b - a) * 0.25;
  vec4 ahead = seen(middle + size * normalize(along));
  vec2 direction = pixel(ahead) - pixel(centre);
  float shortened = length(direction) / max(length(pixel(seen(middle + size * normalize(cross(up, u_eye - middle)))) - pixel(centre)), 1e-6);
  direction = normalize(direction + vec2(1e-9));
  float half_length = u_density * min(shortened, 1.0) * mix(3.0, 11.0, clamp(abs(amount) / 0.35, 0.0, 1.0));
  vec2 corners[6] = vec2[6](vec2(-1, -1), vec2(1, -1), vec2(1, 1), vec2(-1, -1), vec2(1, 1), vec2(-1, 1));
  vec2 place = corners[corner];
  vec2 moved = pixel(centre) + place.x * half_length * direction
             + place.y * 1.6 * u_density * vec2(-direction.y, direction.x);
  v_across = place.y * 1.6;
  v_colour = amount > 0.0 ? STRETCHED : COMPRESSED;
  gl_Position = vec4(2.0 * moved / u_picture * centre.w, centre.z - 0.002 * centre.w, centre.w);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
flat in vec3 v_colour;
in float v_across;
out vec4 o_colour;
void main() { o_colour = vec4(v_colour, 1.0 - smoothstep(0.5, 1.5, abs(v_across))); }`;

export class Axes {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Textures} textures
   * @param {MeshTextures} mesh
   * @param {import('./types.js').PackageMesh} neutral
   * @param {number} radius of it around its middle
   */
  constructor(gl, textures, mesh, { positions, indices }, radius) {
    this._gl = gl;
    this._mesh = mesh;
    this._count = indices.length / 3;
    this._program = new Program(gl, 'axes', VERTEX, FRAGMENT);
    this._textures = textures;
    this._make = () => this._made(positions, indices, radius);
    /** @type {WebGLTexture | null} made when they are first drawn */
    this._corners = null;
  }

  /** @param {Float32Array} positions @param {Uint32Array} indices @param {number} radius */
  _made(positions, indices, radius) {
    const rows = Math.ceil(this._count / 1024), texels = new Uint32Array(4 * 1024 * rows);
    const apart = new Uint32Array(spread(positions, indices, radius).buffer);
    for (let t = 0; t < this._count; t++) {
      texels.set(indices.subarray(3 * t, 3 * t + 3), 4 * t);
      texels[4 * t + 3] = apart[t];
    }
    const texture = this._textures.plain('RGBA32_UINT', 1024, rows);
    this._textures.write(texture, 'RGBA32_UINT', 0, 0, 1024, rows, texels);
    return texture;
  }

  /** @param {Record<string, number | ArrayLike<number>>} uniforms @param {Record<string, WebGLTexture>} textures */
  draw(uniforms, textures) {
    const gl = this._gl, { positions, gradients } = this._mesh;
    this._corners ??= this._make();
    const all = { ...textures, u_positions: positions, u_gradients: gradients, u_corners: this._corners };
    this._program.use(uniforms, all);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.drawArrays(gl.TRIANGLES, 0, 12 * this._count);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }
}
