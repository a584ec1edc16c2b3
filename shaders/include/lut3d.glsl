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
// Host sets volspec.appearance.lut3d.SHADER_CONSTANTS; CHECKED: 1 if there is a closed form;
//         EXACT_SAMPLER: 1 on software GL, whose sampler is the fastest way. GPUs round a sampler's
//         weights to 8 bits, 0.3 CIEDE2000 where codes are steep.

uniform highp sampler3D lut;

// Between a node and the next along red.
vec4 row_at(ivec3 node, float part) {
    return mix(texelFetch(lut, node, 0), texelFetch(lut, node + ivec3(1, 0, 0), 0), part);
}

// The code, not clipped, and in alpha 1 if all cells around are valid, else less.
vec4 look_up(vec3 adapted) {
    // |r|^(1/4) · |r|^(1/16): on software GL four square roots cost half of a pow.
    vec3 fourth = sqrt(sqrt(abs(adapted)));
    vec3 u = sign(adapted) * (fourth * sqrt(sqrt(fourth)));
#if EXACT_SAMPLER
    // The first and last nodes are at the centres of their texels.
    vec3 at = u / (NODE_STEP * float(NODES)) + (float(NODES_BELOW) + 0.5) / float(NODES);
    return textureLod(lut, at, 0.0);
#else
    vec3 at = clamp(u / NODE_STEP + float(NODES_BELOW), 0.0, float(NODES - 1));
    ivec3 low = min(ivec3(at), NODES - 2);
    vec3 part = at - vec3(low);
    vec4 near = mix(row_at(low, part.x), row_at(low + ivec3(0, 1, 0), part.x), part.y);
    low.z += 1;
    vec4 far = mix(row_at(low, part.x), row_at(low + ivec3(0, 1, 0), part.x), part.y);
    return mix(near, far, part.z);
#endif
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
