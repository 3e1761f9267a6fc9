// Greedy choice among things that exclude each other, all at once: first come, first kept.

#define WAITING 0
#define KEPT 1
#define DROPPED 2

// One round. Things come in the order of (key, number). Rounds until `waiting` stays 0 give what the
// loop "keep it unless an earlier one that was kept excludes it" gives.
__kernel void decide(int first, int count, __global const float *key, __global const int *offsets,
                     __global const int *excluded, __global const uchar *before,
                     __global uchar *after, __global int *waiting)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    uchar state = before[i];
    if (state == WAITING) {
        state = KEPT;
        for (int k = offsets[i]; k < offsets[i + 1] && state != DROPPED; k++) {
            int j = excluded[k];
            bool earlier = key[j] < key[i] || (key[j] == key[i] && j < i);
            if (earlier && before[j] != DROPPED)
                state = before[j] == KEPT ? DROPPED : WAITING;
        }
        if (state == WAITING)
            atomic_or(waiting, 1);
    }
    after[i] = state;
}

// Of the kept, those that are among the first `ends` kept at one of their two nodes become NEEDED.
#define NEEDED 3
__kernel void mark_needed(int first, int count, int ends, __global const float *key,
                          __global const int *nodes, __global const int *offsets,
                          __global const int *edges, __global const uchar *state,
                          __global uchar *marked)
{
    int e = first + get_global_id(0);
    if (e >= count)
        return;
    uchar mark = state[e];
    for (int side = 0; side < 2 && mark == KEPT; side++) {
        int node = nodes[2 * e + side], place = 0;
        for (int h = offsets[node]; h < offsets[node + 1]; h++) {
            int f = edges[h];
            place += state[f] == KEPT && (key[f] < key[e] || (key[f] == key[e] && f < e));
        }
        mark = place < ends ? NEEDED : KEPT;
    }
    marked[e] = mark;
}
