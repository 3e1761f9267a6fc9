// Displacement of skin in a frame: Alg. 3 of "Fast Dynamic Facial Wrinkles" (Weiss, Chandran, Zoss,
// Bradley 2024) as rhytid has it, with nearest sampling. docs/package.md describes the inputs.
//
// Texels are (column, row) of a UDIM's map, row 0 at the top (v = 1). Displacement is in mesh units
// along the outward normal, furrows negative.

uniform usampler2DArray rhytid_wrinkles; // of the maps of each bin, numbers of sets
uniform sampler2DArray rhytid_wrinkle_codes; // what the sets stand for: codes of each sample
uniform sampler2DArray rhytid_maps; // codes of the other precomputed maps, R8_SNORM
uniform usampler2DArray rhytid_triangles; // the triangle of each texel
uniform sampler2D rhytid_weights; // of the frame, made by the pass weights, RGBA32F
#if CUSHION
uniform sampler2DArray rhytid_cushions; // codes of the broad layer, coarse, and places along owners
uniform usampler2DArray rhytid_cushion_owners; // the line that each sample answers by
uniform sampler2D rhytid_cushion_stretch; // of the frame, made by the pass lines, RGBA32F
uniform sampler2D rhytid_cushion; // of the frame, made by the pass cushion, R32F
#endif
#if RESIDUAL
uniform usampler2DArray rhytid_residual; // of scanned skin: what its lines and pores do not draw
#endif

// What the codes of two samples of a layer are multiplied by in a face, in units of the merge; the
// first of them; the rise of the depth over the tilts. Of the layer after the pores: how much of the
// grain and of events shows.
vec4 rhytid_weights_of(int face, int layer)
{
    int row = face / RHYTID_TRIANGLES_A_ROW;
    int column = face - row * RHYTID_TRIANGLES_A_ROW;
    return rhytid_load(rhytid_weights, ivec2(column, layer * RHYTID_ROWS + row));
}

// How the heights of layers meet (Alg. 3, line 14), in units of the merge.
#if MERGE_MIN
const vec3 RHYTID_NONE_MET = vec3(1e30, 0.0, 0.0);

vec3 rhytid_meet(vec3 met, float height)
{
    return vec3(min(met.x, height), 0.0, 0.0);
}

float rhytid_height_of(vec3 met)
{
    return met.x;
}
#elif MERGE_SOFT
// The two deepest valleys meet softly, the highest bulge is added.
const vec3 RHYTID_NONE_MET = vec3(0.0, 0.0, 0.0);

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

#if MERGE_SIGNED
// The mellow-max, valleys and bulges apart: sums of 2^x.
vec2 rhytid_mellow(vec2 met, float height)
{
    float grown = exp2(min(abs(height), 121.9)) - 1.0;
    if (height > 0.0) {
        return vec2(met.x, met.y + grown);
    }
    return vec2(met.x + grown, met.y);
}

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

// What two samples of a bin come to. number: of the set of all of them.
float rhytid_blended(sampler2DArray codes, int number, vec4 w)
{
    ivec2 at = ivec2(number % RHYTID_SETS_A_ROW, number / RHYTID_SETS_A_ROW);
    int first = int(w.z);
    return w.x * rhytid_code(codes, at, first) + w.y * rhytid_code(codes, at, first + 1);
}

#if CUSHION
// One sample of the broad layer, mesh units: of the pass cushion. at: from the first of the apron on.
float rhytid_cushion_sample(ivec2 at)
{
    int owner = rhytid_number(rhytid_cushion_owners, at, 0);
    int row = owner / RHYTID_LINES_A_ROW;
    vec4 ends = rhytid_load(rhytid_cushion_stretch, ivec2(owner - row * RHYTID_LINES_A_ROW, row));
    float along = rhytid_code(rhytid_cushions, at, RHYTID_CUSHION_SAMPLES) / 127.0;
    float r = ends.x + along * (ends.y - ends.x);
    float share = (clamp(r / RHYTID_CUSHION_LAST_SAMPLE, -1.0, 1.0) + 1.0) * 0.5;
    float place = share * float(RHYTID_CUSHION_SAMPLES - 1);
    int first = min(int(place), RHYTID_CUSHION_SAMPLES - 2);
    float next = place - float(first);
    float here = RHYTID_CUSHION_STEPS[first] * rhytid_code(rhytid_cushions, at, first);
    float other = RHYTID_CUSHION_STEPS[first + 1] * rhytid_code(rhytid_cushions, at, first + 1);
    float depth = rhytid_scale(r, -RHYTID_CUSHION_EXPONENT, RHYTID_SCALE_LIMIT);
    return depth * ((1.0 - next) * here + next * other);
}

