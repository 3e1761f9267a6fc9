// Pass 2, where there are cushions: of every line that their samples answer by, into an RGBA32F target of
// `cushion.lines` of the manifest.
vec4 rhytid_texel(ivec2 texel)
{
    return rhytid_lines_at(texel);
}
