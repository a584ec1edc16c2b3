// A passage looked up in a table: axes are powers of adapted linear RGB, values the display's codes.
//
//     u    = sign(r) |r|^(5/16)     r: linear RGB of the display, adapted to the scene's white; the
//                                   host has put its matrix into XYZ_from_layer and backdrop_XYZ
//     code = table(u)               linear between NODES nodes, NODE_STEP apart, along each axis;
//                                   NODES_BELOW of them lie below 0
//
// NumPy twin: volspec/appearance/table.py, TablePassage.apply.
//
// Reads   table  RGBA float: red runs fastest, blue slowest (shaders/nodes.frag or the host fills
//                it); filtered linearly, clamped at its edges
// Host sets volspec.appearance.table.SHADER_CONSTANTS.

uniform highp sampler3D table;

// Not clipped.
vec3 code_from_scene(vec3 adapted) {
    // |r|^(1/4) · |r|^(1/16): on software GL four roots cost half of a power.
    vec3 fourth = sqrt(sqrt(abs(adapted)));
    vec3 u = sign(adapted) * (fourth * sqrt(sqrt(fourth)));
    // The first and last nodes lie in the middles of their texels.
    vec3 at = u / (NODE_STEP * float(NODES)) + (float(NODES_BELOW) + 0.5) / float(NODES);
    return textureLod(table, at, 0.0).rgb;
}

vec3 displayed_from_scene(vec3 adapted) { return decode(code_from_scene(adapted)); }
