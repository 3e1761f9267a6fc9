// How a drawn neutral changes with the weights and sizes of its wrinkles and pores, summed against what
// it differs from a scan: one step of least squares by the diagonal. Coordinates are texels of the square,
// x right and y down; heights are in depths.

#define SHARPNESS 20.0f // of the mellow-max by which narrow heights meet

// Sums over texels of one unknown: J r and J J, with J how the height changes.
inline void add_to(float2 *sums, float change, float left)
{
    *sums += (float2)(change * left, change * change);
}

// How much of a change shows under deeper heights: own, met (of all) below 0 are depths.
inline float shown(float own, float met)
{
    return exp(SHARPNESS * min(own - met, 0.0f));
}

// shape: (bulge, least half width, share of the broad layer, how many times as wide it is).
// fades_at: weight up to which there is no broad layer; from twice as much on it is there in full.
// segments: start and extent.  sizes: half widths, then weights at both ends.  slopes: of arcs, to the left of the
// extent with y up.  left, met: of each texel of `side` columns, what the scan is above the drawing, and how
// deep the narrow valleys of that are.  found: J r and J J of the weight at the start and at the end,
// then of the logarithms of both half widths. Relative error below 1e-4 of the sums of magnitudes.
__kernel void fit_wrinkles(int first, int count, __global const float4 *segments,
                           __global const float4 *sizes, __global const float2 *slopes,
                           float4 shape, float fades_at, __global const float *left, __global const float *met,
                           int side, __global float8 *found)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    float2 start = segments[i].xy, e = segments[i].zw, slope = slopes[i];
    float4 size = sizes[i];
    float square = dot(e, e), length = sqrt(square), broad = shape.z;
    float fade = broad > 0.0f ? clamp(0.5f * (size.z + size.w) / fades_at - 1.0f, 0.0f, 1.0f) : 0.0f;
    float reach = max(max(size.x, size.y), shape.y) * (fade > 0.0f ? shape.w : 1.0f) +
                  0.15f * length * max(fabs(slope.x), fabs(slope.y));
    float2 stop = start + e, low = min(start, stop) - reach, high = max(start, stop) + reach;
    int x0 = max((int)ceil(low.x), 0), x1 = min((int)floor(high.x), side - 1);
    int y0 = max((int)ceil(low.y), 0), y1 = min((int)floor(high.y), side - 1);
    float2 sums[4] = {(float2)(0.0f), (float2)(0.0f), (float2)(0.0f), (float2)(0.0f)};
    for (int y = y0; y <= y1; y++)
        for (int x = x0; x <= x1; x++) {
            float2 d = (float2)(x, y) - start;
            float along = dot(d, e) / square, s = clamp(along, 0.0f, 1.0f);
            float arc = length * s * (1.0f - s) * (slope.x * (1.0f - s) - slope.y * s);
            float aside = (e.y * d.x - e.x * d.y) / length - arc, beyond = (along - s) * length;
            float width = mix(size.x, size.y, s), drawn = max(width, shape.y), thin = width / drawn;
            float weight = mix(size.z, size.w, s), away = aside * aside + beyond * beyond;
            float t2 = min(away / (drawn * drawn), 1.0f), inside = 1.0f - t2;
            float profile = inside * inside * (1.0f - shape.x * t2) * thin;
            float steep = -inside * (2.0f * (1.0f - shape.x * t2) + shape.x * inside) * thin;
            float share = (1.0f - broad) * shown((1.0f - broad) * weight * fabs(profile), met[y * side + x]);
            // Below the least half width a line is drawn shallower, not narrower.
            bool held = width < shape.y;
            float by_weight = share * profile;
            float by_width = share * weight * (held ? profile : -2.0f * t2 * steep);
            if (fade > 0.0f) {
                float b2 = min(away / (drawn * drawn * shape.w * shape.w), 1.0f), in = 1.0f - b2;
                by_weight += broad * fade * in * in;
                by_width += held ? 0.0f : 4.0f * broad * fade * weight * b2 * in;
            }
            float r = left[y * side + x], near = 1.0f - s;
            add_to(&sums[0], -by_weight * near, r);
            add_to(&sums[1], -by_weight * s, r);
            add_to(&sums[2], -by_width * near * size.x / width, r);
            add_to(&sums[3], -by_width * s * size.y / width, r);
        }
    found[i] = (float8)(sums[0], sums[1], sums[2], sums[3]);
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
    float2 by_weight = (float2)(0.0f), by_size = (float2)(0.0f);
    for (int y = y0; y <= y1; y++)
        for (int x = x0; x <= x1; x++) {
            float dx = x - centre.x, dy = centre.y - y;
            float gx = root.x * dx + root.y * dy, gy = root.z * dy;
            float t2 = min(gx * gx + gy * gy, 1.0f), profile = (1.0f - t2) * (1.0f - t2);
            float share = shown(root.w * profile, met[y * side + x]);
            float r = left[y * side + x];
            add_to(&by_weight, -share * profile, r);
            add_to(&by_size, -4.0f * share * root.w * t2 * (1.0f - t2), r);
        }
    found[i] = (float4)(by_weight, by_size);
}
