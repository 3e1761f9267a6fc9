// Codes of the relief between the lines of a tile, once per asset: noise of the neutral surface in
// octaves, fine ones of the grain and broad ones of the undulation. An octave that the texels of a
// place do not carry is left out: all of it below two texels per wave, none from three on. What is left
// is as high as means over texels are, so that coarse maps are as rough as the means of fine ones.
#include "noise.clh"
#include "patches.clh"

// Turned from octave to octave, so that no cells lie along the axes of a face.
inline float3 turned(float3 p)
{
    return (float3)(0.8f * p.y + 0.6f * p.z, -0.8f * p.x + 0.36f * p.y - 0.48f * p.z,
                    -0.6f * p.x - 0.48f * p.y + 0.64f * p.z);
}

// Cells of the noise to a wave: half of the power is in waves of 1.9 cells and longer, nine tenths in
// those from 1.2 on.
#define CELLS 2.0f

// Codes end alike on both sides, as those that a shader reads of a texture (R8_SNORM) do.
#define LAST_CODE 127.0f

// Octaves, each so many times as fine as the one before, and the share of each. Those of the grain
// are as the waves; those of the undulation are what a scanned cheek has beside its lines. The squares
// add up to 1.
#define GRAIN_OCTAVES 3
#define GRAIN_FINER 2.23606798f
__constant float GRAIN_SHARES[GRAIN_OCTAVES] = {0.898f, 0.401f, 0.180f};
#define UNDULATION_OCTAVES 4
#define UNDULATION_FINER 2.0f
__constant float UNDULATION_SHARES[UNDULATION_OCTAVES] = {0.739f, 0.517f, 0.370f, 0.222f};

// Root mean square of means over texels, of that of the noise itself, by texels to a wave: within
// 0.004 of what is measured.
#define OF_MEANS(texels) (1.0f / (1.0f + 2.2f / ((texels) * (texels))))

// p: in cells of the longest wave.  texel: the most that a texel is long, in the same.  seed: of the
// first octave; the others count on.
inline float octaves(float3 p, float texel, int count, float finer, __constant const float *shares,
                     uint seed)
{
    float sum = 0.0f, wave = CELLS;
    for (int octave = 0; octave < count; octave++) {
        float texels = wave / texel, carried = clamp(texels - 2.0f, 0.0f, 1.0f);
        p = turned(p);
        if (carried > 0.0f)
            sum += shares[octave] * carried * OF_MEANS(texels) * noise_at(p, seed + octave);
        p *= finer;
        wave /= finer;
    }
    return sum;
}

// Of values at the corners of a triangle, whose UV are c: that at uv, counted from the first corner,
// within those of the corners. Where these are alike it is theirs, bit for bit.
inline float between_corners(float3 values, float2 uv, __global const float *c)
{
    float most = max(values.x, max(values.y, values.z));
    float least = min(values.x, min(values.y, values.z));
    if (most == least)
        return most;
    float2 a = vload2(1, c) - vload2(0, c), b = vload2(2, c) - vload2(0, c);
    float2 share = (float2)(uv.x * b.y - uv.y * b.x, a.x * uv.y - a.y * uv.x) / (a.x * b.y - a.y * b.x);
    return clamp(values.x + dot(share, values.yz - values.x), least, most);
}

// triangles: of each texel; `none` has no relief. corners: their UV, three per triangle. planes: of
// each triangle, in units of the largest wavelength of the grain over CELLS: (x, y, z) of its first
// corner, dX/du, dX/dv, the most that a step in UV can be long; and at its corners the factor of the
// grain, then that of the undulation, then the patchiness. Outside of a triangle its plane goes on.
// finer: the largest wavelength of the grain over that of the undulation. shares: of the grain and
// the undulation. table, patches, deviation: as in patches.clh, `patches` of the grain, then of the
// undulation. Texel (row, column) of a map of `side` texels is the first; `width` a row. scale: codes
// for the root mean square of even skin. The undulation is at most MOST_UNDULATION times that of even
// skin, so that codes end at three of its deviations. Within one code of the same in double.
__kernel void grain_codes(__global const int *triangles, int none, __global const float *corners,
                          __global const float *planes, int width, int side, int row, int column,
                          uint seed, float finer, float2 shares, __global const float *table,
                          __global const float *patches, float2 deviation, float scale,
                          __global char *codes)
{
    int i = get_global_id(0), t = triangles[i];
    float sum = 0.0f;
    if (t != none) {
        __global const float *plane = planes + 19 * t;
        float2 uv = (float2)(column + i % width + 0.5f, side - row - i / width - 0.5f) / (float)side;
        uv -= vload2(3 * t, corners);
        float3 p = vload3(0, plane) + uv.x * vload3(1, plane) + uv.y * vload3(2, plane);
        float texel = plane[9] / side;
        float amount = between_corners(vload3(0, plane + 16), uv, corners + 6 * t);
        float broad = between_corners(vload3(0, plane + 13), uv, corners + 6 * t);
        if (amount > 0.0f) {
            shares.x *= patch_factor(table, patches, p, amount, deviation);
            broad *= patch_factor(table, patches + 12, p, amount, deviation);
        }
        if (shares.x > 0.0f)
            sum += shares.x * between_corners(vload3(0, plane + 10), uv, corners + 6 * t) *
                   octaves(p, texel, GRAIN_OCTAVES, GRAIN_FINER, GRAIN_SHARES,
                           seed * GRAIN_OCTAVES);
        if (shares.y > 0.0f)
            sum += shares.y * min(broad, MOST_UNDULATION) *
                   octaves(finer * p, finer * texel, UNDULATION_OCTAVES, UNDULATION_FINER,
                           UNDULATION_SHARES, ~(seed * UNDULATION_OCTAVES) - UNDULATION_OCTAVES);
    }
    codes[i] = convert_char_rte(clamp(scale * sum, -LAST_CODE, LAST_CODE));
}
