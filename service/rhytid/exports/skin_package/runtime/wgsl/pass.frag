@fragment
fn main(@builtin(position) place: vec4<f32>) -> @location(0) vec4<f32>
{
    return rhytid_texel(vec2<i32>(place.xy));
}
