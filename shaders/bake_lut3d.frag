// Bake a view transform that has a closed form into the 3-D LUT of include/lut3d.glsl.
//
//     code = encode_beyond(displayed_from_scene(sign(u) |u|^(16/5)))
//
// NumPy twin: volspec/appearance/lut3d.py, Lut3D.of.
//
// Writes  code    RGBA float, one pixel a node: NODES wide, NODES² high, slice below slice, which is
//                 the order of a 3-D texture.
// Reads   offset  0 for the nodes, 0.5 for the centres of the cells above them
// Host    FORM (CURVE or CAM) and its constants, its view transform from adapted linear RGB on; the
//         display's curve, and volspec.appearance.lut3d.SHADER_CONSTANTS.
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
