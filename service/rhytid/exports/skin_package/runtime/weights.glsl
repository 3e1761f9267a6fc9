// Where every triangle stands between the samples in a frame: Alg. 3 of "Fast Dynamic Facial Wrinkles"
// (Weiss, Chandran, Zoss, Bradley 2024) up to its line 10, which is the same for all texels of a
// triangle. docs/package.md describes the inputs.

uniform sampler2D rhytid_stretch; // of the frame, RGBA32F, two texels of each triangle

struct RhytidStretch {
    vec2 logs; // log rho within the limit, less what folds of the mesh take of compression
    vec4 axes; // s1, s2: unit vectors in UV
};

// x within -low and high; soft by a knee.
float rhytid_held(float x, float low, float high)
{
#if SOFT_LIMITS
    float within = clamp(x, -1.5 * low, 1.5 * high);
    float above = max(within - 0.5 * high, 0.0);
    float below = min(within + 0.5 * low, 0.0);
    return within - above * above / (2.0 * high) + below * below / (2.0 * low);
#else
    return clamp(x, -low, high);
#endif
}

// exp(r)^exponent within 1/RHYTID_SCALE_LIMIT and most.
float rhytid_scale(float r, float exponent, float most)
{
    const float LOG2_E = 1.44269504;
#if SOFT_LIMITS
    float power = rhytid_held(LOG2_E * exponent * r, log2(RHYTID_SCALE_LIMIT), log2(most));
#else
    float power = clamp(LOG2_E * exponent * r, -100.0, 100.0);
#endif
    return clamp(exp2(power), 1.0 / RHYTID_SCALE_LIMIT, most);
}

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

// How much of events, bumps and pits of the neutral, shows: as of pores that answer less.
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
