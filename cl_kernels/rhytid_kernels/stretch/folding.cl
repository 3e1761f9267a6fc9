// Folds of the mesh itself, and the log stretch that they leave to lines (pipeline/folding.py). Places
// are vertices, those at one place once; members: the triangles around each, listed by offsets.

#define LEAST_SQUARE 1e-12f // of a stretch ratio: of a triangle that is pressed to nothing

// normals: of each place the unit sum of the cross products of its triangles, in xyz; 0 without any.
// per_length: 1 over the length of a fold, so that nothing under- or overflows.
__kernel void place_normals(__global const float *positions, __global const int *faces,
                            __global const int *offsets, __global const int *members,
                            float per_length, __global float4 *normals)
{
    int w = get_global_id(0);
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

// One round of smoothing is gathered and then spread: means over triangles, then over corners.
__kernel void gathered(__global const int *offsets, __global const int *members,
                       __global const float *shares, __global const float4 *of_triangles,
                       __global float4 *of_places)
{
    int w = get_global_id(0);
    float4 sum = (float4)(0.0f);
    for (int k = offsets[w]; k < offsets[w + 1]; k++)
        sum += shares[k] * of_triangles[members[k]];
    of_places[w] = sum;
}

inline float4 mean_of(int t, __global const int *places, __global const float4 *values)
{
    return (values[places[3 * t]] + values[places[3 * t + 1]] + values[places[3 * t + 2]]) / 3.0f;
}

__kernel void spread(__global const int *places, __global const float4 *of_places,
                     __global float4 *of_triangles)
{
    int t = get_global_id(0);
    of_triangles[t] = mean_of(t, places, of_places);
}

typedef struct {
    float3 metric, form; // xx, xy, yy
} surface_t;

// Both fundamental forms of a deformed triangle, along the axes of its neutral frame, whose x runs
// along its first edge; the second in units of 1 over `size`, the length of a fold. rest: as of
// stretch_tensor.
inline surface_t surface_of(int t, __global const float *positions, __global const int *faces,
                            __global const int *places, float8 rest,
                            __global const float4 *normals, float size)
{
    float3 p = vload3(faces[3 * t], positions), n = normals[places[3 * t]].xyz;
    float x1 = rest.s0 * size, y2 = rest.s4 * size, y1 = -rest.s2 * y2;
    float3 e1 = (vload3(faces[3 * t + 1], positions) - p) / size;
    float3 e2 = (vload3(faces[3 * t + 2], positions) - p) / size;
    float3 m1 = normals[places[3 * t + 1]].xyz - n, m2 = normals[places[3 * t + 2]].xyz - n;
    float3 x = x1 * e1, y = y1 * e1 + y2 * e2, nx = x1 * m1, ny = y1 * m1 + y2 * m2;
    surface_t s;
    s.metric = (float3)(dot(x, x), dot(x, y), dot(y, y));
    s.form = (float3)(dot(nx, x), 0.5f * (dot(nx, y) + dot(ny, x)), dot(ny, y));
    return s;
}

// forms: xx, xy and yy of the second form of the neutral, 0 for triangles without usable area.
__kernel void neutral_forms(__global const float *positions, __global const int *faces,
                            __global const int *places, __global const float8 *rest,
                            __global const float4 *normals, float size, __global float4 *forms)
{
    int t = get_global_id(0);
    float3 form = (float3)(0.0f);
    if (rest[t].s0 != 0.0f)
        form = surface_of(t, positions, faces, places, rest[t], normals, size).form;
    forms[t] = (float4)(form, 0.0f);
}

// A form xx, xy, yy along both axes of stretch; turn: cosine and sine of twice the first one's angle.
inline float2 along(float3 form, float2 turn)
{
    float mean = 0.5f * (form.x + form.z);
    float part = 0.5f * (form.x - form.z) * turn.x + form.y * turn.y;
    return (float2)(mean + part, mean - part);
}

// moments: b and b^2 of each triangle. b = sum c_i (k'_i - k_i), with c the log compression along the
// axes of stretch, at most 1, and k the curvatures along them before and after, times `size` and
// within +-most. Where both axes are compressed alike b hangs on no axis.
// Error below 1e-4 (1 + |b|) where no angle of the neutral is below 5 degrees.
__kernel void bends(__global const float *positions, __global const int *faces,
                    __global const int *places, __global const float8 *rest,
                    __global const float4 *normals, __global const float4 *forms, float size,
                    float most, __global float4 *moments)
{
    int t = get_global_id(0);
    float b = 0.0f;
    if (rest[t].s0 != 0.0f) {
        surface_t s = surface_of(t, positions, faces, places, rest[t], normals, size);
        float3 g = s.metric;
        float mean = 0.5f * (g.x + g.z), apart = 0.5f * (g.x - g.z);
        float radius = sqrt(apart * apart + g.y * g.y);
        float2 turn = radius > 0.0f ? (float2)(apart, g.y) / radius : (float2)(0.0f);
        float first = mean + radius;
        float second = first > 0.0f ? (g.x * g.z - g.y * g.y) / first : 0.0f;
        float2 square = fmax((float2)(first, second), LEAST_SQUARE);
        float2 pressed = fmin(fmax(-0.5f * log(square), 0.0f), 1.0f);
        float2 bent = along(s.form, turn) / square - along(forms[t].xyz, turn);
        bent = fmin(fmax(bent, -most), most);
        b = dot(pressed, bent);
    }
    moments[t] = (float4)(b, b * b, 0.0f, 0.0f);
}

// The share of a compression that folds take: m T^2 / (1 + T^2), T the variance of b.
inline float share_of(float4 moments, float most)
{
    float variance = fmax(moments.y - moments.x * moments.x, 0.0f), square = variance * variance;
    return most * (square < 1e30f ? square / (1.0f + square) : 1.0f);
}

// taken: of each triangle, the mean of its places, and 0 for points in none. logs: in place.
__kernel void take_shares(__global const int *places, __global const float4 *moments, int triangles,
                          float most, __global float2 *logs, __global float *taken)
{
    int t = get_global_id(0);
    float share = 0.0f;
    if (t < triangles)
        share = (share_of(moments[places[3 * t]], most) +
                 share_of(moments[places[3 * t + 1]], most) +
                 share_of(moments[places[3 * t + 2]], most)) / 3.0f;
    float2 r = logs[t];
    logs[t] = r - share * fmin(r, 0.0f);
    taken[t] = share;
}

// The same for the tension of vertices, a ratio, in place. place: of each vertex.
__kernel void take_tension(__global const int *place, __global const float4 *moments, float most,
                           __global float *tension)
{
    int v = get_global_id(0);
    float rho = tension[v];
    if (rho > 0.0f && rho < 1.0f)
        tension[v] = pow(rho, 1.0f - share_of(moments[place[v]], most));
}
