out vec4 rhytid_out;

void main()
{
    rhytid_out = rhytid_texel(ivec2(gl_FragCoord.xy));
}
