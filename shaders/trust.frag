// Which cells of the table of include/table.glsl hold: half-way between their nodes.
//
//     trust = |mean of the corners' codes - the middle's|, clipped, <= TABLE_TRUST; not at the edges
//
// NumPy twin: volspec/appearance/table.py, _trusted.
//
// Reads   nodes, middles  what shaders/nodes.frag wrote at offset 0 and 0.5
// Writes  texel           the node's code, and the trust in the cell above it
// Host    volspec.appearance.table.SHADER_CONSTANTS.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2D;
#endif

uniform sampler2D nodes;
uniform sampler2D middles;

out vec4 texel;

vec3 code_at(ivec2 pixel) { return texelFetch(nodes, pixel, 0).rgb; }

// A cell's corners of one slice.
vec3 face(ivec2 pixel) {
    return code_at(pixel) + code_at(pixel + ivec2(1, 0)) + code_at(pixel + ivec2(0, 1))
        + code_at(pixel + ivec2(1, 1));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    ivec3 cell = ivec3(pixel.x, pixel.y % NODES, pixel.y / NODES);
    bool inside = all(greaterThan(cell, ivec3(0))) && all(lessThan(cell, ivec3(NODES - 2)));
    vec3 between = (face(pixel) + face(pixel + ivec2(0, NODES))) / 8.0;
    vec3 middle = texelFetch(middles, pixel, 0).rgb;
    vec3 off = abs(clamp(between, 0.0, 1.0) - clamp(middle, 0.0, 1.0));
    bool held = inside && all(lessThanEqual(off, vec3(TABLE_TRUST)));
    texel = vec4(code_at(pixel), held ? 1.0 : 0.0);
}
