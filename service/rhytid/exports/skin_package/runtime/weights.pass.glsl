// Pass 1: of every triangle, into an RGBA32F target of `weights` of the manifest.
vec4 rhytid_texel(ivec2 texel)
{
    return rhytid_weights_at(texel);
}
