// Fill the table of include/table.glsl with a passage that has a closed form.
//
//     root = (response_from_linear displayed_from_scene(XYZ_from_response u^(8/3)))^(1/3)
//
// NumPy twin: volspec/appearance/table.py, TablePassage.of.
//
// Writes  root  RGBA float, one pixel a node: NODES wide, NODES² high, slice below slice, which is
//               the order of a texture of three dimensions.
// Host    FORM (CURVE or CAM) and what it wants, NODES.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
#endif

#if FORM == CURVE
#include "curve.glsl"
#elif FORM == CAM
#include "cam.glsl"
#endif

uniform mat3 XYZ_from_response;     // the scene's, of which TOP whites are 1
uniform mat3 response_from_linear;  // the display's

out vec4 root;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 node = vec3(pixel.x, pixel.y % NODES, pixel.y / NODES) / float(NODES - 1);
    vec3 XYZ = XYZ_from_response * pow(node, vec3(8.0 / 3.0));
    vec3 shown = response_from_linear * displayed_from_scene(XYZ);
    root = vec4(sign(shown) * pow(abs(shown), vec3(1.0 / 3.0)), 1.0);
}
