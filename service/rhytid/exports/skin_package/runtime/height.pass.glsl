// The last pass: displacement of every texel of a UDIM, into a target of as many texels; its first row
// is the top of the map.
vec4 rhytid_texel(ivec2 texel)
{
    return vec4(rhytid_height(texel), 0.0, 0.0, 1.0);
}
