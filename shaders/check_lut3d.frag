// Check the cells of the 3-D LUT of include/lut3d.glsl: the interpolation at their centres.
//
//     valid = |mean of the corners' codes - the centre's|, clipped, <= LUT_TOLERANCE; not at the edges
//
// NumPy twin: volspec/appearance/lut3d.py, _check_cells.
//
// Reads   nodes, centres  the output of shaders/bake_lut3d.frag at offset 0 and 0.5
// Writes  texel           the node's code, and in alpha 1 if the cell above it is valid
// Host    volspec.appearance.lut3d.SHADER_CONSTANTS.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2D;
#endif

uniform sampler2D nodes;
uniform sampler2D centres;

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
    vec3 centre = texelFetch(centres, pixel, 0).rgb;
    vec3 off = abs(clamp(between, 0.0, 1.0) - clamp(centre, 0.0, 1.0));
    bool valid = inside && all(lessThanEqual(off, vec3(LUT_TOLERANCE)));
    texel = vec4(code_at(pixel), valid ? 1.0 : 0.0);
}
