// Adds the grain of a frame to heights that are drawn. A vector of texels per work-item, in the part of
// a tile of `width` texels per row from texel `first` on that lies in a map of `out_width` a row from
// texel `out_first` on.
#include "ahead.clh"
#include "grain.clh"
#include "groups.clh"
#include "vectors.clh"

#define ROWS_AHEAD 2 // 1 and 4 took as long

POWER_OF_TWO(power16, float16, int16)

// Of each triangle; the last is none, unstretched. groups: as in first_in_group, of triangles; count: of
// all.
__kernel void grain_gains(__global const int *groups, __global const float *logs, float exponent,
                          int count, __global float *gains)
{
    const int first = first_in_group(groups);
    float found[2][LANES];
    for (int lane = 0; lane < LANES; lane++)
        for (int axis = 0; axis < 2; axis++)
            found[axis][lane] = logs[2 * min(first + lane, count - 1) + axis];
    vstore16(GRAIN_GAIN(power16, vload16(0, found[0]), vload16(0, found[1]), exponent), 0, found[0]);
    for (int lane = 0; lane < min(LANES, count - first); lane++)
        gains[first + lane] = found[0][lane];
}

// The log stretches of the texels of a vector.
inline float16 member_logs(__global const int2 *first, __global const int2 *end,
                           __global const float *logs, int axis)
{
    float16 found = logs[2 * first->x + axis];
    for (first++; first < end; first++)
        found = select(found, (float16)(logs[2 * first->x + axis]), lanes_of(first->y));
    return found;
}

// firsts, members: the triangles of each vector of the tile. stiffness: of its texels, or NULL.
// gains: of the triangles. logs, exponent: what they come from, for texels with a stiffness.
__kernel void add_grain(__global const int *firsts, __global const int2 *members,
                        __global const char *codes, __global const float *stiffness,
                        __global const float *gains, __global const float *logs, float exponent,
                        float amplitude, float depth, int width, int first, int out_width,
                        int out_first, __global float *out)
{
    int at = first + get_global_id(1) * width + get_global_id(0) * WIDTH, i = at / WIDTH;
    __global const int2 *member = members + firsts[i], *end = members + firsts[i + 1];
    float16 gain;
    if (stiffness) {
        float16 stiff = vload16(0, stiffness + at);
        float16 first_log = stiff * member_logs(member, end, logs, 0);
        float16 second_log = stiff * member_logs(member, end, logs, 1);
        gain = GRAIN_GAIN(power16, first_log, second_log, exponent);
    } else {
        gain = gains[member->x];
        for (member++; member < end; member++)
            gain = select(gain, (float16)(gains[member->x]), lanes_of(member->y));
    }
    out += out_first + get_global_id(1) * out_width + get_global_id(0) * WIDTH;
    SOON_ALONE(out + ROWS_AHEAD * out_width); // rows of a tile lie apart
    float16 code = convert_float16(vload16(0, codes + at));
    vstore16(grained(vload16(0, out), code, gain, amplitude, depth), 0, out);
}
