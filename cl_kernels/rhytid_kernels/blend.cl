// Blends precomputed maps by the stretch of each texel's triangle (Alg. 3, lines 11 to 14).
// A vector of texels a work-item. What Alg. 3 computes up to line 10 is the same in a whole triangle,
// so a vector is blended once for each triangle in it, and each texel takes its own.

#include "merge.clh"
#include "vectors.clh"

// Linear between the two samples around weight.x, times weight.y. Only these two are read.
inline float16 between(__global const CODE *maps, float2 weight,
                       __global const float *steps)
{
    int m = min((int)weight.x, SAMPLES - 2);
    float f = weight.x - m;
    return FLOATS_OF(maps + m * WIDTH) * (weight.y * (1.0f - f) * steps[m])
         + FLOATS_OF(maps + (m + 1) * WIDTH) * (weight.y * f * steps[m + 1]);
}

// Alg. 3, lines 5 to 14, as if every texel lay in one triangle. weights: of that triangle.
#if PARTS == 1
// The paper's merge: the deepest wins. merge is not used.
inline float16 blend_triangle(__global const CODE *maps, __global const float2 *weights,
                              __global const float *steps, float2 merge)
{
    float16 d = between(maps, weights[0], steps);
    for (int n = 1; n < LAYERS; n++)
        d = min(d, between(maps + n * SAMPLES * WIDTH, weights[n], steps + n * SAMPLES));
    return d;
}
#else
// Valleys and bulges apart, by the mellow-max that drew them. merge: (depth, sharpness).
inline float16 blend_triangle(__global const CODE *maps, __global const float2 *weights,
                              __global const float *steps, float2 merge)
{
    float16 valleys = 1.0f, bulges = 1.0f;
    for (int n = 0; n < LAYERS; n++) {
        __global const CODE *layer = maps + n * PARTS * SAMPLES * WIDTH;
        __global const float *layer_steps = steps + n * SAMPLES;
        valleys += grown(-between(layer, weights[n], layer_steps), merge);
        bulges += grown(between(layer + SAMPLES * WIDTH, weights[n], layer_steps), merge);
    }
    return log(bulges / valleys) * (merge.x / merge.y);
}
#endif

// firsts, members: the triangles of each vector. codes: of each vector those of LAYERS x PARTS x
// SAMPLES maps, side by side in memory: what a work-item reads is one stream. weights: LAYERS a
// triangle. steps: displacement of a code, LAYERS x SAMPLES. merge: (depth, sharpness). out:
// displacement, mesh units; within 1e-6 of the largest step times code of the same in double.
__kernel void blend(__global const int *firsts, __global const int2 *members,
                    __global const CODE *codes, __global const float2 *weights,
                    __global const float *steps, float2 merge, __global float *out)
{
    int i = get_global_id(0), member = firsts[i], end = firsts[i + 1];
    codes += (size_t)i * (LAYERS * PARTS * SAMPLES * WIDTH);
    float16 d = blend_triangle(codes, weights + members[member].x * LAYERS, steps, merge);
    for (member++; member < end; member++) {
        float16 other = blend_triangle(codes, weights + members[member].x * LAYERS, steps, merge);
        d = select(d, other, lanes_of(members[member].y));
    }
    vstore16(d, 0, out + i * WIDTH);
}
