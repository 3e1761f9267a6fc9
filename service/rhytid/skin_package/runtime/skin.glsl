// Displacement of skin in a frame: Alg. 3 of "Fast Dynamic Facial Wrinkles" (Weiss, Chandran, Zoss,
// Bradley 2024) as rhytid has it, with nearest sampling. docs/package.md describes the inputs.
//
// Texels are (column, row) of a UDIM's map, row 0 at the top (v = 1). Displacement is in mesh units
// along the outward normal, furrows negative.

uniform sampler2DArray rhytid_maps;       // codes of the precomputed maps, R8_SNORM
uniform usampler2DArray rhytid_triangles; // the triangle of each texel
uniform sampler2D rhytid_stretch;         // of the frame: two RGBA32F texels of each triangle
#if RHYTID_CUSHION
uniform sampler2DArray rhytid_cushion_maps;
uniform usampler2DArray rhytid_cushion_triangles;
uniform sampler2D rhytid_cushion;         // of the frame, made by the pass of cushion.frag, R32F
#endif

struct RhytidStretch {
    vec2 logs; // log rho within the limit
    vec4 axes; // s1, s2: unit vectors in UV
};

// Where a layer stands: what the codes of the first and of the second of two samples are multiplied
// by, in units of the merge; the first of them; the rise of the depth over the tilts.
struct RhytidLayer {
    float before, after;
    int first;
    float rise;
};

// x within -low and high; soft by a knee.
vec2 rhytid_held(vec2 x, float low, float high)
{
#if RHYTID_SOFT_LIMITS
    x = clamp(x, -1.5 * low, 1.5 * high);
    vec2 above = max(x - 0.5 * high, 0.0), below = min(x + 0.5 * low, 0.0);
    return x - above * above / (2.0 * high) + below * below / (2.0 * low);
#else
    return clamp(x, -low, high);
#endif
}

// exp(r)^exponent within 1/RHYTID_SCALE_LIMIT and most.
float rhytid_scale(float r, float exponent, float most)
{
    const float LOG2_E = 1.44269504;
#if RHYTID_SOFT_LIMITS
    float power = rhytid_held(vec2(LOG2_E * exponent * r), log2(RHYTID_SCALE_LIMIT), log2(most)).x;
#else
    float power = clamp(LOG2_E * exponent * r, -100.0, 100.0);
#endif
    return clamp(exp2(power), 1.0 / RHYTID_SCALE_LIMIT, most);
}

RhytidStretch rhytid_stretch_of(uint triangle)
{
    int t = int(triangle);
    ivec2 at = ivec2(2 * (t % RHYTID_TRIANGLES_A_ROW), t / RHYTID_TRIANGLES_A_ROW);
    const float most = RHYTID_LOG_STRETCH_LIMIT;
    vec2 logs = clamp(texelFetch(rhytid_stretch, at + ivec2(1, 0), 0).xy, -2.0 * most, 2.0 * most);
    logs = clamp(rhytid_held(logs, most, most), -most, most);
    return RhytidStretch(logs, texelFetch(rhytid_stretch, at, 0));
}

// Alg. 1, lines 4 and 5: log stretch across wrinkles at an angle from v towards u.
float rhytid_across(float angle, RhytidStretch s)
{
    vec2 theta = vec2(sin(angle), cos(angle));
    vec2 away = vec2(dot(theta, s.axes.xy), dot(theta, s.axes.zw));
    away = max(1.0 - abs(away), 0.0);
    return dot(away, s.logs) / (away.x + away.y + 1e-6);
}

// Alg. 3, lines 7 to 10, of bin n, or of the pores.
RhytidLayer rhytid_layer(int n, RhytidStretch s)
{
    bool pores = n == RHYTID_BINS;
    int samples = pores ? RHYTID_PORE_SAMPLES : RHYTID_SAMPLES;
    float exponent = pores ? RHYTID_PORE_EXPONENT : RHYTID_EXPONENT;
    float most = pores ? RHYTID_PORE_DEPTH_LIMIT : RHYTID_SCALE_LIMIT;
    float angle = RHYTID_PI * float(n) / float(RHYTID_BINS);
    bool oriented = !pores && RHYTID_BINS > 1;
    float r = oriented ? rhytid_across(angle, s) : 0.5 * (s.logs.x + s.logs.y);
    float depth = rhytid_scale(r, -exponent, most), rise = 0.0;
#if RHYTID_TILT
    if (oriented) {
        float half_bin = 0.5 * RHYTID_PI / float(RHYTID_BINS);
        float turn = RHYTID_TILT_NODE * half_bin;
        float low = rhytid_scale(rhytid_across(angle - turn, s), -exponent, most);
        float high = rhytid_scale(rhytid_across(angle + turn, s), -exponent, most);
        depth = 0.5 * (low + high);
        float bound = min(1.0, most / depth - 1.0);
        rise = clamp((high - low) / (2.0 * RHYTID_TILT_NODE * depth), -bound, bound) * RHYTID_TILT_STEP;
    }
#endif
    float at = (clamp(r / RHYTID_LAST_SAMPLE, -1.0, 1.0) + 1.0) * 0.5 * float(samples - 1);
    int first = min(int(at), samples - 2);
    float share = at - float(first);
    return RhytidLayer((1.0 - share) * depth, share * depth, first, rise);
}

float rhytid_step(int n, int sample_)
{
    return n == RHYTID_BINS ? RHYTID_PORE_STEPS[sample_] : RHYTID_STEPS[sample_];
}

// How the heights of layers meet (Alg. 3, line 14), in units of the merge.
#if RHYTID_MERGE_MIN
const vec3 RHYTID_NONE_MET = vec3(1e30, 0.0, 0.0);

