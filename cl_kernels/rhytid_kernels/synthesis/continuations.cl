// Which wrinkles continue one another: at each pore, pairs of strong ones that turn little, the best
// pair first. Both take one tangent there, so that they are one line. A work-item per pore.

#define NOTHING -1 // no wrinkle goes on, but others meet here
#define ALONE -2   // the wrinkle is the only one here

// The end of wrinkle `pair` that lies at pore i.
inline int end_at(int i, int pair, __global const int *nodes)
{
    return 2 * pair + (nodes[2 * pair] == i ? 0 : 1);
}

// offsets, pairs: the wrinkles at each pore. nodes: the two pores of each. way: of unit length, from
// the first pore to the second in space. weight: of each. normal: of each pore, unit length.
// triangle: of each end of a wrinkle; to_uv: of each the rows of the inverse of dX/d(u, v).
// out: of each end of a wrinkle the UV vector along it, away from its pore.
// least_cosine: of what continues one another, 1 where it goes straight on. steepest: of slopes.
// partner: of each end the end that continues it, or NOTHING, or ALONE. slope: of each end dy/dx of
// the common tangent against `out`, in UV.
__kernel void pair_lines(int first, int count, __global const int *offsets,
                         __global const int *pairs, __global const int *nodes,
                         __global const float *way, __global const float *weight,
                         __global const float *normal, __global const int *triangle,
                         __global const float *to_uv, __global const float2 *out,
                         float least_cosine, float steepest, __global int *partner,
                         __global float *slope)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    int lines = min(offsets[i + 1] - offsets[i], WAYS), end[WAYS];
    float3 along[WAYS], n = vload3(i, normal);
    for (int k = 0; k < lines; k++) {
        int pair = pairs[offsets[i] + k];
        end[k] = end_at(i, pair, nodes);
        float3 d = end[k] % 2 ? -vload3(pair, way) : vload3(pair, way);
        along[k] = normalize(d - dot(d, n) * n);
        partner[end[k]] = lines == 1 ? ALONE : NOTHING;
        slope[end[k]] = 0.0f;
    }
    for (;;) {
        float best = 0.0f;
        int one = -1, two = -1;
        for (int k = 0; k < lines; k++)
            for (int m = k + 1; m < lines; m++) {
                float cosine = -dot(along[k], along[m]);
                float score = min(weight[end[k] / 2], weight[end[m] / 2]) * cosine * cosine;
                if (partner[end[k]] < 0 && partner[end[m]] < 0 && cosine >= least_cosine &&
                    score > best) {
                    best = score;
                    one = k;
                    two = m;
                }
            }
        if (one < 0)
            return;
        partner[end[one]] = end[two];
        partner[end[two]] = end[one];
        float3 tangent = along[one] - along[two];
        for (int side = 0; side < 2; side++) {
            int at = end[side ? two : one];
            __global const float *rows = to_uv + 6 * triangle[at];
            float2 t = (float2)(dot(tangent, vload3(0, rows)), dot(tangent, vload3(1, rows)));
            float2 e = out[at], toward = side ? -t : t;
            float ahead = dot(e, toward), left = e.x * toward.y - e.y * toward.x;
            slope[at] = ahead > 0.0f ? clamp(left / ahead, -steepest, steepest) : 0.0f;
        }
    }
}
