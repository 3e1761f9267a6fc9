// Folds of the mesh itself, and the log stretch that they leave to lines (pipeline/folding.py). Places
// are vertices, those at one place once; members: the triangles around each, listed by offsets. wanted: the
// numbers of triangles or places that are found, or NULL for all.

#define LEAST_SQUARE 1e-12f // of a stretch ratio: of a triangle that is pressed to nothing

inline int one_of(__global const int *wanted)
{
    int i = get_global_id(0);
    return wanted ? wanted[i] : i;
}

// normals: of each place the unit sum of the cross products of its triangles, in xyz; 0 without any.
// per_length: 1 over the length of a fold, so that nothing under- or overflows.
__kernel void place_normals(__global const int *wanted, __global const float *positions,
                            __global const int *faces, __global const int *offsets,
                            __global const int *members, float per_length,
                            __global float4 *normals)
{
    int w = one_of(wanted);
    float3 sum = (float3)(0.0f);
    for (int k = offsets[w]; k < offsets[w + 1]; k++) {
        int t = members[k];
        float3 p = vload3(faces[3 * t], positions);
        float3 one = vload3(faces[3 * t + 1], positions) - p;
        float3 two = vload3(faces[3 * t + 2], positions) - p;
        sum += cross(one * per_length, two * per_length);
    }
    float size = length(sum);
    normals[w] = size > 0.0f ? (float4)(sum / size, 0.0f) : (float4)(0.0f);
}

// The first round of smoothing: of the moments of triangles, means over those of each place.
__kernel void gathered(__global const int *wanted, __global const int *offsets,
                       __global const int *members, __global const float *shares,
                       __global const float2 *of_triangles, __global float2 *of_places)
{
    int w = one_of(wanted);
    float2 sum = (float2)(0.0f);
    for (int k = offsets[w]; k < offsets[w + 1]; k++)
        sum += shares[k] * of_triangles[members[k]];
    of_places[w] = sum;
}

// A further round: means over triangles of the means of their corners. A third is that of the place
// itself, the rest of places beside it, which share the triangles.
#define SMOOTHED(name, VALUES)                                                                     \
    __kernel void name(__global const int *wanted, __global const int *offsets,                    \
                       __global const int *beside, __global const float *shares,                   \
                       __global const VALUES *values, __global VALUES *found)                      \
    {                                                                                              \
        int w = one_of(wanted);                                                                    \
        VALUES sum = values[w] / 3.0f;                                                             \
        for (int k = offsets[w]; k < offsets[w + 1]; k++)                                          \
            sum += shares[k] * values[beside[k]];                                                  \
        found[w] = sum;                                                                            \
    }

SMOOTHED(smoothed, float2)         // moments
SMOOTHED(smoothed_normals, float4) // normals

typedef struct {
    float3 x, y; // tangents
} axes_t;

// What differences one and two along both edges come to along the axes of the neutral frame, whose x
// runs along the first edge; in units of `size`, the length of a fold. rest: as of stretch_tensor.
inline axes_t axes_of(float3 one, float3 two, float8 rest, float size)
{
    float x1 = rest.s0 * size, y2 = rest.s4 * size, y1 = -rest.s2 * y2;
    axes_t a = {x1 * one, y1 * one + y2 * two};
    return a;
}

// The axes of a deformed triangle: their products are the first fundamental form.
inline axes_t tangents(int t, __global const float *positions, __global const int *faces,
                       float8 rest, float size)
{
    float3 p = vload3(faces[3 * t], positions);
    float3 one = vload3(faces[3 * t + 1], positions) - p;
    float3 two = vload3(faces[3 * t + 2], positions) - p;
    return axes_of(one / size, two / size, rest, size);
}

// xx, xy and yy of the second form, in units of 1 over `size`.
inline float3 second_form(int t, axes_t a, __global const int *places, float8 rest,
                          __global const float4 *normals, float size)
{
    float3 n = normals[places[3 * t]].xyz;
    axes_t m = axes_of(normals[places[3 * t + 1]].xyz - n, normals[places[3 * t + 2]].xyz - n, rest,
                       size);
    return (float3)(dot(m.x, a.x), 0.5f * (dot(m.x, a.y) + dot(m.y, a.x)), dot(m.y, a.y));
}

