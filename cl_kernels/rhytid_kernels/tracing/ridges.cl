// Valley lines and pits of a relief at one scale, by the curvatures of the relief after a Gaussian of that
// scale (Steger 1998, "An unbiased detector of curvilinear structures"; Lindeberg 1998 for the choice of
// scale). A tile is padded by `radius` texels or more; rows run down, so that y is down. A vector of texels
// per work-item.
#include "vectors.clh"

// Sums of a row with the Gaussian and its first two derivatives. relief: `width` texels a row.  taps: of
// the orders 0, 1 and 2, each from -radius to radius.  apron: texels around the tile.  out: three planes of
// `side` columns, a multiple of WIDTH, in the order of the taps. Relative error of the sums below 1e-5 of
// the sum of magnitudes.
__kernel void rows_of_relief(int first, int count, __global const float *relief, int width, int side,
                             int apron, int radius, __global const float *taps, __global float *out)
{
    int i = first + get_global_id(0), across = side / WIDTH;
    if (i >= count)
        return;
    __global const float *at = relief + i / across * width + i % across * WIDTH + apron - radius;
    int most = 2 * radius + 1;
    float16 even = (float16)(0.0f), once = (float16)(0.0f), twice = (float16)(0.0f);
    for (int k = 0; k < most; k++) {
        float16 value = vload16(0, at + k);
        even += value * taps[k];
        once += value * taps[most + k];
        twice += value * taps[2 * most + k];
    }
    vstore16(even, i, out);
    vstore16(once, count + i, out);
    vstore16(twice, 2 * count + i, out);
}

// Curvatures of the smoothed relief: larger, smaller, and the angle across the valley, from x towards y.
typedef struct {
    float16 larger, smaller, angle;
} curvature_t;

inline curvature_t curvature_of(float16 xx, float16 xy, float16 yy)
{
    float16 mean = 0.5f * (xx + yy), half_gap = 0.5f * (xx - yy);
    float16 apart = sqrt(half_gap * half_gap + xy * xy);
    curvature_t c = {mean + apart, mean - apart, 0.5f * atan2(xy, half_gap)};
    return c;
}

// Writes four values of the texels `where` to four planes of `plane` texels.
inline void keep(__global float *at, int plane, int16 where, float16 strength, float16 angle, float16 third,
                 float16 scale)
{
    vstore16(select(vload16(0, at), strength, where), 0, at);
    vstore16(select(vload16(0, at + plane), angle, where), 0, at + plane);
    vstore16(select(vload16(0, at + 2 * plane), third, where), 0, at + 2 * plane);
    vstore16(select(vload16(0, at + 3 * plane), scale, where), 0, at + 3 * plane);
}

// Keeps what answers strongest so far. planes: of rows_of_relief, with `rows` rows.  scale: of the Gaussian,
// texels.  line_share, pit_share: factors of the curvatures that make scales comparable, or 0 for a scale at
// which there is nothing to be found.  lines: planes of strength, angle across, way to the bottom of the
// valley in texels, scale.  pits: strength, angle of the larger curvature, smaller over larger, scale.
__kernel void ridges_at_scale(int first, int count, __global const float *planes, int rows, int side,
                              int apron, int radius, __global const float *taps, float scale,
                              float line_share, float pit_share, __global float *lines,
                              __global float *pits)
{
    int i = first + get_global_id(0), across = side / WIDTH;
    if (i >= count)
        return;
    int start = (i / across + apron - radius) * side + i % across * WIDTH, plane = side * rows;
    int most = 2 * radius + 1;
    float16 x = (float16)(0.0f), y = x, xx = x, xy = x, yy = x;
    for (int k = 0; k < most; k++) {
        __global const float *at = planes + start + k * side;
        float16 even = vload16(0, at), once = vload16(0, at + plane), twice = vload16(0, at + 2 * plane);
        x += taps[k] * once;
        xx += taps[k] * twice;
        y += taps[most + k] * even;
        xy += taps[most + k] * once;
        yy += taps[2 * most + k] * even;
    }
    curvature_t c = curvature_of(xx, xy, yy);
    lines += i * WIDTH;
    pits += i * WIDTH;
    if (line_share > 0.0f) {
        float16 ahead = cos(c.angle), aside = sin(c.angle), strength = line_share * c.larger;
        // All around a pit the walls curve more across the way down than along it, and are no valleys: at a
        // distance r from its bottom they are as steep as r times that curvature.
        int16 here = (strength > vload16(0, lines)) & (fabs(y * ahead - x * aside) <= scale * c.larger);
        keep(lines, count * WIDTH, here, strength, c.angle, -(x * ahead + y * aside) / c.larger,
             (float16)(scale));
    }
    float16 strength = pit_share * c.smaller;
    keep(pits, count * WIDTH, strength > vload16(0, pits), strength, c.angle, c.smaller / c.larger,
         (float16)(scale));
}
