// CIECAM02, CAM16 or Hellwig2022: forward under the scene's conditions and inverse under the display's, in one.
//
//     R  = sign(r) 400 f / (27.13 + f), f = |r|^0.42, r = response_from_XYZ XYZ
//     x  = 2R + G + B/20 (p2 - 0.305),  a = R - 12G/11 + B/11,  b = (R + G - 2B) / 9
//     x' = w' (x / w)^γ
//     (a', b') = κ (x' + 0.305) (a, b) / (x + 0.305 + (κ - 1) (11a + 108b) / 23)
//     R' = 1/1403 (460 x' + 451 a' + 288 b') ...,  r' = sign(R') (|R'| / (400 - |R'|))^(1/0.42)
//     linear = linear_from_response r'
//
// In Hellwig2022, (a', b') = κ (a, b).
// J, C and h are the same on both sides, so t, e_t and the hue fall out: nothing is divided by
// t or by a sine, and no angle is formed (CamTransform derives it).
// The 0.1 of the compression cancels in a and b, and adds up to the 0.305 in p2.
//
// NumPy twin: volspec/appearance/models/cam.py, CamTransform.apply. Models differ only in their
// matrices and in κ.
// Total: finite input gives finite output. x <= 0 is black; |R'| is clamped to RESPONSE_LIMIT,
// below the pole at 400; the fraction's denominator stays above CHROMA_FLOOR (x + 0.305).
//
// Reads   view_transform, computed by the host in double precision when the white changes.
//         field     if FIELD: the scene's side of the transform at the nodes of a grid from edge to
//                   edge of the picture, interpolated linearly. Texture array, 3 layers
//                   of RGBA float: a column of response_from_XYZ each, and in alpha
//                   scene_achromatic, lightness_power, chroma_gain. NumPy twin:
//                   volspec/appearance/adaptation_grid.py.
// Host sets SAME_SURROUND if γ = κ = 1 (equal Y_b and surround, the default), which saves a pow
// and the skew term, a tenth of the frame time; PROPORTIONAL if the model is Hellwig2022; and
// the constants of volspec.appearance.display.constants.shader_constants().

struct ViewTransform {
    mat3 response_from_XYZ;    // the scene's F_L/100 · HPE · CAT02⁻¹ · diag(D_RGB) · CAT02, or
                               // F_L/100 · diag(D_RGB) · CAT16
    mat3 linear_from_response; // the display's inverse · 27.13^(1/0.42), to linear RGB
    float scene_achromatic;    // w, the scene white's p2 - 0.305
    float display_achromatic;  // w', the same of the display white
#if !SAME_SURROUND
    float lightness_power;     // γ = cz / (c'z')
    float chroma_gain;         // κ
#endif
};
uniform ViewTransform view_transform;

vec3 apply_transform(ViewTransform t, vec3 XYZ) {
    vec3 r = t.response_from_XYZ * XYZ;
    vec3 f = pow(abs(r), vec3(RESPONSE_POWER));
    vec3 R = sign(r) * (RESPONSE_POLE * f / (RESPONSE_HALF + f));

    float x = max(dot(ACHROMATIC, R), 0.0);
    vec2 ab = vec2(dot(OPPONENT_A, R), dot(OPPONENT_B, R));
    float p2 = x + ACHROMATIC_NOISE;
    float lightness = x / t.scene_achromatic;
#if SAME_SURROUND
    float x_display = t.display_achromatic * lightness;
    float chroma = PROPORTIONAL != 0 ? 1.0 : (x_display + ACHROMATIC_NOISE) / p2;
#elif PROPORTIONAL
    float x_display = t.display_achromatic * pow(lightness, t.lightness_power);
    float chroma = t.chroma_gain;
#else
    float x_display = t.display_achromatic * pow(lightness, t.lightness_power);
    float skew = (t.chroma_gain - 1.0) * dot(CHROMA_SKEW, ab);
    float chroma = t.chroma_gain * (x_display + ACHROMATIC_NOISE)
        / max(p2 + skew, CHROMA_FLOOR * p2);
#endif
    ab *= x > 0.0 ? chroma : 0.0;

    vec3 R_display = RESPONSE_FROM_OPPONENT * vec3(x_display, ab);
    vec3 size = min(abs(R_display), vec3(RESPONSE_LIMIT));
    vec3 r_display =
        sign(R_display) * pow(size / (RESPONSE_POLE - size), vec3(1.0 / RESPONSE_POWER));
    return t.linear_from_response * r_display;
}

#if FIELD
uniform sampler2DArray field;

vec3 displayed_from_scene(vec3 XYZ, vec2 place) {  // 0 to 1 across the picture and down
    vec2 nodes = vec2(textureSize(field, 0).xy);
    vec2 at = (place * (nodes - 1.0) + 0.5) / nodes;
    vec4 x = textureLod(field, vec3(at, 0.0), 0.0);
    vec4 y = textureLod(field, vec3(at, 1.0), 0.0);
    vec4 z = textureLod(field, vec3(at, 2.0), 0.0);
    ViewTransform here = view_transform;
    here.response_from_XYZ = mat3(x.rgb, y.rgb, z.rgb);
    here.scene_achromatic = x.a;
    here.lightness_power = y.a;
    here.chroma_gain = z.a;
    return apply_transform(here, XYZ);
}
#else
vec3 displayed_from_scene(vec3 XYZ) { return apply_transform(view_transform, XYZ); }
#endif
