// Blends precomputed maps by the stretch of each texel's triangle (Alg. 3, lines 11 to 14).
// Sixteen texels a work-item; sixteen in one triangle read two samples a layer, others all of them.

#define WIDTH 16

#if CODE_BITS == 8
#define FLOATS_OF(address) convert_float16(vload16(0, (__global const char *)(address)))
#else
#define FLOATS_OF(address) convert_float16(vload16(0, (__global const short *)(address)))
#endif

inline float16 gather(__global const float *values, int16 at)
{
    return (float16)(values[at.s0], values[at.s1], values[at.s2], values[at.s3], values[at.s4],
                     values[at.s5], values[at.s6], values[at.s7], values[at.s8], values[at.s9],
                     values[at.sa], values[at.sb], values[at.sc], values[at.sd], values[at.se],
                     values[at.sf]);
}

// Linear between the two samples around `position`. Only these two are read.
inline float16 between(__global const CODE *maps, int texels, float position,
                       __global const float *steps)
{
    int m = min((int)position, SAMPLES - 2);
    float f = position - m;
    return FLOATS_OF(maps + m * texels) * ((1.0f - f) * steps[m])
         + FLOATS_OF(maps + (m + 1) * texels) * (f * steps[m + 1]);
}

// The same for a position of each texel, as a sum of hat functions.
inline float16 between_each(__global const CODE *maps, int texels, float16 position,
                            __global const float *steps)
{
    float16 sum = 0.0f;
    for (int m = 0; m < SAMPLES; m++) {
        float16 hat = fmax(1.0f - fabs(position - (float)m), 0.0f);
        sum += FLOATS_OF(maps + m * texels) * (hat * steps[m]);
    }
    return sum;
}

// triangles: of each texel. codes: LAYERS x SAMPLES maps of `texels` codes. positions: LAYERS a
// triangle. steps: displacement of a code, LAYERS x SAMPLES. out: displacement, mesh units; within
// 1e-6 of the largest step times code of the same blend in double.
__kernel void blend(__global const int *triangles, __global const CODE *codes,
                    __global const float *positions, __global const float *steps, int texels,
                    __global float *out)
{
    int at = get_global_id(0) * WIDTH;
    int16 t = vload16(0, triangles + at);
    bool one_triangle = all(t == t.s0);
    float16 d = INFINITY; // line 5
    for (int n = 0; n < LAYERS; n++) {
        __global const CODE *maps = codes + n * SAMPLES * texels + at;
        __global const float *layer_steps = steps + n * SAMPLES;
        float16 blended;
        if (one_triangle)
            blended = between(maps, texels, positions[t.s0 * LAYERS + n], layer_steps);
        else
            blended = between_each(maps, texels, gather(positions, t * LAYERS + n), layer_steps);
        d = fmin(d, blended); // line 13
    }
    vstore16(d, 0, out + at);
}
