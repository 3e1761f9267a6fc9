// Blends precomputed maps by the stretch of each texel's triangle (Alg. 3, lines 11 to 14).
// Sixteen texels a work-item. What Alg. 3 computes up to line 10 is the same in a whole triangle,
// so a vector is blended once for each triangle in it, and each texel takes its own.

#define WIDTH 16

#if CODE_BITS == 8
#define FLOATS_OF(address) convert_float16(vload16(0, (__global const char *)(address)))
#else
#define FLOATS_OF(address) convert_float16(vload16(0, (__global const short *)(address)))
#endif

// Linear between the two samples around `position`. Only these two are read.
inline float16 between(__global const CODE *maps, int texels, float position,
                       __global const float *steps)
{
    int m = min((int)position, SAMPLES - 2);
    float f = position - m;
    return FLOATS_OF(maps + m * texels) * ((1.0f - f) * steps[m])
         + FLOATS_OF(maps + (m + 1) * texels) * (f * steps[m + 1]);
}

// Alg. 3, lines 5 to 14, as if every texel lay in one triangle. positions: of that triangle.
inline float16 blend_triangle(__global const CODE *maps, int texels,
                              __global const float *positions, __global const float *steps)
{
    float16 d = between(maps, texels, positions[0], steps);
    for (int n = 1; n < LAYERS; n++)
        d = min(d, between(maps + n * SAMPLES * texels, texels, positions[n], steps + n * SAMPLES));
    return d;
}

// triangles: of each texel. codes: LAYERS x SAMPLES maps of `texels` codes. positions: LAYERS a
// triangle. steps: displacement of a code, LAYERS x SAMPLES. out: displacement, mesh units; within
// 1e-6 of the largest step times code of the same blend in double.
__kernel void blend(__global const int *triangles, __global const CODE *codes,
                    __global const float *positions, __global const float *steps, int texels,
                    __global float *out)
{
    int at = get_global_id(0) * WIDTH;
    __global const int *triangle = triangles + at;
    int16 t = vload16(0, triangle);
    float16 d = blend_triangle(codes + at, texels, positions + triangle[0] * LAYERS, steps);
    for (int lane = 1; lane < WIDTH; lane++)
        if (triangle[lane] != triangle[lane - 1]) {
            float16 other =
                blend_triangle(codes + at, texels, positions + triangle[lane] * LAYERS, steps);
            d = select(d, other, t == triangle[lane]);
        }
    vstore16(d, 0, out + at);
}
