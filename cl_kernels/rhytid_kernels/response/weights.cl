// Where between the precomputed samples each triangle stands (Alg. 3, lines 6 to 10). With nearest
// sampling Alg. 3 up to its line 10 is the same for every texel of a triangle, so it runs here once.
#include "response.clh"
#include "samples.clh"

// r of layer n in triangle t: one layer for each orientation bin, the last for the pores. Those from
// ORIENTED on take the mean of both axes: the pores, and a single bin. directions: theta of each bin.
// jacobians: NULL for angles in UV.
inline float layer_stretch(int n, int t, __global const float4 *axes, __global const float2 *logs,
                           __global const float4 *jacobians, __global const float2 *directions)
{
    return n < ORIENTED ? log_stretch_in(t, directions[n], axes, logs, jacobians)
                        : mean_log_stretch(logs[t]);
}

#if TILT
// sigma_d over the angles of bin n, as the line through two of them: its middle, and its rise to the
// largest code of a tilt, over the middle. It stays within 0 and SCALE_LIMIT.
inline float2 tilted_depth(int n, int t, __global const float4 *axes, __global const float2 *logs,
                           __global const float4 *jacobians, __global const float2 *directions,
                           float exponent)
{
    float before = layer_stretch(n, t, axes, logs, jacobians, directions + ORIENTED);
    float after = layer_stretch(n, t, axes, logs, jacobians, directions + 2 * ORIENTED);
    float low = SCALE(power, before, -exponent, SCALE_LIMIT);
    float high = SCALE(power, after, -exponent, SCALE_LIMIT);
    float middle = 0.5f * (low + high), rise = (high - low) / (2.0f * TILT_NODE * middle);
    float most = min(1.0f, SCALE_LIMIT / middle - 1.0f);
    return (float2)(middle, clamp(rise, -most, most) / CODE_LIMIT);
}
#endif

// Algorithm 3, lines 6 to 10, for every layer of a triangle.
// weights: LAYERS per triangle: its position, from 0 (full compression) to SAMPLES_OF - 1 (full
// stretch); what the depth is scaled by: 1, or for maps without their depth scale sigma_d of the
// stretch before it is clamped to r_max; with TILT, as a line over the tilts, its rise; 0.
// directions: then also those TILT_NODE half bins before and after each. r_max: of the last sample.
// exponents: of the depth of wrinkles and of pores, where 0 gives 1, and the limits of both depths.
__kernel void sample_weights(__global const float4 *axes, __global const float2 *logs,
                             __global const float4 *jacobians,
                             __global const float2 *directions, float r_max, float4 exponents,
                             __global float4 *weights)
{
    int t = get_global_id(0);
    for (int n = 0; n < LAYERS; n++) {
        float r = layer_stretch(n, t, axes, logs, jacobians, directions);
        float2 depth_of = n < LAYERS - 1 ? exponents.xz : exponents.yw;
        float position = (clamp(r / r_max, -1.0f, 1.0f) + 1.0f) * (0.5f * (SAMPLES_OF(n) - 1));
        float2 depth = (float2)(SCALE(power, r, -depth_of.x, depth_of.y), 0.0f);
#if TILT
        if (n < ORIENTED)
            depth = tilted_depth(n, t, axes, logs, jacobians, directions, depth_of.x);
#endif
        weights[t * LAYERS + n] = (float4)(position, depth, 0.0f);
    }
}

// From weights to what blend.cl multiplies by, in place: of the first and of the second of the two
// samples around the position, in units of the merge for a code; the first of them; the rise.
// steps: displacement of a code, LAYERS x MOST_SAMPLES. unit: of the merge, mesh units.
__kernel void coefficients(__global const float *steps, float unit, __global float4 *weights)
{
    int i = get_global_id(0), layer = i % LAYERS;
    float4 w = weights[i];
    int first = min((int)w.x, SAMPLES_OF(layer) - 2);
    float share = w.x - first, scale = w.y / unit;
    steps += layer * MOST_SAMPLES + first;
    weights[i] = (float4)(scale * (1.0f - share) * steps[0], scale * share * steps[1], first, w.z);
}

// For texels with a stiffness of their own (blend_stiff.cl): r of each layer, LAYERS per triangle;
// with TILT then two more of as many, with directions as in sample_weights.
__kernel void layer_stretches(__global const float4 *axes, __global const float2 *logs,
                              __global const float4 *jacobians,
                              __global const float2 *directions, __global float *stretches)
{
    const int sides = TILT ? 3 : 1;
    int t = get_global_id(0);
    for (int side = 0; side < sides; side++)
        for (int n = 0; n < LAYERS; n++)
            stretches[(t * sides + side) * LAYERS + n] =
                layer_stretch(n, t, axes, logs, jacobians, directions + side * ORIENTED);
}
