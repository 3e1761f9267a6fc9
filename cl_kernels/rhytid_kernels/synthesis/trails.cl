// Walkers wear trails into the candidate edges (after Weiss et al. 2023). Deposits are whole
// numbers, so that their sum does not depend on the order of the walkers.
#include "random.clh"

// Directions of the ways out of pores, (cosine, sine) times 32767 against the frame of the pore.
// frame: unit tangents along the main lines and to their left.
__kernel void lay_directions(int first, int count, __global const int *offsets,
                             __global const int *others, __global const int *place,
                             __global const float *along, __global const float *left,
                             __global short2 *direction)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int3 p = vload3(i, place);
    float3 x = vload3(i, along), y = vload3(i, left);
    for (int h = offsets[i]; h < offsets[i + 1]; h++) {
        float3 way = convert_float3(vload3(others[h], place) - p);
        float2 d = (float2)(dot(way, x), dot(way, y));
        float size = sqrt(dot(d, d));
        d = size > 0.0f ? d / size : (float2)(1.0f, 0.0f);
        direction[h] = convert_short2_rte(d * 32767.0f);
    }
}

// What an edge that nobody walked on draws.
__kernel void pull_of_unworn(int first, int count, float unworn, float draw, __global float *still)
{
    if (get_global_id(0) == 0)
        *still = pow(unworn, draw);
}

// How much each edge draws walkers now; those that cross worn ones the less.  still: of edges that
// nobody walked on, which are many: a power takes most of the time.
__kernel void pull_of_edges(int first, int count, float unworn, float draw, float worn, float shy,
                            __global const float *still, __global const float *strength,
                            __global const int *offsets, __global const int *crossing,
                            __global float *pull)
{
    int e = first + get_global_id(0);
    if (e >= count)
        return;
    float across = 0.0f, s = strength[e];
    for (int k = offsets[e]; k < offsets[e + 1]; k++)
        across += strength[crossing[k]];
    float drawn = s == 0.0f ? *still : pow(unworn + s / (1.0f + s / worn), draw);
    pull[e] = drawn / (1.0f + shy * across);
}

// Where a family's lines run at a pore, against the main ones: beyond 1, anisotropy swings them
// towards the main ones, which all follow at 2.
inline float2 gathered(float2 along, float anisotropy)
{
    float swing = clamp(anisotropy - 1.0f, 0.0f, 1.0f);
    return swing > 0.0f ? normalize(mix(along, (float2)(1.0f, 0.0f), swing)) : along;
}

// Appeal of each way out to a family of walkers: short, along its lines, and worn. along: of those
// lines against the main ones. The cosine counts to the power of 2.5, whose mean over all angles is
// EVEN; askew is for right angles. anisotropy of a pore: how much the direction counts.
#define EVEN 0.43f
__kernel void appeal_of_ways(int first, int count, __global const int *offsets,
                             __global const short2 *direction, __global const int *edges,
                             __global const float *length, __global const float *pull,
                             __global const float *anisotropy, float mean_length, float2 along,
                             float askew, __global float *appeal)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    float2 lines = gathered(along, anisotropy[i]);
    for (int h = offsets[i]; h < offsets[i + 1]; h++) {
        int e = edges[h];
        float c = fabs(dot(convert_float2(direction[h]), lines)) / 32767.0f;
        float liking = mix(EVEN, c * c * sqrt(c), fmin(anisotropy[i], 1.0f)) + askew;
        float shortness = mean_length / length[e];
        appeal[h] = liking * shortness * sqrt(shortness) * pull[e];
    }
}

inline float straightness(float cosine) // nothing for a turn beyond a right angle
{
    float c = fmax(cosine, 0.0f);
    return c * c * (c * c);
}

// From each pore start as many walkers, `walkers` to one on the mean, `most` at most, either way along
// `along` or, as far as anisotropy falls short of 1, any way, and each time choose a way out by chance
// in proportion to its appeal and to how straight on it goes. key: a word of each pore, so that its
// walkers do not depend on what is elsewhere.
__kernel void walk(int first, int count, int most, float walkers, uint round, uint seed, int steps,
                   int amount, float2 along, __global const uint *key, __global const int *offsets,
                   __global const int *edges, __global const int *others,
                   __global const short2 *direction, __global const float *anisotropy,
                   __global const float *appeal, __global int *deposit)
{
    int w = first + get_global_id(0);
    if (w >= count)
        return;
    int node = w / most, number = w % most;
    uint own = key[node];
    uint4 r = random4(own, round, seed, 256u * number + 1u);
    if (number + unit_interval(r.x) >= walkers)
        return;
    float2 lines = gathered(along, anisotropy[node]);
    float2 heading = r.y & 1u ? -lines : lines;
    if (unit_interval(r.z) >= anisotropy[node]) {
        float angle = 2.0f * M_PI_F * unit_interval(r.w);
        heading = (float2)(cos(angle), sin(angle));
    }
    for (int step = 0; step < steps; step++) {
        if ((step & 3) == 0)
            r = random4(own, round, seed, 256u * number + 2u + step);
        int begin = offsets[node], degree = min(offsets[node + 1] - begin, WAYS);
        float sums[WAYS], sum = 0.0f;
        for (int s = 0; s < degree; s++) {
            float onward = dot(convert_float2(direction[begin + s]), heading) / 32767.0f;
            sum += straightness(onward) * appeal[begin + s];
            sums[s] = sum;
        }
        if (!(sum > 0.0f))
            return;
        float chance = unit_interval(r.x) * sum;
        r = r.yzwx;
        int slot = 0;
        while (slot < degree - 1 && sums[slot] <= chance)
            slot++;
        atomic_add(deposit + edges[begin + slot], amount);
        int to = others[begin + slot], back = offsets[to];
        while (others[back] != node)
            back++;
        heading = convert_float2(direction[back]) / -32767.0f; // straight on
        node = to;
    }
}

// Every edge decays, and the mean of what comes on top is 1 - keep on even skin.
__kernel void wear_edges(int first, int count, float keep, float gain, __global int *deposit,
                         __global float *strength)
{
    int e = first + get_global_id(0);
    if (e >= count)
        return;
    strength[e] = keep * strength[e] + gain * deposit[e];
    deposit[e] = 0;
}
