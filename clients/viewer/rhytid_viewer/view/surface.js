// The skin: relief by its slopes, lit by one light.

import { Program } from './gl.js';
import { MESH, MeshTextures } from './mesh_textures.js';

const VERTEX = `#version 300 es
${MESH}
uniform mat4 u_matrix;
uniform mat4 u_shadow_matrix;
uniform float u_shadow_offset;
uniform vec3 u_light;
out vec3 v_position;
out vec3 v_normal;
out vec3 v_shadow;
out vec2 v_uv;
flat out vec3 v_along_u;
flat out vec3 v_along_v;
flat out float v_stretch;
flat out float v_crosses;

void main() {
  vec3 p = position_of(a_vertex), n = normal_of(a_vertex);
  v_position = p;
  v_normal = n;
  v_uv = a_uv;
  v_crosses = float(crosses());
  v_along_u = gradient_of(triangle_of(), 0);
  v_along_v = gradient_of(triangle_of(), 1);
  vec4 logs = stretch_of(triangle_of(), 1);
  v_stretch = 0.5 * (logs.x + logs.y);
  float away = sqrt(max(1.0 - dot(n, u_light) * dot(n, u_light), 0.0));
  v_shadow = 0.5 + 0.5 * (u_shadow_matrix * vec4(p + u_shadow_offset * (0.5 + away) * n, 1.0)).xyz;
  gl_Position = u_matrix * vec4(p, 1.0);
}`;

/** Colours of log stretch from -RANGE to RANGE: compressed, as it was, stretched. Linear. */
export const STRETCH_RANGE = 0.35;
export const STRETCH_COLOURS = [
  [0.012, 0.08, 0.36],
  [0.1, 0.36, 0.68],
  [0.72, 0.7, 0.66],
  [0.78, 0.25, 0.08],
  [0.36, 0.015, 0.02],
];

