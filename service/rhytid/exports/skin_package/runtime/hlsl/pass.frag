float4 main(float4 place : SV_Position) : SV_Target
{
    return rhytid_texel(int2(place.xy));
}
