// Pass 3, where there are cushions: the broad layer of the wrinkles, coarse, into a target of as many
// texels as rhytid_cushions has.
vec4 rhytid_texel(ivec2 texel)
{
    return vec4(rhytid_cushion_sample(texel), 0.0, 0.0, 1.0);
}
