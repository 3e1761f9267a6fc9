// Where every triangle stands between the samples in a frame: Alg. 3 of "Fast Dynamic Facial Wrinkles"
// (Weiss, Chandran, Zoss, Bradley 2024) up to its line 10, which is the same for all texels of a
// triangle. docs/package.md describes the inputs.

uniform sampler2D rhytid_stretch; // of the frame, RGBA32F, two texels of each triangle

struct RhytidStretch {
    vec2 logs; // log rho within the limit
    vec4 axes; // s1, s2: unit vectors in UV
};

// x within -low and high; soft by a knee.
vec2 rhytid_held(vec2 x, float low, float high)
{
#if RHYTID_SOFT_LIMITS
    x = clamp(x, -1.5 * low, 1.5 * high);
    vec2 above = max(x - 0.5 * high, 0.0), below = min(x + 0.5 * low, 0.0);
    return x - above * above / (2.0 * high) + below * below / (2.0 * low);
#else
    return clamp(x, -low, high);
#endif
}

// exp(r)^exponent within 1/RHYTID_SCALE_LIMIT and most.
float rhytid_scale(float r, float exponent, float most)
{
    const float LOG2_E = 1.44269504;
#if RHYTID_SOFT_LIMITS
    float power = rhytid_held(vec2(LOG2_E * exponent * r), log2(RHYTID_SCALE_LIMIT), log2(most)).x;
#else
    float power = clamp(LOG2_E * exponent * r, -100.0, 100.0);
#endif
    return clamp(exp2(power), 1.0 / RHYTID_SCALE_LIMIT, most);
}

// at: column and row of a triangle in the weights.
RhytidStretch rhytid_stretch_of(ivec2 at)
{
    at.x *= 2;
    const float most = RHYTID_LOG_STRETCH_LIMIT;
    vec2 logs = clamp(texelFetch(rhytid_stretch, at + ivec2(1, 0), 0).xy, -2.0 * most, 2.0 * most);
    logs = clamp(rhytid_held(logs, most, most), -most, most);
    return RhytidStretch(logs, texelFetch(rhytid_stretch, at, 0));
}

// Alg. 1, lines 4 and 5: log stretch across wrinkles along theta.
float rhytid_across(vec2 theta, RhytidStretch s)
{
    vec2 away = vec2(dot(theta, s.axes.xy), dot(theta, s.axes.zw));
    away = max(1.0 - abs(away), 0.0);
    return dot(away, s.logs) / (away.x + away.y + 1e-6);
}

float rhytid_step(int n, int sample_)
{
    return n == RHYTID_BINS ? RHYTID_PORE_STEPS[sample_] : RHYTID_STEPS[sample_];
}

// Alg. 3, lines 7 to 10, of bin n, or of the pores: what the codes of two samples are multiplied by, in
// units of the merge; the first of them; the rise of the depth over the codes of tilts.
vec4 rhytid_layer(int n, RhytidStretch s)
{
    bool pores = n == RHYTID_BINS;
    int samples = pores ? RHYTID_PORE_SAMPLES : RHYTID_SAMPLES;
    float exponent = pores ? RHYTID_PORE_EXPONENT : RHYTID_EXPONENT;
    float most = pores ? RHYTID_PORE_DEPTH_LIMIT : RHYTID_SCALE_LIMIT;
    bool oriented = !pores && RHYTID_BINS > 1;
    float r = 0.5 * (s.logs.x + s.logs.y);
    if (oriented)
        r = rhytid_across(RHYTID_DIRECTIONS[3 * n], s);
    float depth = rhytid_scale(r, -exponent, most), rise = 0.0;
#if RHYTID_TILT
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
    return vec4((1.0 - share) * depth * rhytid_step(n, first),
                share * depth * rhytid_step(n, first + 1), float(first), rise);
}

// How much of the grain shows.
float rhytid_grain_gain(RhytidStretch s)
{
#if RHYTID_GRAIN
    return 0.5 * (rhytid_scale(s.logs.x, -RHYTID_GRAIN_EXPONENT, RHYTID_SCALE_LIMIT) +
                  rhytid_scale(s.logs.y, -RHYTID_GRAIN_EXPONENT, RHYTID_SCALE_LIMIT));
#else
    return 0.0;
#endif
}

// A texel of the weights: RHYTID_ROWS rows of triangles for every bin, then those of the pores, then of
// the grain.
vec4 rhytid_weights_at(ivec2 texel)
{
    int layer = texel.y / RHYTID_ROWS;
    RhytidStretch s = rhytid_stretch_of(ivec2(texel.x, texel.y - layer * RHYTID_ROWS));
    if (layer > RHYTID_BINS)
        return vec4(rhytid_grain_gain(s), 0.0, 0.0, 0.0);
    return rhytid_layer(layer, s);
}
