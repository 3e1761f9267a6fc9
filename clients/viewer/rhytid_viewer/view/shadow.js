// What the light reaches: depths seen from it.

import { Program, Target, Textures } from './gl.js';
import { MESH, MeshTextures } from './mesh_textures.js';
import { cross, lookMatrix, normalized, orthographic, product } from './vectors.js';

/** @typedef {import('./types.js').Vector} Vector */

const SIDE = 2048;
const VERTEX = `#version 300 es
${MESH}
uniform mat4 u_matrix;
void main() { gl_Position = u_matrix * vec4(position_of(a_vertex), 1.0); }`;
const FRAGMENT = `#version 300 es
void main() {}`;

export class Shadow {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {Textures} textures
   * @param {MeshTextures} mesh
   * @param {number} radius of the mesh around its middle
   */
  constructor(gl, textures, mesh, radius) {
    this._gl = gl;
    this._mesh = mesh;
    this._radius = radius;
    this.texture = textures.plain('DEPTH', SIDE, SIDE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
    this._target = new Target(gl, this.texture, SIDE, SIDE, { depth: true });
    this._program = new Program(gl, 'shadow', VERTEX, FRAGMENT);
    this._corners = mesh.vertexArray(this._program);
    this.matrix = new Float32Array(16);
    /** Of a texel, in texture coordinates. */
    this.step = 1 / SIDE;
    /** Mesh units a texel. */
    this.texel = (2 * radius) / SIDE;
  }

  /** @param {Vector} light towards it, of length 1 */
  draw(light) {
    const gl = this._gl;
    const right = normalized(cross(Math.abs(light[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0], light));
    this.matrix = product(orthographic(this._radius), lookMatrix([0, 0, 0], right, cross(light, right), light));
    this._program.use({ u_matrix: this.matrix }, { u_positions: this._mesh.positions });
    this._target.bind();
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.bindVertexArray(this._corners);
    gl.drawArrays(gl.TRIANGLES, 0, this._mesh.corners);
    gl.bindVertexArray(null);
  }
}