// forms: the second form of the neutral, 0 for triangles without usable area.
__kernel void neutral_forms(__global const float *positions, __global const int *faces,
                            __global const int *places, __global const float8 *rest,
                            __global const float4 *normals, float size, __global float4 *forms)
{
    int t = get_global_id(0);
    forms[t] = (float4)(0.0f);
    if (rest[t].s0 == 0.0f)
        return;
    axes_t a = tangents(t, positions, faces, rest[t], size);
    forms[t] = (float4)(second_form(t, a, places, rest[t], normals, size), 0.0f);
}

// A form xx, xy, yy along both axes of stretch; turn: cosine and sine of twice the first one's angle.
inline float2 along(float3 form, float2 turn)
{
    float mean = 0.5f * (form.x + form.z);
    float part = 0.5f * (form.x - form.z) * turn.x + form.y * turn.y;
    return (float2)(mean + part, mean - part);
}

// Log compression, 0 to 1, of a squared ratio. A logarithm costs as much as all else of a triangle.
inline float compression(float square)
{
    return square < 1.0f ? fmin(-0.5f * log(square), 1.0f) : 0.0f;
}

// moments: b and b^2 of each triangle. b = sum c_i (k'_i - k_i), with c the log compression along the
// axes of stretch, at most 1, and k the curvatures along them before and after, times `size` and
// within +-most; 0 where neither axis is compressed. Where both are alike b hangs on no axis.
// Error below 1e-4 (1 + |b|) where no angle of the neutral is below 5 degrees.
__kernel void bends(__global const int *wanted, __global const float *positions,
                    __global const int *faces, __global const int *places,
                    __global const float8 *rest, __global const float4 *normals,
                    __global const float4 *forms, float size, float most, __global float2 *moments)
{
    int t = one_of(wanted);
    moments[t] = (float2)(0.0f);
    if (rest[t].s0 == 0.0f)
        return;
    axes_t a = tangents(t, positions, faces, rest[t], size);
    float3 g = (float3)(dot(a.x, a.x), dot(a.x, a.y), dot(a.y, a.y));
    float mean = 0.5f * (g.x + g.z), apart = 0.5f * (g.x - g.z);
    float radius = sqrt(apart * apart + g.y * g.y);
    float first = mean + radius;
    float second = first > 0.0f ? (g.x * g.z - g.y * g.y) / first : 0.0f;
    if (second >= 1.0f) // the other is no less
        return;
    float2 turn = radius > 0.0f ? (float2)(apart, g.y) / radius : (float2)(0.0f);
    float2 square = fmax((float2)(first, second), LEAST_SQUARE);
    float2 pressed = (float2)(compression(square.x), compression(square.y));
    float3 form = second_form(t, a, places, rest[t], normals, size);
    float2 bent = along(form, turn) / square - along(forms[t].xyz, turn);
    float b = dot(pressed, fmin(fmax(bent, -most), most));
    moments[t] = (float2)(b, b * b);
}

// The share of a compression that folds take: m (1 - (1 + t)^(-1/4)), t what of the variance of b is
// above `least`.
inline float share_of(float2 moments, float most, float least)
{
    float variance = fmax(moments.y - moments.x * moments.x - least, 0.0f);
    return most * (1.0f - 1.0f / sqrt(sqrt(1.0f + variance)));
}

// taken: of each triangle, the mean of its places, and 0 for points in none, of which nothing is taken
// where they are wanted more than once. logs: in place.
__kernel void take_shares(__global const int *wanted, __global const int *places,
                          __global const float2 *moments, int triangles, float most, float least,
                          __global float2 *logs, __global float *taken)
{
    int t = one_of(wanted);
    float share = 0.0f;
    if (t < triangles)
        share = (share_of(moments[places[3 * t]], most, least) +
                 share_of(moments[places[3 * t + 1]], most, least) +
                 share_of(moments[places[3 * t + 2]], most, least)) / 3.0f;
    float2 r = logs[t];
    logs[t] = r - share * fmin(r, 0.0f);
    taken[t] = share;
}

// The same for the tension of vertices, a ratio, in place. place: of each vertex.
__kernel void take_tension(__global const int *place, __global const float2 *moments, float most,
                           float least, __global float *tension)
{
    int v = get_global_id(0);
    float rho = tension[v];
    if (rho > 0.0f && rho < 1.0f)
        tension[v] = pow(rho, 1.0f - share_of(moments[place[v]], most, least));
}
