// Log stretch and axes of a triangle of a deformed mesh, as stretch.py has them. Edges are differences
// of positions before anything is multiplied, so that single precision does.

struct RhytidTriangle {
    vec4 axes; // s1, s2: unit vectors in UV, v up
    vec4 logs; // log rho1, log rho2, not clamped, rho1 >= rho2; 0, 0
};

// A direction in the frame of the neutral triangle as a unit vector in UV.
vec2 rhytid_in_uv(vec4 frame, vec2 direction)
{
    float u = frame.x * direction.x + frame.y * direction.y;
    float v = frame.z * direction.x + frame.w * direction.y;
    float size = sqrt(u * u + v * v);
    return vec2(u / size, v / size);
}

// Log of a ratio; of a triangle that is pressed to nothing the least there is.
float rhytid_log(float ratio)
{
    const float LEAST = -100.0;
    if (ratio > 1e-37) {
        return max(log(ratio), LEAST);
    }
    return LEAST;
}

// The direction of the larger singular value of [[a, b], [0, d]], not of unit length.
vec2 rhytid_larger(float a, float b, float d)
{
    float c = (a - d) * (a + d) - b * b;
    float s = 2.0 * a * b;
    float radius = sqrt(c * c + s * s);
    if (!(radius > 0.0)) {
        return vec2(1.0, 0.0);
    }
    if (c > 0.0) {
        return vec2((radius + c) / radius, s / radius);
    }
    if (s < 0.0) {
        return vec2(-s / radius, (c - radius) / radius);
    }
    return vec2(s / radius, (radius - c) / radius);
}

// p, q, r: corners of the frame.  rest, frame: its 8 numbers in triangles.bin.
RhytidTriangle rhytid_triangle(vec3 p, vec3 q, vec3 r, vec4 rest, vec4 frame)
{
    RhytidTriangle found;
    found.axes = vec4(1.0, 0.0, 0.0, 1.0);
    found.logs = vec4(0.0, 0.0, 0.0, 0.0);
    if (rest.w > 0.0) {
        vec3 first = q - p;
        vec3 second = r - p;
        float size = sqrt(dot(first, first));
        // Where the first edge is a point the second is laid along the axis.
        float along = sqrt(dot(second, second));
        float height = 0.0;
        if (size > 0.0) {
            vec3 normal = cross(first, second);
            along = dot(first, second) / size;
            height = sqrt(dot(normal, normal)) / size;
        }
        float a = size * rest.x;
        float b = (along - size * rest.y) * rest.z;
        float d = height * rest.z;
        float sum = sqrt((a + d) * (a + d) + b * b);
        float difference = sqrt((a - d) * (a - d) + b * b);
        float larger = 0.5 * (sum + difference);
        float smaller = 0.0;
        if (larger > 0.0) {
            smaller = a * d / larger; // of the determinant: nothing cancels
        }
        vec2 v = rhytid_larger(a, b, d);
        vec2 s1 = rhytid_in_uv(frame, v);
        vec2 s2 = rhytid_in_uv(frame, vec2(-v.y, v.x));
        found.axes = vec4(s1.x, s1.y, s2.x, s2.y);
        found.logs = vec4(rhytid_log(larger), rhytid_log(smaller), 0.0, 0.0);
    }
    return found;
}