const FRAGMENT = `precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DShadow;
precision highp usampler2D;
uniform sampler2D u_relief;         // height, slopes, square of the slope
uniform sampler2D u_neutral_relief;
uniform sampler2D u_tiles;          // as u_relief, of one level
uniform usampler2D u_present;       // 1 where a tile is there
uniform bool u_with_tiles;
uniform float u_split;              // pixels from the left with neutral skin
uniform sampler2DShadow u_shadow;
uniform float u_shadow_spread;
uniform float u_unit;               // of relief, mesh units, with the strength
uniform vec3 u_light;
uniform vec3 u_fill;                // towards a weak light from the other side
uniform vec3 u_eye;
uniform bool u_colours;
uniform float u_cavity;             // how much darker it is at the largest displacement
in vec3 v_position;
in vec3 v_normal;
in vec3 v_shadow;
in vec2 v_uv;
flat in vec3 v_along_u;
flat in vec3 v_along_v;
flat in float v_stretch;
flat in float v_crosses;
out vec4 o_colour;

const float PI = 3.14159265;
const vec3 SKIN = vec3(0.51, 0.37, 0.315);
const vec3 LIGHT = vec3(1.04, 1.0, 0.96); // what white that faces it sends back
const vec3 SHINE = 3.4 * vec3(0.96, 1.0, 1.04);
const vec3 FILL = vec3(0.18, 0.188, 0.203);
const vec3 SKY = vec3(0.16, 0.168, 0.18);
const vec3 GROUND = vec3(0.075, 0.066, 0.06);

// Slopes over a texel, by a cubic B-spline through the heights: two taps of the filter beside each other
// are a pair of samples, weighted.
vec2 magnified(sampler2D relief, vec2 uv, float side) {

  vec2 at = uv * side - 0.5, f = fract(at), first = floor(at) + 0.5;
  vec2 u = 1.0 - f;
  vec2 w0 = u * u * u / 6.0, w1 = ((3.0 * f - 6.0) * f * f + 4.0) / 6.0;
  vec2 w3 = f * f * f / 6.0, w2 = 1.0 - w0 - w1 - w3;
  vec2 d0 = -0.5 * u * u, d3 = 0.5 * f * f, d1 = (1.5 * f - 2.0) * f;
  vec2 low = w0 + w1, high = w2 + w3;
  vec2 fallen = d0 + d1;
  vec2 p0 = first - 1.0 + w1 / low, p1 = first + 1.0 + w3 / high;
  vec2 q0 = first - 1.0 + d1 / fallen, q1 = first + 1.0 + d3 / -fallen;
  p0 /= side; p1 /= side; q0 /= side; q1 /= side;
  #define H(x, y) textureLod(relief, vec2(x, y), 0.0).r
  return vec2(fallen.x * (low.y * (H(q0.x, p0.y) - H(q1.x, p0.y)) + high.y * (H(q0.x, p1.y) - H(q1.x, p1.y))),
              fallen.y * (low.x * (H(p0.x, q0.y) - H(p0.x, q1.y)) + high.x * (H(p1.x, q0.y) - H(p1.x, q1.y))));
}

// Of a map: height, the slopes by u and v, and the square of slope that its levels have lost.
vec4 relief_of(sampler2D relief, vec2 uv, vec2 dx, vec2 dy) {
  float side = float(textureSize(relief, 0).x);
  vec4 found = textureGrad(relief, uv, dx, dy);
  float lost = max(found.w - dot(found.yz, found.yz), 0.0);
  float texels = side * max(length(dx), length(dy));
  if (texels < 1.0) {
    found.yz = mix(magnified(relief, uv, side), found.yz, smoothstep(0.7, 1.0, texels));
    lost *= smoothstep(0.5, 1.0, texels);
  }
  return vec4(found.x, found.yz * side, lost * side * side);
}

float lit_share() {
  if (any(lessThan(v_shadow, vec3(0.0))) || any(greaterThan(v_shadow, vec3(1.0)))) return 1.0;
  float sum = 0.0;
  for (int i = 0; i < 9; i++) {
    vec2 away = u_shadow_spread * vec2(i % 3 - 1, i / 3 - 1);
    sum += texture(u_shadow, v_shadow + vec3(away, 0.0));
  }
  return sum / 9.0;
}

float lobe(float nh, float alpha2) {
  float d = nh * nh * (alpha2 - 1.0) + 1.0;
  return alpha2 / (PI * d * d);
}

// Light of a lobe of microfacets that comes back, over its cosine to the light.
float shine(vec3 n, vec3 v, vec3 l, float alpha2) {
  vec3 h = normalize(l + v);
  float nl = max(dot(n, l), 0.0), nv = max(dot(n, v), 0.05);
  float seen = 0.5 / (nl * sqrt(nv * nv * (1.0 - alpha2) + alpha2) + nv * sqrt(nl * nl * (1.0 - alpha2) + alpha2) + 1e-4);
  float fresnel = 0.028 + 0.972 * pow(1.0 - max(dot(v, h), 0.0), 5.0);
  return nl * seen * fresnel * lobe(max(dot(n, h), 0.0), alpha2);
}

vec3 wrapped(float cosine, vec3 wrap) {
  vec3 found = max((cosine + wrap) / (1.0 + wrap), 0.0);
  return found * mix(found, vec3(1.0), 0.75);
}

vec3 stretch_colour(float x) {
  vec3 colours[5] = vec3[5](${STRETCH_COLOURS.map((c) => `vec3(${c.map((x) => x.toFixed(3)).join(', ')})`).join(', ')});
  float at = clamp(2.0 + 2.0 * x / ${STRETCH_RANGE.toFixed(3)}, 0.0, 3.999);
  int first = int(at);
  return mix(colours[first], colours[first + 1], at - float(first));
}

// Whites end softly and keep their hue.
vec3 srgb(vec3 x) {
  float most = max(x.r, max(x.g, x.b));
  x *= most > 0.7 ? (0.7 + 0.3 * (1.0 - exp((0.7 - most) / 0.3))) / most : 1.0;
  return mix(12.92 * x, 1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, x));
}

void main() {
  vec2 dx = dFdx(v_uv), dy = dFdy(v_uv);
#if CROSSING
  if (v_crosses > 0.5 && (any(lessThan(v_uv, vec2(0.0))) || any(greaterThanEqual(v_uv, vec2(1.0))))) discard;
#endif
  vec3 n = normalize(v_normal), v = normalize(u_eye - v_position);
  if (!gl_FrontFacing) {
    o_colour = vec4(srgb(vec3(0.018, 0.014, 0.013) * (0.6 + 0.4 * abs(dot(n, v)))), 1.0);
    return;
  }
  vec4 relief;
  if (gl_FragCoord.x < u_split) relief = relief_of(u_neutral_relief, v_uv, dx, dy);
  else {
    relief = relief_of(u_relief, v_uv, dx, dy);
    if (u_with_tiles && texelFetch(u_present, ivec2(v_uv * vec2(textureSize(u_present, 0))), 0).r > 0u)
      relief.xyz = relief_of(u_tiles, v_uv, dx, dy).xyz;
  }
  // The gradient on the surface, without what points off it.
  vec3 slope = u_unit * (relief.y * v_along_u + relief.z * v_along_v);
  slope -= dot(slope, n) * n;
  slope /= sqrt(1.0 + dot(slope, slope) / 4.0);
  float rough = 0.5 * u_unit * u_unit * relief.w * 0.5 * (dot(v_along_u, v_along_u) + dot(v_along_v, v_along_v));
  rough = min(rough, 0.3);
  vec3 bumpy = normalize(n - slope), soft = normalize(n - 0.8 * slope);
  float smooth_cosine = dot(n, u_light);
  float lit = lit_share() * smoothstep(-0.12, 0.1, smooth_cosine);

  vec3 skin = u_colours ? stretch_colour(v_stretch) : SKIN;
  const vec3 WRAP = vec3(0.16, 0.08, 0.06);
  vec3 key = vec3(wrapped(dot(soft, u_light), WRAP).r, wrapped(dot(bumpy, u_light), WRAP).gb);
  float cavity = clamp(1.0 + u_cavity * relief.x, 0.5, 1.1);
  float half_ = 0.5 + 0.5 * dot(bumpy, u_fill);
  vec3 around = mix(GROUND, SKY, 0.5 + 0.5 * bumpy.y) + FILL * half_ * half_;
  vec3 colour = skin * (LIGHT * lit * key + cavity * around);
  float gloss = 0.6 * shine(bumpy, v, u_light, 0.09 + 2.0 * rough) + 0.4 * shine(bumpy, v, u_light, 0.025 + 2.0 * rough);
  colour += (u_colours ? 0.4 : 1.0) * (SHINE * lit * gloss + 2.0 * FILL * shine(bumpy, v, u_fill, 0.12 + 2.0 * rough));
  float grazing = pow(1.0 - max(dot(bumpy, v), 0.0), 5.0);
  colour += cavity * (0.02 + 0.25 * grazing) * SKY;
  o_colour = vec4(srgb(colour), 1.0);
}`;

