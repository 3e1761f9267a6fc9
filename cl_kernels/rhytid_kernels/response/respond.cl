// Width and depth scales of every wrinkle and pore of a frame (Alg. 1 and 2). A work-item takes LANES
// of them.
#include "lanes.clh"
#include "response.clh"
#define LEAST_SQUARE 1e-30f // below that of any wrinkle: one of no length runs nowhere

POWER_OF_TWO(power16, float16, int16)

// Of a lane of a group: where its element runs, and what it samples.
#define SEGMENT(lane) segments[AT(lane)]
#define AXES(lane) axes[triangle[AT(lane)]]
#define LOGS(lane) logs[triangle[AT(lane)]]
#define STIFFNESS(lane) stiffness[AT(lane)]

// Stores (sigma_w, sigma_d) of a group. Forced into its caller: PoCL calls it else, and finds the log of the
// limit anew for each group.
inline __attribute__((always_inline)) void store_scales(float16 r, float width_exponent,
                                                        float depth_exponent, float depth_limit,
                                                        int last, __global float2 *scales)
{
    const float log_of_limit = LOG2_OF(depth_limit);
    store_pairs(SCALE(power16, r, width_exponent, SCALE_LIMIT),
                SCALE_BELOW(power16, r, -depth_exponent, depth_limit, log_of_limit), last,
                (__global float *)scales);
}

typedef struct {
    quads_t segments, axes;
    pairs_t logs;
} sampled_t;

// What a group of wrinkles has. Forced into its caller, where `last` may be known to the compiler.
inline __attribute__((always_inline)) sampled_t sampled(__global const float4 *segments,
                                                        __global const int *triangle,
                                                        __global const float4 *axes,
                                                        __global const float2 *logs, int last)
{
    sampled_t s = {QUADS(SEGMENT), QUADS(AXES), PAIRS(LOGS)};
    return s;
}

// groups: as in first_in_group. triangle: what the centre of each wrinkle samples. jacobians: NULL for
// angles in UV. stiffness: of each wrinkle, or NULL. found: see RESPONSE.
__kernel void respond_wrinkles(__global const int *groups, __global const float4 *segments,
                               __global const int *triangle, __global const float4 *axes,
                               __global const float2 *logs, __global const float4 *jacobians,
                               __global const float *stiffness, int count, float width_exponent,
                               float depth_exponent, __global RESPONSE *found)
{
    const int first = first_in_group(groups), last = count - 1 - first;
    if (last < 0)
        return;
    segments += first;
    triangle += first;
    // All groups but the last are whole: no lane of theirs looks whether it is beyond the end.
    const sampled_t own = last < LANES - 1 ? sampled(segments, triangle, axes, logs, last)
                                           : sampled(segments, triangle, axes, logs, LANES - 1);
    pairs_t theta = {own.segments.z, own.segments.w}, of = own.logs;
    quads_t axis = own.axes;
    if (jacobians) {
        float2 thetas[LANES];
        float4 both_axes[LANES];
        for (int lane = 0; lane < LANES; lane++) { // written out it is half of what a compiler does here
            const angles_t a = angles_in(triangle[AT(lane)], SEGMENT(lane).zw, axes, jacobians);
            thetas[lane] = a.theta;
            both_axes[lane] = a.axes;
        }
        const float *t = (const float *)thetas, *s = (const float *)both_axes;
        theta = pairs_of(vload16(0, t), vload16(1, t));
        axis = quads_of(vload16(0, s), vload16(1, s), vload16(2, s), vload16(3, s));
    }
    if (stiffness) {
        stiffness += first;
        const float16 stiff = SINGLES(STIFFNESS);
        of.x *= stiff;
        of.y *= stiff;
    }
    // As dot() has it, whose products are no fused ones.
    const float16 xx = theta.x * theta.x, yy = theta.y * theta.y;
    const float16 x1 = theta.x * axis.x, y1 = theta.y * axis.y;
    const float16 x2 = theta.x * axis.z, y2 = theta.y * axis.w;
    const float16 square = xx + yy, per_length = 1.0f / sqrt(square + LEAST_SQUARE);
    const float16 cosine1 = (x1 + y1) * per_length, cosine2 = (x2 + y2) * per_length;
    const float16 r = ACROSS(cosine1, cosine2, of.x, of.y);
#if BENT
    store_singles(r, last, found + first);
#else
    store_scales(r, width_exponent, depth_exponent, SCALE_LIMIT, last, found + first);
#endif
}

// Of pores. depth_limit: of sigma_d.
__kernel void respond_pores(__global const int *groups, __global const int *triangle,
                            __global const float2 *logs, __global const float *stiffness, int count,
                            float width_exponent, float depth_exponent, float depth_limit,
                            __global float2 *scales)
{
    const int first = first_in_group(groups), last = count - 1 - first;
    if (last < 0)
        return;
    triangle += first;
    const pairs_t of = PAIRS(LOGS);
    float16 r = 0.5f * (of.x + of.y);
    if (stiffness) {
        stiffness += first;
        r *= SINGLES(STIFFNESS);
    }
    store_scales(r, width_exponent, depth_exponent, depth_limit, last, scales + first);
}
