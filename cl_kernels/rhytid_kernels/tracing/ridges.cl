// Valley lines and pits of a relief at one scale, by the curvatures of the relief after a Gaussian of that
// scale (Steger 1998, "An unbiased detector of curvilinear structures"; Lindeberg 1998 for the choice of
// scale). A tile is padded by `radius` texels or more; rows run down, so that y is down.

// Sums of a row with the Gaussian and its first two derivatives. relief: `width` texels a row.  taps: of
// the orders 0, 1 and 2, each from -radius to radius.  apron: texels around the tile.  out: three planes of
// `side` columns and `width` rows, in the order of the taps. Relative error of the sums below 1e-5 of the
// sum of magnitudes.
__kernel void rows_of_relief(int first, int count, __global const float *relief, int width, int side,
                             int apron, int radius, __global const float *taps, __global float *out)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    __global const float *at = relief + i / side * width + i % side + apron - radius;
    int most = 2 * radius + 1;
    float3 sums = (float3)(0.0f);
    for (int k = 0; k < most; k++)
        sums += at[k] * (float3)(taps[k], taps[most + k], taps[2 * most + k]);
    out[i] = sums.x;
    out[count + i] = sums.y;
    out[2 * count + i] = sums.z;
}

// Curvatures of the smoothed relief: larger, smaller, and the angle across the valley, from x towards y.
typedef struct {
    float larger, smaller, angle;
} curvature_t;

inline curvature_t curvature_of(float xx, float xy, float yy)
{
    float mean = 0.5f * (xx + yy), half_gap = 0.5f * (xx - yy);
    float apart = sqrt(half_gap * half_gap + xy * xy);
    curvature_t c = {mean + apart, mean - apart, 0.5f * atan2(xy, half_gap)};
    return c;
}

// Keeps what answers strongest so far. planes: of rows_of_relief.  scale: of the Gaussian, texels.
// line_share, pit_share: factors of the curvatures that make scales comparable, or 0 for a scale at which
// there is nothing to be found.  lines: (strength, angle across, way to the bottom of the valley in
// texels, scale).  pits: (strength, angle of the larger curvature, smaller over larger, scale).
__kernel void ridges_at_scale(int first, int count, __global const float *planes, int width, int side,
                              int apron, int radius, __global const float *taps, float scale,
                              float line_share, float pit_share, __global float4 *lines,
                              __global float4 *pits)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int start = (i / side + apron - radius) * side + i % side, plane = side * width;
    int most = 2 * radius + 1;
    float x = 0.0f, y = 0.0f, xx = 0.0f, xy = 0.0f, yy = 0.0f;
    for (int k = 0; k < most; k++) {
        int at = start + k * side;
        float even = planes[at], once = planes[plane + at], twice = planes[2 * plane + at];
        x += taps[k] * once;
        xx += taps[k] * twice;
        y += taps[most + k] * even;
        xy += taps[most + k] * once;
        yy += taps[2 * most + k] * even;
    }
    curvature_t c = curvature_of(xx, xy, yy);
    float ahead = cos(c.angle), aside = sin(c.angle), strength = line_share * c.larger;
    // All around a pit the walls curve more across the way down than along it, and are no valleys: at a
    // distance r from its bottom they are as steep as r times that curvature.
    if (strength > lines[i].x && fabs(y * ahead - x * aside) <= scale * c.larger) {
        float to_bottom = -(x * ahead + y * aside) / c.larger;
        lines[i] = (float4)(strength, c.angle, to_bottom, scale);
    }
    strength = pit_share * c.smaller;
    if (strength > pits[i].x)
        pits[i] = (float4)(strength, c.angle, c.smaller / c.larger, scale);
}
