// The skin: relief by its slopes, lit by one light.

import { Program } from './gl.js';
import { MESH, MeshTextures } from './mesh_textures.js';
import { PARTS } from './relief.js';

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
uniform sampler2D u_relief;         // height, slopes, the share of skin
uniform sampler2D u_moments;        // products of slopes
uniform sampler2D u_neutral_relief;
uniform sampler2D u_neutral_moments;
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

// Slopes by u and v, and products of slopes that its levels have lost: uu, uv, vv.
struct Relief {
  float height;
  vec2 slope;
  vec3 lost;
};

const float PARTS = float(${PARTS});

float texels_of(float side, vec2 dx, vec2 dy) { return side * max(length(dx), length(dy)); }

Relief relief_of(sampler2D relief, vec2 uv, vec2 dx, vec2 dy) {
  float side = float(textureSize(relief, 0).x), texels = texels_of(side, dx, dy);
  vec4 found = textureGrad(relief, uv, dx, dy);
  vec2 slope = PARTS * found.yz / max(found.w, 1e-3);
  vec3 mean = vec3(slope.x * slope, slope.y * slope.y);
  if (texels < 1.0) slope = mix(side * magnified(relief, uv, side), slope, smoothstep(0.7, 1.0, texels));
  return Relief(found.x, slope, -mean);
}

Relief with_moments(Relief relief, sampler2D moments, vec2 uv, vec2 dx, vec2 dy) {
  vec4 found = textureGrad(moments, uv, dx, dy);
  vec3 lost = relief.lost + PARTS * PARTS * found.xyz / max(found.w, 1e-3);
  lost.xz = max(lost.xz, 0.0);
  float most = sqrt(lost.x * lost.z);
  lost.y = clamp(lost.y, -most, most);
  lost *= smoothstep(0.5, 1.0, texels_of(float(textureSize(moments, 0).x), dx, dy));
  return Relief(relief.height, relief.slope, lost);
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

// Microfacets of GGX whose square of alpha is a symmetric matrix in the plane of the normal: that of the
// lobe for all directions alike, and twice the covariance of the slopes that are lost.
float lobe(vec3 h, mat2 alpha2) {
  float size = determinant(alpha2), x = dot(h.xy, alpha2[0] * h.x + alpha2[1] * h.y);
  // h A^-1 h, by the trace of A: A^-1 = (trace - A) / determinant
  float d = ((alpha2[0].x + alpha2[1].y) * dot(h.xy, h.xy) - x) / size + h.z * h.z;
  return 1.0 / (PI * sqrt(size) * d * d);
}

float hidden(vec3 w, mat2 alpha2) { return sqrt(dot(w.xy, alpha2 * w.xy) + w.z * w.z); }

// Light of a lobe that comes back, over its cosine to the light. Directions are along the axes of the
// covariance and the normal.
float shine(vec3 v, vec3 l, float alpha2, mat2 covariance) {
  mat2 all = mat2(alpha2) + 2.0 * covariance;
  vec3 h = normalize(l + v);
  float nl = max(l.z, 0.0), nv = max(v.z, 0.05);
  float seen = 0.5 / (nl * hidden(vec3(v.xy, nv), all) + nv * hidden(vec3(l.xy, nl), all) + 1e-4);
  float fresnel = 0.028 + 0.972 * pow(1.0 - max(dot(v, h), 0.0), 5.0);
  return nl * seen * fresnel * lobe(vec3(h.xy, max(h.z, 0.0)), all);
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
  vec3 bend_x = dFdx(v_normal), bend_y = dFdy(v_normal);
#if CROSSING
  if (v_crosses > 0.5 && (any(lessThan(v_uv, vec2(0.0))) || any(greaterThanEqual(v_uv, vec2(1.0))))) discard;
#endif
  vec3 n = normalize(v_normal), v = normalize(u_eye - v_position);
  if (!gl_FrontFacing) {
    o_colour = vec4(srgb(vec3(0.018, 0.014, 0.013) * (0.6 + 0.4 * abs(dot(n, v)))), 1.0);
    return;
  }
  Relief relief;
  if (gl_FragCoord.x < u_split)
    relief = with_moments(relief_of(u_neutral_relief, v_uv, dx, dy), u_neutral_moments, v_uv, dx, dy);
  else {
    relief = with_moments(relief_of(u_relief, v_uv, dx, dy), u_moments, v_uv, dx, dy);
    if (u_with_tiles && texelFetch(u_present, ivec2(v_uv * vec2(textureSize(u_present, 0))), 0).r > 0u) {
      Relief exact = relief_of(u_tiles, v_uv, dx, dy);
      relief = Relief(exact.height, exact.slope, relief.lost);
    }
  }
  // The gradient on the surface, without what points off it.
  vec3 slope = u_unit * (relief.slope.x * v_along_u + relief.slope.y * v_along_v);
  slope -= dot(slope, n) * n;
  slope /= sqrt(1.0 + dot(slope, slope) / 4.0);
  vec3 bumpy = normalize(n - slope), soft = normalize(n - 0.8 * slope);
  vec3 along = v_along_u - dot(v_along_u, bumpy) * bumpy;
  along /= sqrt(max(dot(along, along), 1e-30));
  mat3 axes = mat3(along, cross(bumpy, along), bumpy);
  mat2 on_axes = u_unit * mat2((v_along_u * axes).xy, (v_along_v * axes).xy);
  mat2 covariance = on_axes * mat2(relief.lost.xy, relief.lost.yz) * transpose(on_axes);
  // What the mesh bends over a pixel, whose variance is a twelfth of its square along both sides.
  vec2 bent_x = (bend_x * axes).xy, bent_y = (bend_y * axes).xy;
  covariance += (outerProduct(bent_x, bent_x) + outerProduct(bent_y, bent_y)) / 12.0;
  covariance *= min(1.0, 0.6 / max(covariance[0].x + covariance[1].y, 1e-9));
  float smooth_cosine = dot(n, u_light);
  float lit = lit_share() * smoothstep(-0.12, 0.1, smooth_cosine);

  vec3 skin = u_colours ? stretch_colour(v_stretch) : SKIN;
  const vec3 WRAP = vec3(0.16, 0.08, 0.06);
  vec3 key = vec3(wrapped(dot(soft, u_light), WRAP).r, wrapped(dot(bumpy, u_light), WRAP).gb);
  float cavity = clamp(1.0 + u_cavity * relief.height, 0.5, 1.1);
  float half_ = 0.5 + 0.5 * dot(bumpy, u_fill);
  vec3 around = mix(GROUND, SKY, 0.5 + 0.5 * bumpy.y) + FILL * half_ * half_;
  vec3 colour = skin * (LIGHT * lit * key + cavity * around);
  vec3 to_eye = v * axes, to_light = u_light * axes;
  float gloss = 0.6 * shine(to_eye, to_light, 0.09, covariance) + 0.4 * shine(to_eye, to_light, 0.025, covariance);
  colour += (u_colours ? 0.4 : 1.0) * (SHINE * lit * gloss + 2.0 * FILL * shine(to_eye, u_fill * axes, 0.12, covariance));
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
