// How a drawn neutral changes with the weights and sizes of its wrinkles and pores, summed against what
// it differs from a scan: one step of least squares by the diagonal. Coordinates are texels of the square,
// x right and y down; heights are in depths.

#define SHARPNESS 20.0f // of the mellow-max by which narrow heights meet

// How much of a change shows under deeper heights: own and met, of all, are depths.
inline float8 shown(float8 own, float8 met)
{
    return exp(SHARPNESS * min(own - met, 0.0f));
}

#define LANES 8 // texels of a row that are summed at once: most wrinkles are broader than four

typedef struct {
    float8 left, square;
} sums_t;

// Sums over texels of one unknown: J r and J J, with J how the height changes.
inline void add_lanes(sums_t *sums, float8 change, float8 left)
{
    sums->left += change * left;
    sums->square += change * change;
}

inline float all_lanes(float8 v)
{
    float4 half_of = v.lo + v.hi;
    return half_of.x + half_of.y + half_of.z + half_of.w;
}

// J r and J J of two unknowns.
inline float4 totals(sums_t one, sums_t two)
{
    return (float4)(all_lanes(one.left), all_lanes(one.square), all_lanes(two.left), all_lanes(two.square));
}

// shape: (bulge, least half width, share of the broad layer, how many times as wide it is).
// fades_at: weight up to which there is no broad layer; from twice as much on it is there in full.
// segments: start and extent.  sizes: half widths, then weights at both ends.  slopes: of arcs, to the left of the
// extent with y up.  left, met: of each texel of `side` columns and a row more, what the scan is above the
// drawing, and how deep the narrow valleys of that are.  found: J r and J J of the weight at the start and at
// the end, then of the logarithms of both half widths. Relative error below 1e-4 of the sums of magnitudes.
__kernel void fit_wrinkles(int first, int count, __global const float4 *segments,
                           __global const float4 *sizes, __global const float2 *slopes,
                           float4 shape, float fades_at, __global const float *left, __global const float *met,
                           int side, __global float8 *found)
{
    const float8 lane = {0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f};
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    float2 start = segments[i].xy, e = segments[i].zw, slope = slopes[i];
    float4 size = sizes[i];
    float square = dot(e, e), length = sqrt(square), broad = shape.z;
    float fade = broad > 0.0f ? clamp(0.5f * (size.z + size.w) / fades_at - 1.0f, 0.0f, 1.0f) : 0.0f;
    float wider = fade > 0.0f ? shape.w : 1.0f;
    float reach = max(max(size.x, size.y), shape.y) * wider +
                  0.15f * length * max(fabs(slope.x), fabs(slope.y));
    float2 stop = start + e, low = min(start, stop) - reach, high = max(start, stop) + reach;
    int x0 = max((int)ceil(low.x), 0), x1 = min((int)floor(high.x), side - 1);
    int y0 = max((int)ceil(low.y), 0), y1 = min((int)floor(high.y), side - 1);
    float2 forward = e / square, left_of = (float2)(-e.y, e.x) / length;
    float outside = 1.0f / (shape.w * shape.w);
    sums_t start_weight = {(float8)(0.0f), (float8)(0.0f)}, end_weight = start_weight;
    sums_t start_width = start_weight, end_width = start_weight;
    for (int y = y0; y <= y1; y++)
        for (int x = x0; x <= x1; x += LANES) {
            float8 dx = lane + (x - start.x);
            float dy = y - start.y;
            float8 along = dx * forward.x + dy * forward.y, s = clamp(along, 0.0f, 1.0f), near = 1.0f - s;
            float8 arc = length * s * near * (slope.x * near - slope.y * s);
            float8 aside = dx * left_of.x + dy * left_of.y + arc, beyond = (along - s) * length;
            float8 width = size.x * near + size.y * s, drawn = max(width, shape.y), once = 1.0f / drawn;
            float8 away2 = (aside * aside + beyond * beyond) * once * once;
            int8 here = (away2 < wider * wider) & (lane <= (float)(x1 - x));
            if (!any(here))
                continue;
            float8 r = vload8(0, left + y * side + x), weight = size.z * near + size.w * s;
            float8 by_weight = (float8)(0.0f), by_width = by_weight;
            // Below the least half width a line is drawn shallower, not narrower.
            int8 held = width < shape.y;
            if (any(away2 < 1.0f)) {
                float8 thin = width * once, inside = max(1.0f - away2, 0.0f), t2 = min(away2, 1.0f);
                float8 profile = inside * inside * (1.0f - shape.x * t2) * thin;
                float8 steep = -inside * (2.0f * (1.0f - shape.x * t2) + shape.x * inside) * thin;
                float8 own = (1.0f - broad) * weight * fabs(profile);
                float8 share = (1.0f - broad) * shown(own, vload8(0, met + y * side + x));
                by_weight = share * profile;
                by_width = share * weight * select(-2.0f * t2 * steep, profile, held);
            }
            if (fade > 0.0f) {
                float8 b2 = min(away2 * outside, 1.0f), in = 1.0f - b2;
                by_weight += broad * fade * in * in;
                by_width += select(4.0f * broad * fade * weight * b2 * in, (float8)(0.0f), held);
            }
            by_weight = select((float8)(0.0f), by_weight, here);
            by_width = select((float8)(0.0f), by_width / width, here);
            add_lanes(&start_weight, -by_weight * near, r);
            add_lanes(&end_weight, -by_weight * s, r);
            add_lanes(&start_width, -by_width * near * size.x, r);
            add_lanes(&end_width, -by_width * s * size.y, r);
        }
    found[i] = (float8)(totals(start_weight, end_weight), totals(start_width, end_width));
}

// Of pores without a bulge. centres: texels.  roots: (xx, xy, yy, weight) with y up, as redraw.cl has them.
// narrow: share of their weight that is drawn.  found: J r and J J of the weight, then of the logarithm of
// the size.
__kernel void fit_pores(int first, int count, __global const float2 *centres,
                        __global const float4 *roots, __global const float *left,
                        __global const float *met, int side, __global float4 *found)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    float4 root = roots[i];
    float2 centre = centres[i];
    float2 reach = (float2)(length(root.yz) / root.x, 1.0f) / root.z;
    int x0 = max((int)ceil(centre.x - reach.x), 0), x1 = min((int)floor(centre.x + reach.x), side - 1);
    int y0 = max((int)ceil(centre.y - reach.y), 0), y1 = min((int)floor(centre.y + reach.y), side - 1);
    const float8 lane = {0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f};
    sums_t weight = {(float8)(0.0f), (float8)(0.0f)}, size = weight;
    for (int y = y0; y <= y1; y++)
        for (int x = x0; x <= x1; x += LANES) {
            float8 dx = lane + (x - centre.x);
            float dy = centre.y - y;
            float8 gx = root.x * dx + root.y * dy;
            float gy = root.z * dy;
            float8 t2 = min(gx * gx + gy * gy, 1.0f), inside = 1.0f - t2;
            inside = select((float8)(0.0f), inside, lane <= (float)(x1 - x));
            float8 own = root.w * inside * inside, share = shown(own, vload8(0, met + y * side + x));
            float8 r = vload8(0, left + y * side + x);
            add_lanes(&weight, -share * inside * inside, r);
            add_lanes(&size, -4.0f * share * root.w * t2 * inside, r);
        }
    found[i] = totals(weight, size);
}
