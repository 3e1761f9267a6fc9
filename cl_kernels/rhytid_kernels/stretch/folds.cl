// Where skin folds: how far one expression compresses each triangle, and along what. One work-item
// a triangle.
#include "clamped_log.clh"
#include "stretch.clh"

// positions, faces, rest: as of stretch_tensor (section 2.2). limit: of |log rho|, dimensionless.
// folds: 3 floats per triangle, xx, yy and xy of the symmetric tensor
// sum of min(log rho_i, 0)^2 q_i q_i^T, q the axes in the frame of the neutral triangle whose x
// runs along its first edge. Within 4e-6 times (1 + limit)^2.
__kernel void fold_tensor(__global const float *positions, __global const int *faces,
                          __global const float8 *rest, float limit, __global float *folds)
{
    int i = get_global_id(0);
    float3 found = 0.0f;
    if (rest[i].s0 != 0.0f) { // else it has no usable area: nothing is known of it
        float8 of = rest[i];
        rest_t neutral = {tf_of(of.s0, of.s1), tf_of(of.s2, of.s3), tf_of(of.s4, of.s5)};
        gradient_t g = deformation_gradient(point_at(faces[3 * i], positions),
                                            point_at(faces[3 * i + 1], positions),
                                            point_at(faces[3 * i + 2], positions), neutral);
        pair_t rho = singular_values(g), q = right_singular_vector(g);
        float one = fmin(clamped_log(rho.x, limit), 0.0f);
        float two = fmin(clamped_log(rho.y, limit), 0.0f);
        one *= one;
        two *= two;
        found = (float3)(one * q.x * q.x + two * q.y * q.y, one * q.y * q.y + two * q.x * q.x,
                         (one - two) * q.x * q.y);
    }
    vstore3(found, i, folds);
}