// Weights of the four samples around t, from 0 to 1 between the two in the middle.
vec4 rhytid_spline(float t)
{
    float u = 1.0 - t;
    float second = (3.0 * t - 6.0) * t * t + 4.0;
    float third = ((3.0 - 3.0 * t) * t + 3.0) * t + 1.0;
    return vec4(u * u * u / 6.0, second / 6.0, third / 6.0, t * t * t / 6.0);
}

// The broad layer at a texel, by a uniform cubic B-spline.
float rhytid_cushion_at(ivec2 texel)
{
    float x = (float(texel.x) + 0.5) / float(RHYTID_CUSHION_FACTOR) + float(RHYTID_CUSHION_APRON) - 0.5;
    float y = (float(texel.y) + 0.5) / float(RHYTID_CUSHION_FACTOR) + float(RHYTID_CUSHION_APRON) - 0.5;
    int left = int(floor(x)) - 1;
    int top = int(floor(y)) - 1;
    vec4 across = rhytid_spline(fract(x));
    vec4 down = rhytid_spline(fract(y));
    float sum = 0.0;
    for (int row = 0; row < 4; row++) {
        for (int column = 0; column < 4; column++) {
            float found = rhytid_load(rhytid_cushion, ivec2(left + column, top + row)).x;
            sum += down[row] * across[column] * found;
        }
    }
    return sum;
}
#endif

// Displacement of a texel of level 0, mesh units.
float rhytid_height(ivec2 texel)
{
    ivec2 part = texel / RHYTID_PAGE;
    int page = part.y * RHYTID_PAGES_A_ROW + part.x;
    int base = page * RHYTID_MAPS;
    ivec2 inner = texel - part * RHYTID_PAGE;
    int face = rhytid_number(rhytid_triangles, inner, page);
    vec3 met = RHYTID_NONE_MET;
    for (int n = 0; n < RHYTID_BINS; n++) {
        vec4 w = rhytid_weights_of(face, n);
        int number = rhytid_number(rhytid_wrinkles, inner, page * RHYTID_BINS + n);
        float d = rhytid_blended(rhytid_wrinkle_codes, number, w);
#if TILT
        d += d * w.w * rhytid_code(rhytid_maps, inner, base + RHYTID_FIRST_TILT + n);
#endif
        met = rhytid_meet(met, d);
    }
    vec4 p = rhytid_weights_of(face, RHYTID_BINS);
    int pore = base + RHYTID_FIRST_PORES + int(p.z);
    float here = p.x * rhytid_code(rhytid_maps, inner, pore);
    float next = p.y * rhytid_code(rhytid_maps, inner, pore + 1);
    float height = RHYTID_UNIT * rhytid_height_of(rhytid_meet(met, here + next));
#if CUSHION
    height += rhytid_cushion_at(texel);
#endif
#if GRAIN
    vec4 gain = rhytid_weights_of(face, RHYTID_BINS + 1);
    float left = clamp(1.0 + height / RHYTID_DEPTH, 0.25, 1.0);
    float grain = rhytid_code(rhytid_maps, inner, base + RHYTID_FIRST_GRAIN);
    height += RHYTID_GRAIN_STEP * gain.x * left * grain;
#endif
#if EVENTS
    vec4 shown = rhytid_weights_of(face, RHYTID_BINS + 1);
    float coarse = rhytid_code(rhytid_maps, inner, base + RHYTID_FIRST_EVENTS);
    float fine = rhytid_code(rhytid_maps, inner, base + RHYTID_FIRST_EVENTS + 1);
    height += shown.y * (RHYTID_EVENT_STEP * coarse + RHYTID_EVENT_FINE_STEP * fine);
#endif
#if RESIDUAL
    int scanned = rhytid_number(rhytid_residual, inner, page);
    height += RHYTID_RESIDUAL_FIRST + RHYTID_RESIDUAL_STEP * float(scanned);
#endif
    return height;
}
