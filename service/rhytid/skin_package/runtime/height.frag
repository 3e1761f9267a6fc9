// The last pass: displacement of every texel of a UDIM, into a target of as many
// texels; its first row is the top of the map.
out vec4 rhytid_out;

void main()
{
    rhytid_out = vec4(rhytid_height(ivec2(gl_FragCoord.xy)), 0.0, 0.0, 1.0);
}
