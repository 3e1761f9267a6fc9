// Pass 2, where there are cushions: the broad layer of the wrinkles, coarse, into a target of as many texels as
// rhytid_cushions has.
out vec4 rhytid_out;

void main()
{
    rhytid_out = vec4(rhytid_cushion_sample(ivec2(gl_FragCoord.xy)), 0.0, 0.0, 1.0);
}
