// Finds the triangles of texels and of points once an asset.
#include "locate.clh"

// One work-item a texel of a rectangle of a level of `side` texels; row 0 is the top.
__kernel void locate_texels(__global const float *corners, __global const int *offsets,
                            __global const int *members, int cells, float reach2, int none,
                            int side, int row, int column, __global int *found)
{
    int x = get_global_id(0), y = get_global_id(1);
    float2 p = (float2)(column + x + 0.5f, side - (row + y) - 0.5f) / (float)side;
    found[y * get_global_size(0) + x] =
        locate_in_cells(p, corners, offsets, members, cells, reach2, none);
}

// One work-item a point, local to the UDIM.
__kernel void locate_points(__global const float *corners, __global const int *offsets,
                            __global const int *members, int cells, float reach2, int none,
                            __global const float2 *points, __global int *found)
{
    int i = get_global_id(0);
    found[i] = locate_in_cells(points[i], corners, offsets, members, cells, reach2, none);
}
