// One triangle that covers the viewport; no vertex buffer.
//
// Draw 3 vertices. Corners (-1, -1), (3, -1), (-1, 3) in clip space, from gl_VertexID.
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
#endif

void main() {
    vec2 corner = vec2(float((gl_VertexID << 1) & 2), float(gl_VertexID & 2));
    gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0);
}
