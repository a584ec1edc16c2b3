// A view transform as a 3-D LUT: axes are powers of adapted linear RGB, values the display's codes.
//
//     u    = sign(r) |r|^(5/16)     r: linear RGB of the display, adapted to the scene's white; the
//                                   host multiplies its matrix into XYZ_from_layer, backdrop_XYZ
//     code = lut(u)                 linear between NODES nodes, NODE_STEP apart, along each axis;
//                                   NODES_BELOW of them are below 0
//
// If CHECKED, pixels in invalid cells or outside the LUT are discarded: the host counts the drawn
// pixels, and draws the closed form if any is missing. If not CHECKED, colours brighter than the
// LUT's top are scaled down to the top at equal chromaticity.
//
// NumPy twin: volspec/appearance/lut3d.py, Lut3D.apply.
//
// Reads   lut  RGBA float, codes and validity: red runs fastest, blue slowest (shaders/bake_lut3d.frag
//              and check_lut3d.frag or the host fill it); filtered linearly, clamped at its edges
// Host sets volspec.appearance.lut3d.SHADER_CONSTANTS, and CHECKED: 1 if there is a closed form.

uniform highp sampler3D lut;

// The code, not clipped, and in alpha 1 if all cells around are valid, else less.
vec4 look_up(vec3 adapted) {
    // |r|^(1/4) · |r|^(1/16): on software GL four square roots cost half of a pow.
    vec3 fourth = sqrt(sqrt(abs(adapted)));
    vec3 u = sign(adapted) * (fourth * sqrt(sqrt(fourth)));
    // The first and last nodes are at the centres of their texels.
    vec3 at = u / (NODE_STEP * float(NODES)) + (float(NODES_BELOW) + 0.5) / float(NODES);
    return textureLod(lut, at, 0.0);
}

vec3 code_from_adapted(vec3 adapted) {
#if CHECKED
    vec4 found = look_up(adapted);
    if (found.a <= LUT_ALL_VALID) discard;
    return found.rgb;
#else
    float brightest = max(adapted.r, max(adapted.g, adapted.b));
    return look_up(adapted * (LUT_TOP / max(brightest, LUT_TOP))).rgb;
#endif
}
