"""The shaders of the graphics peer: GLSL 4.3. Texels count upwards, as window coordinates do."""

from __future__ import annotations

RESPONSE = """
#define EPSILON 1e-6

float across(vec2 theta, vec4 axes, vec2 logs) // Alg. 1, lines 4 and 5
{
    float d1 = max(1.0 - abs(dot(theta, axes.xy)), 0.0);
    float d2 = max(1.0 - abs(dot(theta, axes.zw)), 0.0);
    return (d1 * logs.x + d2 * logs.y) / (d1 + d2 + EPSILON);
}
"""

# What every element samples, in the vertex shader: four corners per element, which costs little
# beside its texels.
STRETCH = """
layout(std430, binding = 0) readonly buffer Axes { vec4 axes[]; };
layout(std430, binding = 1) readonly buffer Logs { vec2 logs[]; };
uniform vec2 exponents; // of width and depth; 0 leaves the neutral
uniform float limit;
uniform float size;

vec2 scales_of(float r) // Alg. 1, lines 7 and 8
{
    return clamp(exp(vec2(exponents.x, -exponents.y) * r), 1.0 / limit, limit);
}

vec4 placed(vec2 at) { return vec4(2.0 * at / size - 1.0, 0.0, 1.0); }
vec2 corner() { return vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0; }
"""

WRINKLE_VERTEX = """
in vec4 segment;
in vec2 sized;
in int triangle;
flat out vec4 line;
flat out vec2 across_and_strength;

void main() // a rectangle around the segment and its round ends
{
    vec2 unit = normalize(segment.zw);
    vec2 scale = scales_of(across(unit, axes[triangle], logs[triangle]));
    float width = sized.x * scale.x;
    line = segment;
    across_and_strength = vec2(1.0 / width, sized.y * scale.y);
    vec2 side = corner(), middle = segment.xy + 0.5 * segment.zw;
    float half_length = 0.5 * length(segment.zw) + width;
    gl_Position = placed(middle + side.x * half_length * unit
                         + side.y * width * vec2(-unit.y, unit.x));
}
"""

PORE_VERTEX = """
in vec2 centre;
in vec4 root;
in int triangle;
flat out vec2 middle;
flat out vec4 form;

void main()
{
    vec2 scale = scales_of(0.5 * (logs[triangle].x + logs[triangle].y)); // Alg. 2
    vec3 r = root.xyz / scale.x;
    middle = centre;
    form = vec4(r, root.w * scale.y);
    gl_Position = placed(centre + corner() * vec2(length(r.yz) / r.x, 1.0) / r.z);
}
"""

PROFILE = """
uniform float sharpness;
uniform float bulge;
out vec2 sums; // added by blending: valleys and bulges of the mellow-max

void add_profile(float t2, float strength) // (1 - t²)²(1 - b t²)
{
    if (t2 >= 1.0)
        discard;
    float inside = 1.0 - t2;
    float height = strength * inside * inside * (1.0 - bulge * t2);
    float grown = exp(sharpness * abs(height)) - 1.0;
    sums = height > 0.0 ? vec2(grown, 0.0) : vec2(0.0, grown);
}
"""

WRINKLE_FRAGMENT = """
flat in vec4 line;
flat in vec2 across_and_strength;

void main()
{
    vec2 d = gl_FragCoord.xy - line.xy, e = line.zw;
    vec2 gap = (d - clamp(dot(d, e) / dot(e, e), 0.0, 1.0) * e) * across_and_strength.x;
    add_profile(dot(gap, gap), across_and_strength.y);
}
"""

PORE_FRAGMENT = """
flat in vec2 middle;
flat in vec4 form;

void main()
{
    vec2 d = gl_FragCoord.xy - middle;
    vec2 g = vec2(form.x * d.x + form.y * d.y, form.z * d.y);
    add_profile(dot(g, g), form.w);
}
"""

# One triangle over everything.
FULL_VERTEX = """
void main()
{
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
"""

RESOLVE_FRAGMENT = """
uniform sampler2D added;
uniform vec3 sharpness_slots_depth;
out float displacement;

void main() // section 6: depth (mm(bulges) - mm(valleys)) as one logarithm
{
    vec2 sums = 1.0 + texelFetch(added, ivec2(gl_FragCoord.xy), 0).rg / sharpness_slots_depth.y;
    displacement = log(sums.g / sums.r) * sharpness_slots_depth.z / sharpness_slots_depth.x;
}
"""

# Alg. 3, lines 6 to 10, once per triangle.
WEIGHTS_COMPUTE = """
layout(local_size_x = 64) in;
layout(std430, binding = 0) readonly buffer Axes { vec4 axes[]; };
layout(std430, binding = 1) readonly buffer Logs { vec2 logs[]; };
layout(std430, binding = 2) writeonly buffer Weights { float weights[]; };
uniform vec2 directions[LAYERS - 1];
uniform float r_max;
uniform uint count;

void main()
{
    uint t = gl_GlobalInvocationID.x;
    if (t >= count)
        return;
    for (int n = 0; n < LAYERS; n++) {
        float r = n < LAYERS - 1 ? across(directions[n], axes[t], logs[t])
                                 : 0.5 * (logs[t].x + logs[t].y);
        weights[t * LAYERS + n] = clamp(r / r_max, -1.0, 1.0) + 1.0;
    }
}
"""

# Lines 11 to 14; the three samples of a layer are one texel of its map.
BLEND_FRAGMENT = """
layout(std430, binding = 2) readonly buffer Weights { float weights[]; };
uniform isampler2D triangles;
uniform isampler2DArray codes;
uniform vec3 steps[LAYERS];
out float displacement;

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    int t = texelFetch(triangles, at, 0).r * LAYERS;
    float lowest = 1e30;
    for (int n = 0; n < LAYERS; n++) {
        float position = weights[t + n];
        vec3 heights = vec3(texelFetch(codes, ivec3(at, n), 0).rgb) * steps[n];
        float height = position < 1.0 ? mix(heights.x, heights.y, position)
                                      : mix(heights.y, heights.z, position - 1.0);
        lowest = min(lowest, height);
    }
    displacement = lowest;
}
"""


def glsl(*parts: str, **defines: object) -> str:
    """One source of the parts."""
    return "\n".join(["#version 430", *(f"#define {k} {v}" for k, v in defines.items()), *parts])
