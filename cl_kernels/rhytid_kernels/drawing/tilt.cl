// Draws where between the edges of its bin in angle the wrinkle at each texel runs, as codes: a map of one
// orientation bin, as bins.cl has them. Blocks and sums as in redraw.cl.
#include "codes.clh"
#include "line.clh"
#include "shared_sizes.clh"
#include "vectors.clh"

// The bin is drawn twice at once, with the depths of its wrinkles scaled by 1 + share delta and by
// 1 - share delta. Of a lone wrinkle the difference over the sum is its share delta; where wrinkles meet,
// the mean that counts for the height. Without BULGING no profile changes sign, and there are no bulges.
#if BULGING
#define SUMS_EACH (2 * SUMS)
#define PART BOTH_PARTS
#else
#define SUMS_EACH SUMS
#define PART VALLEYS
#endif

inline sums_t tilted_sums(place_t place, __local float *memory)
{
    sums_t sums = {memory, memory + SUMS_EACH - SUMS, get_local_id(0), place.low};
    clear_sums(sums);
    return sums;
}

// Where in its bin a wrinkle along `extent` runs: its angle to theta, mod pi, times a factor. An arc leans
// as its segment does. tilt: (theta, factor).
inline float leaning(float2 extent, float3 tilt)
{
    float along = dot(extent, tilt.xy), across = extent.x * tilt.y - extent.y * tilt.x;
    return atan(across / along) * tilt.z;
}

// 0 where there is no height. high, low: mesh units.
inline float8 tilts_of(float8 high, float8 low, float share)
{
    float8 sum = high + low, delta = (high - low) / (sum * share);
    return clamp(select(delta, (float8)(0.0f), sum == 0.0f), -1.0f, 1.0f);
}

// scale: (sigma_w, sigma_d) that all is drawn at. tilt: (theta, share over half a bin, share). map: as
// code_place has it. The rest is as in bins.cl.
__kernel void draw_tilts(LINES, SHARES __global const uchar *bins, int bin, float2 scale, float4 tilt,
                         __global const int *offsets, __global const int *members,
                         float4 shape_values, float least, float depth, int blocks, int row,
                         int column, int2 map, __global CODE *codes)
{
    __local float memory[2 * SUMS_EACH];
    shape_t shape = shape_of(shape_values);
    place_t place = place_of_group(blocks, row, column);
    sums_t high = tilted_sums(place, memory), low = tilted_sums(place, memory + SUMS_EACH);
    ready_t deeper[BATCH], shallower[BATCH];
    int count = 0, end = offsets[place.block + 1];
    for (int k = offsets[place.block]; k < end; k++) {
        int i = members[k];
        if (bins[i] == bin) {
            float lean = leaning(segments[i].zw, tilt.xyz);
            float2 more = (float2)(scale.x, scale.y * (1.0f + lean));
            float2 less = (float2)(scale.x, scale.y * (1.0f - lean));
            line_t deep = LINE_AT(i, SIZES_OF(i) * SCALES(more), place.corner, least);
            line_t shallow = LINE_AT(i, SIZES_OF(i) * SCALES(less), place.corner, least);
            deeper[count] = ready_line(high, deep, shape);
            shallower[count] = ready_line(low, shallow, shape);
            count += !is_empty(deeper[count].box);
        }
        if (count == BATCH || k == end - 1) {
            for (int j = 0; j < count; j++) {
                draw_ready_line(high, &deeper[j], shape.wrinkle_bulge);
                draw_ready_line(low, &shallower[j], shape.wrinkle_bulge);
            }
            count = 0;
        }
    }
    for (int y = first_owned(high, high.low); y < high.low + ROWS; y += ITEMS)
        for (int x = 0; x < BLOCK; x += LANES) {
            float8 up = depth * heights_at(high, x, y, shape, PART);
            float8 down = depth * heights_at(low, x, y, shape, PART);
            size_t at = code_place(place.at + y * place.above + x, map);
            vstore8(CODES8(tilts_of(up, down, tilt.w), CODE_LIMIT), 0, codes + at);
        }
}
