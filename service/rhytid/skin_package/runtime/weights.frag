// Pass 1: of every triangle, into an RGBA32F target of `weights` of the manifest.
out vec4 rhytid_out;

void main()
{
    rhytid_out = rhytid_weights_at(ivec2(gl_FragCoord.xy));
}
