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

// How much each of `edges` edges draws walkers now; those that cross worn ones the less.  still: of
// edges that nobody walked on, which are many: a power takes most of the time. A work-item takes eight
// edges: PoCL finds eight powers at once in the time of one, with the same bits.
__kernel void pull_of_edges(int first, int count, int edges, float unworn, float draw, float worn,
                            float shy, __global const float *still,
                            __global const float *strength, __global const int *offsets,
                            __global const int *crossing, __global float *pull)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int begin = 8 * i, own = min(edges - begin, 8);
    float s[8], across[8];
    for (int l = 0; l < 8; l++) {
        s[l] = across[l] = 0.0f;
        if (l >= own)
            continue;
        s[l] = strength[begin + l];
        for (int k = offsets[begin + l]; k < offsets[begin + l + 1]; k++)
            across[l] += strength[crossing[k]];
    }
    float8 trail = vload8(0, s), drawn = (float8)(*still);
    if (any(trail != 0.0f)) {
        float8 walked = pow(unworn + trail / (1.0f + trail / worn), (float8)(draw));
        drawn = trail == 0.0f ? drawn : walked;
    }
    drawn /= 1.0f + shy * vload8(0, across);
    vstore8(drawn, 0, s);
    for (int l = 0; l < own; l++)
        pull[begin + l] = s[l];
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

// Of eight ways out from the first of `direction` on, how straight on each goes: the fourth power of
// the cosine, nothing for a turn beyond a right angle.
inline float8 straightness(__global const short *direction, float2 heading)
{
    float16 ways = convert_float16(vload16(0, direction));
    float8 x = ways.even * heading.x, y = ways.odd * heading.y; // none of them fused, as in dot()
    float8 c = fmax((x + y) / 32767.0f, 0.0f);
    return c * c * (c * c);
}

// Sums of the appeal of ways out, each times how straight on it goes, one after the other from `sum`
// on. Eight are read, `count` count.
inline float8 summed(__global const short *direction, __global const float *appeal, int count,
                     float2 heading, float sum)
{
    float8 straight = straightness(direction, heading), sums = vload8(0, appeal);
    sums = (int8)(0, 1, 2, 3, 4, 5, 6, 7) < count ? sums : (float8)(0.0f);
    sums.s0 = straight.s0 * sums.s0 + sum;
    sums.s1 = straight.s1 * sums.s1 + sums.s0;
    sums.s2 = straight.s2 * sums.s2 + sums.s1;
    sums.s3 = straight.s3 * sums.s3 + sums.s2;
    sums.s4 = straight.s4 * sums.s4 + sums.s3;
    sums.s5 = straight.s5 * sums.s5 + sums.s4;
    sums.s6 = straight.s6 * sums.s6 + sums.s5;
    sums.s7 = straight.s7 * sums.s7 + sums.s6;
    return sums;
}

// How many of eight sums are no larger than `chance`.
inline int passed(float8 sums, float chance)
{
    int8 one = sums <= chance;
    int4 two = one.lo + one.hi;
    int2 four = two.lo + two.hi;
    return -(four.x + four.y);
}

// The direction of each way out at the pore that it leads to, seen from there: that of the way back.
__kernel void lay_arrivals(int first, int count, __global const int *offsets,
                           __global const int *others, __global const short2 *direction,
                           __global short2 *arrival)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    for (int h = offsets[i]; h < offsets[i + 1]; h++) {
        int back = offsets[others[h]];
        while (others[back] != i)
            back++;
        arrival[h] = direction[back];
    }
}

// key: a word of its first pore.  number: of the walker there.  node: where it is, -1 once it stops.
typedef struct {
    uint key, number;
    int node;
    float2 heading;
    uint4 random;
} walker_t;

// Walker w of all, either way along `along` or, as far as anisotropy falls short of 1, any way.
inline walker_t setting_out(int w, int most, float walkers, uint round, uint seed, float2 along,
                            __global const uint *key, __global const float *anisotropy)
{
    walker_t walker;
    walker.node = w / most;
    walker.number = w % most;
    walker.key = key[walker.node];
    float hold = anisotropy[walker.node];
    uint4 r = random4(walker.key, round, seed, 256u * walker.number + 1u);
    if (walker.number + unit_interval(r.x) >= walkers)
        walker.node = -1;
    float2 lines = gathered(along, hold);
    walker.heading = r.y & 1u ? -lines : lines;
    if (unit_interval(r.z) >= hold) {
        float angle = 2.0f * M_PI_F * unit_interval(r.w);
        walker.heading = (float2)(cos(angle), sin(angle));
    }
    walker.random = r;
    return walker;
}

// The way out that a walker takes, -1 where it likes none.
inline int way_of(const walker_t *walker, __global const int *offsets,
                  __global const short *direction, __global const float *appeal)
{
    int begin = offsets[walker->node], degree = min(offsets[walker->node + 1] - begin, WAYS);
    float2 heading = walker->heading;
    float8 sums = summed(direction + 2 * begin, appeal + begin, degree, heading, 0.0f);
    float8 more = (float8)(sums.s7);
    if (degree > 8)
        more = summed(direction + 2 * begin + 16, appeal + begin + 8, degree - 8, heading, sums.s7);
    float chance = unit_interval(walker->random.x) * more.s7;
    int slot = min(passed(sums, chance) + passed(more, chance), degree - 1);
    return more.s7 > 0.0f ? begin + slot : -1;
}

// As in trails.py.
#define TOGETHER 4

// From each pore start as many walkers, `walkers` to one on the mean, `most` at most, `all` in all, and
// each time choose a way out by chance in proportion to its appeal and to how straight on it goes. key:
// a word of each pore, so that its walkers do not depend on what is elsewhere. A work-item leads
// TOGETHER of them, a step of each in turn: while one waits for its sums and for the memory, the others
// go on. The hint keeps compilers from taking several work-items at once in one vector.
__attribute__((vec_type_hint(float8)))
__kernel void walk(int first, int count, int all, int most, float walkers, uint round, uint seed,
                   int steps, int amount, float2 along, __global const uint *key,
                   __global const int *offsets, __global const int *edges,
                   __global const int *others, __global const short *direction,
                   __global const short2 *arrival, __global const float *anisotropy,
                   __global const float *appeal, __global int *deposit)
{
    int k = first + get_global_id(0);
    if (k >= count)
        return;
    walker_t led[TOGETHER];
    for (int l = 0; l < TOGETHER; l++) {
        int w = k * TOGETHER + l;
        led[l] = setting_out(min(w, all - 1), most, walkers, round, seed, along, key, anisotropy);
        led[l].node = w < all ? led[l].node : -1;
    }
    for (int step = 0; step < steps; step++)
        for (int l = 0; l < TOGETHER; l++) {
            if (led[l].node < 0)
                continue;
            if ((step & 3) == 0)
                led[l].random = random4(led[l].key, round, seed, 256u * led[l].number + 2u + step);
            int way = way_of(led + l, offsets, direction, appeal);
            if (way < 0) {
                led[l].node = -1;
                continue;
            }
            atomic_add(deposit + edges[way], amount);
            led[l].random = led[l].random.yzwx;
            led[l].heading = convert_float2(arrival[way]) / -32767.0f; // straight on
            led[l].node = others[way];
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
