// Where every triangle stands between the samples in a frame: Alg. 3 of "Fast Dynamic Facial Wrinkles"
// (Weiss, Chandran, Zoss, Bradley 2024) up to its line 10, which is the same for all texels of a
// triangle. docs/package.md describes the inputs.

uniform sampler2D rhytid_stretch; // of the frame, RGBA32F, two texels of each triangle
#if CUSHION
uniform usampler2DArray rhytid_cushion_lines; // what wrinkles answer by, R32_UINT
#endif

struct RhytidStretch {
    vec2 logs; // log rho within the limit, less what folds of the mesh take of compression
    vec4 axes; // s1, s2: unit vectors in UV
};

// Log rho within the limit.
float rhytid_limited(float value)
{
    const float most = RHYTID_LOG_STRETCH_LIMIT;
    float within = clamp(value, -2.0 * most, 2.0 * most);
    return clamp(rhytid_held(within, most, most), -most, most);
}

// at: column and row of a triangle in the weights.
RhytidStretch rhytid_stretch_of(ivec2 at)
{
    vec4 logs = rhytid_load(rhytid_stretch, ivec2(2 * at.x + 1, at.y));
    RhytidStretch found;
    vec2 limited = vec2(rhytid_limited(logs.x), rhytid_limited(logs.y));
    found.logs = limited - logs.z * min(limited, vec2(0.0, 0.0));
    found.axes = rhytid_load(rhytid_stretch, ivec2(2 * at.x, at.y));
    return found;
}

// Alg. 1, lines 4 and 5: log stretch across wrinkles along theta.
float rhytid_across(vec2 theta, RhytidStretch s)
{
    float first = max(1.0 - abs(dot(theta, s.axes.xy)), 0.0);
    float second = max(1.0 - abs(dot(theta, s.axes.zw)), 0.0);
    return (first * s.logs.x + second * s.logs.y) / (first + second + 1e-6);
}

// Alg. 3, lines 7 to 10, of bin n, or of the pores: what the codes of two samples are multiplied by, in
// units of the merge; the first of them; the rise of the depth over the codes of tilts.
vec4 rhytid_layer(int n, RhytidStretch s)
{
    int samples = RHYTID_SAMPLES;
    float exponent = RHYTID_EXPONENT;
    float most = RHYTID_SCALE_LIMIT;
    if (n == RHYTID_BINS) {
        samples = RHYTID_PORE_SAMPLES;
        exponent = RHYTID_PORE_EXPONENT;
        most = RHYTID_PORE_DEPTH_LIMIT;
    }
    bool oriented = n < RHYTID_BINS && RHYTID_BINS > 1;
    float r = 0.5 * (s.logs.x + s.logs.y);
    if (oriented) {
        r = rhytid_across(RHYTID_DIRECTIONS[3 * n], s);
    }
    float depth = rhytid_scale(r, -exponent, most);
    float rise = 0.0;
#if TILT
    if (oriented) {
        float before = rhytid_across(RHYTID_DIRECTIONS[3 * n + 1], s);
        float after = rhytid_across(RHYTID_DIRECTIONS[3 * n + 2], s);
        float low = rhytid_scale(before, -exponent, most);
        float high = rhytid_scale(after, -exponent, most);
        depth = 0.5 * (low + high);
        float bound = min(1.0, most / depth - 1.0);
        rise = clamp((high - low) / (2.0 * RHYTID_TILT_NODE * depth), -bound, bound);
        rise *= RHYTID_TILT_STEP;
    }
#endif
    float at = (clamp(r / RHYTID_LAST_SAMPLE, -1.0, 1.0) + 1.0) * 0.5 * float(samples - 1);
    int first = min(int(at), samples - 2);
    float share = at - float(first);
    depth /= RHYTID_UNIT;
    float here = (1.0 - share) * depth;
    float next = share * depth;
    if (n == RHYTID_BINS) {
        here *= RHYTID_PORE_STEPS[first];
        next *= RHYTID_PORE_STEPS[first + 1];
    } else {
        here *= RHYTID_STEPS[first];
        next *= RHYTID_STEPS[first + 1];
    }
    return vec4(here, next, float(first), rise);
}

// How much of the grain shows.
float rhytid_grain_gain(RhytidStretch s)
{
#if GRAIN
    return 0.5 * (rhytid_scale(s.logs.x, -RHYTID_GRAIN_EXPONENT, RHYTID_SCALE_LIMIT) +
                  rhytid_scale(s.logs.y, -RHYTID_GRAIN_EXPONENT, RHYTID_SCALE_LIMIT));
#else
    return 0.0;
#endif
}

// How much of events, single features of the neutral, shows: as of pores that answer less.
float rhytid_event_gain(RhytidStretch s)
{
#if EVENTS
    float r = 0.5 * (s.logs.x + s.logs.y);
    return rhytid_scale(r, -RHYTID_EVENT_EXPONENT, RHYTID_PORE_DEPTH_LIMIT);
#else
    return 0.0;
#endif
}

// A texel of the weights: RHYTID_ROWS rows of triangles for every bin, then those of the pores, then of
// the grain and of events.
vec4 rhytid_weights_at(ivec2 texel)
{
    int layer = texel.y / RHYTID_ROWS;
    RhytidStretch s = rhytid_stretch_of(ivec2(texel.x, texel.y - layer * RHYTID_ROWS));
    if (layer > RHYTID_BINS) {
        return vec4(rhytid_grain_gain(s), rhytid_event_gain(s), 0.0, 0.0);
    }
    return rhytid_layer(layer, s);
}

#if CUSHION
// A component of a direction, of 16 bits.
float rhytid_component(int bits)
{
    return float((bits & 65535) - 32768) / 32767.0;
}

// r of a line.
float rhytid_line_stretch(int number)
{
    int row = number / RHYTID_LINES_A_ROW;
    ivec2 at = ivec2(number - row * RHYTID_LINES_A_ROW, row);
    int face = rhytid_number(rhytid_cushion_lines, at, 0);
    int direction = rhytid_number(rhytid_cushion_lines, at, 1);
    vec2 theta = normalize(vec2(rhytid_component(direction), rhytid_component(direction >> 16)));
    int face_row = face / RHYTID_TRIANGLES_A_ROW;
    ivec2 place = ivec2(face - face_row * RHYTID_TRIANGLES_A_ROW, face_row);
    return rhytid_across(theta, rhytid_stretch_of(place));
}

// r at an end at which line next - 1 continues one with r, or none where next is 0.
float rhytid_end_stretch(float r, int next)
{
    if (next == 0) {
        return r;
    }
    return r + 0.5 * RHYTID_ENDS * (rhytid_line_stretch(next - 1) - r);
}

// A texel of the lines: r at the start and at the end of line y * RHYTID_LINES_A_ROW + x.
vec4 rhytid_lines_at(ivec2 texel)
{
    float r = rhytid_line_stretch(texel.y * RHYTID_LINES_A_ROW + texel.x);
    int before = rhytid_number(rhytid_cushion_lines, texel, 2);
    int after = rhytid_number(rhytid_cushion_lines, texel, 3);
    return vec4(rhytid_end_stretch(r, before), rhytid_end_stretch(r, after), 0.0, 1.0);
}
#endif
