// Products of slopes, after the pass height: into an RGBA16F target as that of slopes.
vec4 rhytid_texel(ivec2 texel)
{
    vec3 slope = rhytid_slope_of(texel);
    return vec4(slope.x * slope.x, slope.x * slope.y, slope.y * slope.y, slope.z);
}
