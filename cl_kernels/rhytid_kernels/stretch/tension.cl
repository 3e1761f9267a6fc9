// Mesh tension (Raman et al. 2023): one scalar a vertex, the same on both axes of a triangle.
#include "clamped_log.clh"

// Mean ratio of deformed to neutral length over the edges of each vertex; 1 without edges.
// neighbours: the other ends, listed by `offsets`; rest: 1 / neutral length of each edge.
__kernel void vertex_tension(__global const float *positions, __global const int *offsets,
                             __global const int *neighbours, __global const float *rest,
                             __global float *tension)
{
    int v = get_global_id(0);
    int first = offsets[v], last = offsets[v + 1];
    float3 p = vload3(v, positions);
    float sum = 0.0f;
    for (int k = first; k < last; k++)
        sum += length(vload3(neighbours[k], positions) - p) * rest[k];
    tension[v] = last > first ? sum / (last - first) : 1.0f;
}

// Beyond the log of any float32, so that only infinities are changed: one vertex that collapses and
// one that explodes have a mean.
#define LOG_LIMIT 104.0f

// Per triangle the mean of the log over its vertices; the mean is held within +-limit. One work-item
// more than triangles, for points in none. ratios, axes, logs: as in stretch.cl.
__kernel void stretch_tension(__global const float *tension, __global const int *faces,
                              int triangles, float limit, __global float2 *ratios,
                              __global float4 *axes, __global float2 *logs)
{
    int i = get_global_id(0);
    float r = 0.0f;
    if (i < triangles)
        r = (clamped_log(tension[faces[3 * i]], LOG_LIMIT) +
             clamped_log(tension[faces[3 * i + 1]], LOG_LIMIT) +
             clamped_log(tension[faces[3 * i + 2]], LOG_LIMIT)) / 3.0f;
    ratios[i] = (float2)(exp(r));
    axes[i] = (float4)(1.0f, 0.0f, 0.0f, 1.0f);
    logs[i] = (float2)(limited(r, limit));
}
