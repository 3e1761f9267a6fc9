// Which pairs a thing is in: counted, then filled in any order, then sorted.

__kernel void count_pairs(int first, int count, __global const int *members, __global int *degree)
{
    int k = first + get_global_id(0);
    if (k < count)
        atomic_inc(degree + members[k]);
}

// cursor: where the list of each thing starts.  Entry k of members belongs to pair k / 2.
__kernel void list_pairs(int first, int count, __global const int *members, __global int *cursor,
                         __global int *pairs)
{
    int k = first + get_global_id(0);
    if (k < count)
        pairs[atomic_inc(cursor + members[k])] = k / 2;
}

// others: the other member of each pair.
__kernel void sort_pairs(int first, int count, __global const int *offsets,
                         __global const int *members, __global int *pairs, __global int *others)
{
    int i = first + get_global_id(0);
    if (i >= count)
        return;
    for (int k = offsets[i] + 1; k < offsets[i + 1]; k++) {
        int pair = pairs[k], at = k;
        for (; at > offsets[i] && pairs[at - 1] > pair; at--)
            pairs[at] = pairs[at - 1];
        pairs[at] = pair;
    }
    for (int k = offsets[i]; k < offsets[i + 1]; k++) {
        int one = members[2 * pairs[k]], two = members[2 * pairs[k] + 1];
        others[k] = one == i ? two : one;
    }
}
