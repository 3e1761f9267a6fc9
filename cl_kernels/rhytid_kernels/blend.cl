// Blends precomputed maps by the stretch of each texel's triangle (Alg. 3, lines 11 to 14).
// Sixteen texels a work-item. What Alg. 3 computes up to line 10 is the same in a whole triangle,
// so a vector is blended once for each triangle in it, and each texel takes its own.

#include "merge.clh"

#define WIDTH 16

// Linear between the two samples around weight.x, times weight.y. Only these two are read.
inline float16 between(__global const CODE *maps, int texels, float2 weight,
                       __global const float *steps)
{
    int m = min((int)weight.x, SAMPLES - 2);
    float f = weight.x - m;
    return FLOATS_OF(maps + m * texels) * (weight.y * (1.0f - f) * steps[m])
         + FLOATS_OF(maps + (m + 1) * texels) * (weight.y * f * steps[m + 1]);
}

// Alg. 3, lines 5 to 14, as if every texel lay in one triangle. weights: of that triangle.
#if PARTS == 1
// The paper's merge: the deepest wins. merge is not used.
inline float16 blend_triangle(__global const CODE *maps, int texels, __global const float2 *weights,
                              __global const float *steps, float2 merge)
{
    float16 d = between(maps, texels, weights[0], steps);
    for (int n = 1; n < LAYERS; n++)
        d = min(d, between(maps + n * SAMPLES * texels, texels, weights[n], steps + n * SAMPLES));
    return d;
}
#else
// Valleys and bulges apart, by the mellow-max that drew them. merge: (depth, sharpness).
inline float16 blend_triangle(__global const CODE *maps, int texels, __global const float2 *weights,
                              __global const float *steps, float2 merge)
{
    float16 valleys = 1.0f, bulges = 1.0f;
    for (int n = 0; n < LAYERS; n++) {
        __global const CODE *layer = maps + n * PARTS * SAMPLES * texels;
        __global const float *layer_steps = steps + n * SAMPLES;
        valleys += grown(-between(layer, texels, weights[n], layer_steps), merge);
        bulges += grown(between(layer + SAMPLES * texels, texels, weights[n], layer_steps), merge);
    }
    return log(bulges / valleys) * (merge.x / merge.y);
}
#endif

// triangles: of each texel. codes: LAYERS x PARTS x SAMPLES maps of `texels` codes. weights: LAYERS
// a triangle. steps: displacement of a code, LAYERS x SAMPLES. merge: (depth, sharpness). out:
// displacement, mesh units; within 1e-6 of the largest step times code of the same in double.
__kernel void blend(__global const int *triangles, __global const CODE *codes,
                    __global const float2 *weights, __global const float *steps, float2 merge,
                    int texels, __global float *out)
{
    int at = get_global_id(0) * WIDTH;
    __global const int *triangle = triangles + at;
    int16 t = vload16(0, triangle);
    float16 d = blend_triangle(codes + at, texels, weights + triangle[0] * LAYERS, steps, merge);
    for (int lane = 1; lane < WIDTH; lane++)
        if (triangle[lane] != triangle[lane - 1]) {
            float16 other =
                blend_triangle(codes + at, texels, weights + triangle[lane] * LAYERS, steps, merge);
            d = select(d, other, t == triangle[lane]);
        }
    vstore16(d, 0, out + at);
}