vec3 rhytid_meet(vec3 met, float height)
{
    return vec3(min(met.x, height), 0.0, 0.0);
}

float rhytid_height_of(vec3 met)
{
    return met.x;
}
#elif RHYTID_MERGE_SOFT // the two deepest valleys meet softly, the highest bulge is added
const vec3 RHYTID_NONE_MET = vec3(0.0);

vec3 rhytid_meet(vec3 met, float height)
{
    return vec3(min(met.x, height), min(met.y, max(met.x, height)), max(met.z, height));
}

float rhytid_height_of(vec3 met)
{
    float near = max(1.0 - (met.y - met.x), 0.0);
    return met.z + met.x + max(met.y, -0.25 * near * near);
}
#endif

// The mellow-max, valleys and bulges apart: sums of 2^x.
vec2 rhytid_mellow(vec2 met, float height)
{
    float grown = exp2(min(abs(height), 121.9)) - 1.0;
    return met + (height > 0.0 ? vec2(0.0, grown) : vec2(grown, 0.0));
}

#if RHYTID_MERGE_SIGNED
const vec3 RHYTID_NONE_MET = vec3(1.0, 1.0, 0.0);

vec3 rhytid_meet(vec3 met, float height)
{
    return vec3(rhytid_mellow(met.xy, height), 0.0);
}

float rhytid_height_of(vec3 met)
{
    return log2(met.y / met.x);
}
#endif

float rhytid_code(sampler2DArray maps, ivec3 at)
{
    return 127.0 * texelFetch(maps, at, 0).r;
}

#if RHYTID_CUSHION
// One sample of the broad layer, mesh units: of the pass of cushion.frag. at: from the first of the
// apron on.
float rhytid_cushion_sample(ivec2 at)
{
    RhytidStretch s = rhytid_stretch_of(texelFetch(rhytid_cushion_triangles, ivec3(at, 0), 0).r);
    vec2 met = vec2(1.0);
    for (int n = 0; n < RHYTID_BINS; n++) {
        RhytidLayer w = rhytid_layer(n, s);
        int map = n * RHYTID_SAMPLES + w.first;
        float d = w.before * RHYTID_CUSHION_STEPS[w.first] *
                      rhytid_code(rhytid_cushion_maps, ivec3(at, map)) +
                  w.after * RHYTID_CUSHION_STEPS[w.first + 1] *
                      rhytid_code(rhytid_cushion_maps, ivec3(at, map + 1));
        met = rhytid_mellow(met, d / RHYTID_CUSHION_UNIT);
    }
    return RHYTID_CUSHION_UNIT * log2(met.y / met.x);
}

// Weights of the four samples around t, from 0 to 1 between the two in the middle.
vec4 rhytid_spline(float t)
{
    float u = 1.0 - t;
    return vec4(u * u * u, (3.0 * t - 6.0) * t * t + 4.0, ((3.0 - 3.0 * t) * t + 3.0) * t + 1.0,
                t * t * t) / 6.0;
}

// The broad layer at a texel, by a uniform cubic B-spline.
float rhytid_cushion_at(ivec2 texel)
{
    vec2 at = (vec2(texel) + 0.5) / float(RHYTID_CUSHION_FACTOR) + float(RHYTID_CUSHION_APRON) - 0.5;
    ivec2 first = ivec2(floor(at)) - 1;
    vec4 x = rhytid_spline(fract(at.x)), y = rhytid_spline(fract(at.y));
    float sum = 0.0;
    for (int row = 0; row < 4; row++)
        for (int column = 0; column < 4; column++)
            sum += y[row] * x[column] *
                   texelFetch(rhytid_cushion, first + ivec2(column, row), 0).r;
    return sum;
}
#endif

// Displacement of a texel of level 0, mesh units.
float rhytid_height(ivec2 texel)
{
    ivec2 part = texel / RHYTID_PAGE;
    int page = part.y * RHYTID_PAGES_A_ROW + part.x, base = page * RHYTID_MAPS;
    ivec2 inner = texel - part * RHYTID_PAGE;
    RhytidStretch s = rhytid_stretch_of(texelFetch(rhytid_triangles, ivec3(inner, page), 0).r);
    vec3 met = RHYTID_NONE_MET;
    for (int n = 0; n <= RHYTID_BINS; n++) {
        RhytidLayer w = rhytid_layer(n, s);
        int map = base + n * RHYTID_SAMPLES + w.first;
        float d = w.before * rhytid_step(n, w.first) * rhytid_code(rhytid_maps, ivec3(inner, map)) +
                  w.after * rhytid_step(n, w.first + 1) *
                      rhytid_code(rhytid_maps, ivec3(inner, map + 1));
#if RHYTID_TILT
        if (n < RHYTID_BINS)
            d += d * w.rise * rhytid_code(rhytid_maps, ivec3(inner, base + RHYTID_FIRST_TILT + n));
#endif
        met = rhytid_meet(met, d / RHYTID_UNIT);
    }
    float height = RHYTID_UNIT * rhytid_height_of(met);
#if RHYTID_CUSHION
    height += rhytid_cushion_at(texel);
#endif
#if RHYTID_GRAIN
    float gain = 0.5 * (rhytid_scale(s.logs.x, -RHYTID_GRAIN_EXPONENT, RHYTID_SCALE_LIMIT) +
                        rhytid_scale(s.logs.y, -RHYTID_GRAIN_EXPONENT, RHYTID_SCALE_LIMIT));
    float left = clamp(1.0 + height / RHYTID_DEPTH, 0.25, 1.0);
    height += RHYTID_GRAIN_STEP * gain * left *
              rhytid_code(rhytid_maps, ivec3(inner, base + RHYTID_FIRST_GRAIN));
#endif
    return height;
}
