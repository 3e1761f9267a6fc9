// Slopes, after the pass height: into an RGBA16F target of as many texels, whose levels are then made.
vec4 rhytid_texel(ivec2 texel)
{
    vec3 slope = rhytid_slope_of(texel);
    return vec4(slope.x, slope.y, 0.0, slope.z);
}
