// Scales at the two ends of wrinkles that bend, from r of every wrinkle: at an end that another wrinkle
// continues r goes from its own towards the mean of both, so that a line has no step there. With SHARED
// wrinkles have shares of the shortening of skin.
#include "lanes.clh"
#include "response.clh"
#ifdef SHARED
#include "shares.clh"
#endif

POWER_OF_TWO(power16, float16, int16)

// r at both ends of wrinkle i, which `partner` continue; none where negative. Without a branch, which a
// processor would guess wrong.
inline float2 at_ends(__global const float *r, int i, int2 partner, float share)
{
    int2 other = select(partner, (int2)(i), partner < 0);
    float2 own = r[i], others = (float2)(r[other.x], r[other.y]);
    return select(own + 0.5f * share * (others - own), own, partner < 0);
}

#define IN_PLACE inline __attribute__((always_inline))
// Of a lane of a group, as lanes.clh takes them: r of its partners, or its own where it has none, which leaves
// an end at its own; half widths and weights; shares.
#define PARTNER(partner, lane) ((partner) < 0 ? first + AT(lane) : (partner))
#define OTHERS(lane)                                                                               \
    ((float2)(r[PARTNER(partners[AT(lane)].x, lane)], r[PARTNER(partners[AT(lane)].y, lane)]))
#define OWN(lane) r[first + AT(lane)]
#define SIZES(lane) sizes[first + AT(lane)]
#define SHARES(lane) shares[first + AT(lane)]

// at_ends of a group. partners: from its first on.
IN_PLACE pairs_t group_ends(__global const float *r, __global const int2 *partners, float share, int first,
                            int last)
{
    const float16 own = SINGLES(OWN);
    pairs_t ends = {own, own};
    if (partners) {
        const pairs_t others = PAIRS(OTHERS);
        ends.x = own + 0.5f * share * (others.x - own);
        ends.y = own + 0.5f * share * (others.y - own);
    }
    return ends;
}

// The scales of a group. last: its last lane, which may be known to the compiler. sizes: half widths, then
// weights at both ends; shares: likewise; only with SHARED.
IN_PLACE void respond_group(int first, int last, pairs_t r, float width_exponent, float depth_exponent,
                            __global const float4 *sizes, __global const float2 *shares,
                            __global float4 *scales)
{
    quads_t found = {SCALE(power16, r.x, width_exponent, SCALE_LIMIT),
                     SCALE(power16, r.y, width_exponent, SCALE_LIMIT),
                     SCALE(power16, r.x, -depth_exponent, SCALE_LIMIT),
                     SCALE(power16, r.y, -depth_exponent, SCALE_LIMIT)};
#ifdef SHARED
    const quads_t size = QUADS(SIZES);
    const pairs_t own = PAIRS(SHARES);
    found.z = min(found.z * SHARED_DEPTH(r.x, depth_exponent, own.x), MOST_SHARED(size.z));
    found.w = min(found.w * SHARED_DEPTH(r.y, depth_exponent, own.y), MOST_SHARED(size.w));
#endif
    store_quads(found, last, (__global float *)(scales + first));
}

// A work-item takes a group of wrinkles. groups: as in first_in_group. partners: of each at its start
// and at its end, or NULL. share: of the way to the mean, 0 to 1. sizes, shares: as in respond_group. scales:
// (sigma_w at the start, at the end, sigma_d likewise).
__kernel void respond_ends(__global const int *groups, __global const float *r,
                           __global const int2 *partners, int count, float share,
                           float width_exponent, float depth_exponent,
#ifdef SHARED
                           __global const float4 *sizes, __global const float2 *shares,
#endif
                           __global float4 *scales)
{
#ifndef SHARED
    __global const float4 *sizes = 0;
    __global const float2 *shares = 0;
#endif
    const int first = first_in_group(groups), last = count - 1 - first;
    if (last < 0)
        return;
    if (partners)
        partners += first;
    if (last < LANES - 1)
        respond_group(first, last, group_ends(r, partners, share, first, last), width_exponent,
                      depth_exponent, sizes, shares, scales);
    else // no lane looks whether it is beyond the end
        respond_group(first, LANES - 1, group_ends(r, partners, share, first, LANES - 1),
                      width_exponent, depth_exponent, sizes, shares, scales);
}

// r at both ends, (start, end), of `count` wrinkles, and behind them that of none: 0. partners, share: as
// in respond_ends.
__kernel void end_stretches(__global const float *r, __global const int2 *partners, int count,
                            float share, __global float2 *ends)
{
    int first = get_global_id(0) * LANES;
    for (int i = first; i < min(first + LANES, count); i++) {
        int2 partner = partners ? partners[i] : (int2)(-1);
        ends[i] = at_ends(r, i, partner, share);
    }
    if (first <= count && count < first + LANES)
        ends[count] = (float2)(0.0f);
}
