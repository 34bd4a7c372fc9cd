// The one triangle of a full-screen pass.

// Clip position of a vertex, 0 to 2. The triangle covers the screen; half of the triangle lies outside the screen.
fn full_screen_position(vertex: u32) -> vec4<f32> {
    let corner = vec2<f32>(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4<f32>(corner * 2.0 - 1.0, 0.0, 1.0);
}
