// Fill the table of include/table.glsl with a passage that has a closed form.
//
//     code = encode_beyond(displayed_from_scene(sign(u) |u|^(16/5)))
//
// NumPy twin: volspec/appearance/table.py, TablePassage.of.
//
// Writes  code    RGBA float, one pixel a node: NODES wide, NODES² high, slice below slice, which is
//                 the order of a texture of three dimensions.
// Reads   offset  0 for the nodes, 0.5 for the middles of the cells above them
// Host    FORM (CURVE or CAM) and what it wants, its passage from adapted linear RGB on; the display's
//         curve, and volspec.appearance.table.SHADER_CONSTANTS.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
#endif

#include "display.glsl"
#if FORM == CURVE
#include "curve.glsl"
#elif FORM == CAM
#include "cam.glsl"
#endif

uniform float offset;

out vec4 code;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    ivec3 node = ivec3(pixel.x, pixel.y % NODES, pixel.y / NODES) - NODES_BELOW;
    vec3 u = NODE_STEP * (vec3(node) + offset);
    vec3 adapted = sign(u) * pow(abs(u), vec3(16.0 / 5.0));
    code = vec4(encode_beyond(displayed_from_scene(adapted)), 1.0);
}
