// Finds the triangles of points once per asset.
#include "locate.clh"

// One work-item a point, local to the UDIM. offsets: of the members of each cell, and their end.
__kernel void locate_points(__global const float *corners, __global const int *offsets,
                            __global const int *members, int cells, float reach2, int none,
                            __global const float2 *points, __global int *found)
{
    int i = get_global_id(0);
    float2 p = points[i];
    int cell = cell_at(p.x, p.y, cells);
    found[i] = locate(p.x, p.y, corners, members, offsets[cell], offsets[cell + 1], reach2, none);
}
