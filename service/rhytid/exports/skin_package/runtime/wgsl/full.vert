// One triangle over the whole target: three vertices, no attributes.
@vertex
fn main(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32>
{
    let corner = vec2<f32>(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4<f32>(2.0 * corner - 1.0, 0.0, 1.0);
}