export class Surface {
  /** @param {WebGL2RenderingContext} gl @param {MeshTextures} mesh */
  constructor(gl, mesh) {
    this._gl = gl;
    this._mesh = mesh;
    this._program = new Program(gl, 'surface', VERTEX, `#version 300 es\n#define CROSSING ${Number(mesh.crossing)}\n${FRAGMENT}`);
    this._corners = mesh.vertexArray(this._program);
  }

  /**
   * Draw the triangles of a UDIM.
   * @param {number} udim
   * @param {Record<string, number | ArrayLike<number>>} uniforms
   * @param {Record<string, WebGLTexture>} textures
   */
  draw(udim, uniforms, textures) {
    const gl = this._gl, [first, count] = this._mesh.parts.get(udim) ?? [0, 0];
    const { positions, normals, gradients } = this._mesh;
    this._program.use(uniforms, { ...textures, u_positions: positions, u_normals: normals, u_gradients: gradients });
    gl.bindVertexArray(this._corners);
    gl.enable(gl.CULL_FACE);
    gl.cullFace(gl.BACK);
    gl.drawArrays(gl.TRIANGLES, first, count);
    // Backs a little further away: they must not shine through where the surface turns from the eye.
    gl.cullFace(gl.FRONT);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 64);
    gl.drawArrays(gl.TRIANGLES, first, count);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.disable(gl.CULL_FACE);
    gl.bindVertexArray(null);
  }
}
