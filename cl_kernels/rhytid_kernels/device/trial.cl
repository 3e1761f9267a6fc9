// What a device is tried with before it is chosen: does it compute, and how fast.

// 2 i, exactly.
__kernel void probe(__global float *out)
{
    int i = get_global_id(0);
    out[i] = 2.0f * i;
}

// The work of drawing in small (draw.clh): profiles in vectors of eight, added up in local memory by
// one work-item per group. Drivers that are equal in arithmetic alone differ in this a hundredfold.
#define LINES 16
#define WIDTH 72
#define ELEMENTS 32

__kernel void pace(__global float *out)
{
    __local float sums[LINES * WIDTH];
    int group = get_group_id(0);
    for (int at = 0; at < LINES * WIDTH; at += 8)
        vstore8((float8)(0.0f), 0, sums + at);
    for (int k = 0; k < ELEMENTS; k++) {
        int column = (37 * k + 11 * group) % (WIDTH - 8);
        float8 dx = (float8)(-3.5f, -2.5f, -1.5f, -0.5f, 0.5f, 1.5f, 2.5f, 3.5f);
        for (int y = 0; y < LINES; y++) {
            float dy = y - 0.5f * k;
            float8 t2 = min(0.05f * (dx * dx + dy * dy), (float8)(1.0f)), inside = 1.0f - t2;
            int at = y * WIDTH + column;
            vstore8(vload8(0, sums + at) + inside * inside * (1.0f - 2.5f * t2), 0, sums + at);
        }
    }
    for (int y = 0; y < LINES; y++)
        vstore8(vload8(0, sums + y * WIDTH), group * LINES + y, out);
}
