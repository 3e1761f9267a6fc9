// One triangle over the whole target: three vertices, no attributes. Clockwise, as Direct3D draws by
// default.
float4 main(uint vertex : SV_VertexID) : SV_Position
{
    float2 corner = float2(float(vertex & 2), float((vertex << 1) & 2));
    return float4(2.0 * corner - 1.0, 0.0, 1.0);
}
