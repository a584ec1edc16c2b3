// A passage looked up in a table: axes are powers of adapted linear RGB, values the display's codes.
//
//     u    = sign(r) |r|^(5/16)     r: linear RGB of the display, adapted to the scene's white; the
//                                   host has put its matrix into XYZ_from_layer and backdrop_XYZ
//     code = table(u)               linear between NODES nodes, NODE_STEP apart, along each axis;
//                                   NODES_BELOW of them lie below 0
//
// Where CHECKED, a pixel is left out where the table's cells bend too much, and beyond the table: the
// host counts those drawn, and draws the closed form where any is missing. Where not, what is brighter
// than the table's top comes down to it at its chromaticity.
//
// NumPy twin: volspec/appearance/table.py, TablePassage.apply.
//
// Reads   table  RGBA float, codes and trust: red runs fastest, blue slowest (shaders/nodes.frag and
//                trust.frag or the host fill it); filtered linearly, clamped at its edges
// Host sets volspec.appearance.table.SHADER_CONSTANTS, and CHECKED: 1 where there is a closed form.

uniform highp sampler3D table;

// The code, not clipped, and how far the table is to be trusted there: 1, or less.
vec4 looked_up(vec3 adapted) {
    // |r|^(1/4) · |r|^(1/16): on software GL four roots cost half of a power.
    vec3 fourth = sqrt(sqrt(abs(adapted)));
    vec3 u = sign(adapted) * (fourth * sqrt(sqrt(fourth)));
    // The first and last nodes lie in the middles of their texels.
    vec3 at = u / (NODE_STEP * float(NODES)) + (float(NODES_BELOW) + 0.5) / float(NODES);
    return textureLod(table, at, 0.0);
}

vec3 code_from_adapted(vec3 adapted) {
#if CHECKED
    vec4 found = looked_up(adapted);
    if (found.a <= TABLE_WHOLLY) discard;
    return found.rgb;
#else
    float brightest = max(adapted.r, max(adapted.g, adapted.b));
    return looked_up(adapted * (TABLE_TOP / max(brightest, TABLE_TOP))).rgb;
#endif
}
