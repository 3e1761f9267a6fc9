// Codes of the grain of a tile, once an asset: noise of the neutral surface in octaves, each
// 1/sqrt(5) as long as the one before. An octave that the texels of a place do not carry is left
// out: all of it below two texels a wave, none from three on.
#include "noise.clh"

#define OCTAVES 3
#define FINER 2.23606798f // octave by octave

__constant float SHARES[OCTAVES] = {0.898f, 0.401f, 0.180f}; // as the waves; squares add up to 1

// Turned from octave to octave, so that no cells lie along the axes of a face.
inline float3 turned(float3 p)
{
    return (float3)(0.8f * p.y + 0.6f * p.z, -0.8f * p.x + 0.36f * p.y - 0.48f * p.z,
                    -0.6f * p.x - 0.48f * p.y + 0.64f * p.z);
}

// Cells of the noise to a wave: half of the power is in waves of 1.9 cells and longer, nine tenths in
// those from 1.2 on.
#define CELLS 2.0f

// triangles: of each texel; `none` has no grain. corners: their UV, three a triangle. planes: of each
// triangle, in units of the largest wavelength over CELLS: (x, y, z) of its first corner, dX/du, dX/dv, and the
// most that a step in UV can be long. Outside of a triangle its plane goes on. codes: 32 for the
// root mean square. Texel (row, column) of a map of `side` texels is the first; `width` a row.
// Within one code of the same in double.
__kernel void grain_codes(__global const int *triangles, int none, __global const float *corners,
                          __global const float *planes, int width, int side, int row, int column,
                          uint seed, __global char *codes)
{
    int i = get_global_id(0), t = triangles[i];
    float sum = 0.0f;
    if (t != none) {
        __global const float *plane = planes + 10 * t;
        float2 uv = (float2)(column + i % width + 0.5f, side - row - i / width - 0.5f) / (float)side;
        uv -= vload2(3 * t, corners);
        float3 p = vload3(0, plane) + uv.x * vload3(1, plane) + uv.y * vload3(2, plane);
        float texel = plane[9] / side, wave = CELLS;
        for (int octave = 0; octave < OCTAVES; octave++) {
            float carried = clamp(wave / texel - 2.0f, 0.0f, 1.0f);
            p = turned(p);
            if (carried > 0.0f)
                sum += SHARES[octave] * carried * noise_at(p, seed * OCTAVES + octave);
            p *= FINER;
            wave *= 1.0f / FINER;
        }
    }
    codes[i] = convert_char_sat_rte(32.0f * sum);
}
