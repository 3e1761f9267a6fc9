// Scales at the two ends of wrinkles that bend, from r of every wrinkle: at an end that another wrinkle
// continues r goes from its own towards the mean of both, so that a line has no step there. With SHARED
// wrinkles have shares of the shortening of skin.
#include "groups.clh"
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

// A work-item takes a group of wrinkles. groups: as in first_in_group. partners: of each at its start
// and at its end, or NULL. share: of the way to the mean, 0 to 1. sizes: half widths, then weights at
// both ends; shares: likewise. scales: (sigma_w at the start, at the end, sigma_d likewise).
__kernel void respond_ends(__global const int *groups, __global const float *r,
                           __global const int2 *partners, int count, float share,
                           float width_exponent, float depth_exponent,
#ifdef SHARED
                           __global const float4 *sizes, __global const float2 *shares,
#endif
                           __global float4 *scales)
{
    int first = first_in_group(groups);
    float start[LANES], end[LANES], found[4][LANES];
#ifdef SHARED
    float share_at_start[LANES], share_at_end[LANES], most_at_start[LANES], most_at_end[LANES];
#endif
    for (int lane = 0; lane < LANES; lane++) {
        int i = min(first + lane, count - 1);
        int2 partner = partners ? partners[i] : (int2)(-1);
        float2 ends = at_ends(r, i, partner, share);
        start[lane] = ends.x;
        end[lane] = ends.y;
#ifdef SHARED
        share_at_start[lane] = shares[i].x;
        share_at_end[lane] = shares[i].y;
        most_at_start[lane] = MOST_SHARED(sizes[i].z);
        most_at_end[lane] = MOST_SHARED(sizes[i].w);
#endif
    }
    float16 at_start = vload16(0, start), at_stop = vload16(0, end);
    vstore16(SCALE(power16, at_start, width_exponent, SCALE_LIMIT), 0, found[0]);
    vstore16(SCALE(power16, at_stop, width_exponent, SCALE_LIMIT), 0, found[1]);
    float16 depth_at_start = SCALE(power16, at_start, -depth_exponent, SCALE_LIMIT);
    float16 depth_at_stop = SCALE(power16, at_stop, -depth_exponent, SCALE_LIMIT);
#ifdef SHARED
    depth_at_start *= SHARED_DEPTH(at_start, depth_exponent, vload16(0, share_at_start));
    depth_at_stop *= SHARED_DEPTH(at_stop, depth_exponent, vload16(0, share_at_end));
    depth_at_start = min(depth_at_start, vload16(0, most_at_start));
    depth_at_stop = min(depth_at_stop, vload16(0, most_at_end));
#endif
    vstore16(depth_at_start, 0, found[2]);
    vstore16(depth_at_stop, 0, found[3]);
    for (int lane = 0; lane < min(LANES, count - first); lane++)
        scales[first + lane] =
            (float4)(found[0][lane], found[1][lane], found[2][lane], found[3][lane]);
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
