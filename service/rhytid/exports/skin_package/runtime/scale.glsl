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
