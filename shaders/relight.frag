// Relight a coefficient image: every light change is this one pass.
//
//     XYZ   = Σ D_g (e_g ∘ C_g) + (1 - alpha) XYZ_backdrop    over light groups g;
//                                                              P_E C_g in exact mode
//     frame = encode(simulated(gamut(appearance(XYZ))))        a colour-vision deficiency, if any
//
// NumPy twin: volspec/relight/reference.py; truth: tests/support/relight_reference.py (colour-science).
//
// Reads   coefficients   texture array, LAYERS layers of RGBA float (16 or 32 bit), image row 0
//                        at texel row 0. Channel i is component i % 4 of layer i / 4:
//                        the premultiplied coefficients C, M channels of one light group after
//                        the other's, then the opacity alpha, then 0.
//         XYZ_from_layer one mat4x3 per layer, column j the XYZ that a 1 in component j adds:
//                        D diag(e) (or P_E) of the group for C, -XYZ_backdrop for alpha. Y = 100
//                        for white.
//         backdrop_XYZ   XYZ where nothing covers the backdrop.
//         view_transform scene XYZ to the display's: include/curve.glsl, cam.glsl or lut3d.glsl;
//                        absent if it is a matrix, which the host multiplies into
//                        XYZ_from_layer and backdrop_XYZ.
//         gamut          the display's gamut, see include/gamut.glsl; if REDUCE.
//         deficiency     the observer's colour vision, see include/display.glsl; if SIMULATE.
// Writes  frame          code values of the display, 0 to 1, alpha 1.
// Host    LAYERS, FORM (LINEAR, CURVE, CAM or LUT), CHECKED, the forms' constants, FIELD (1 if the
//         view transform varies over the picture; CAM only), FIRST_ROW_AT_BOTTOM (1 if the
//         picture will be read back, GL's rows running up; 0 for a canvas or window),
//         IMAGE_HEIGHT (pixels; used if FIRST_ROW_AT_BOTTOM is 0), EVERY (1 draws all pixels, 2
//         every second column and row), REDUCE and MARK (1 if the display does so), SIMULATE (1 if
//         a colour-vision deficiency is simulated), and the
//         numbers of volspec.appearance.display.constants.shader_constants(), of the display's
//         ColourSpace.shader_constants() and of volspec.appearance.gamut_mapping.SHADER_CONSTANTS.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2DArray;
#endif

#include "display.glsl"
#include "gamut.glsl"
#if FORM == CURVE
#include "curve.glsl"
#elif FORM == CAM
#include "cam.glsl"
#elif FORM == LUT
#include "lut3d.glsl"
#endif

uniform sampler2DArray coefficients;
uniform mat4x3 XYZ_from_layer[LAYERS];
uniform vec3 backdrop_XYZ;

out vec4 frame;

vec3 scene_XYZ(ivec2 pixel) {
    vec3 XYZ = backdrop_XYZ;
    for (int layer = 0; layer < LAYERS; ++layer) {
        XYZ += XYZ_from_layer[layer] * texelFetch(coefficients, ivec3(pixel, layer), 0);
    }
    return XYZ;
}

void main() {
    ivec2 pixel = EVERY * ivec2(gl_FragCoord.xy);
#if !FIRST_ROW_AT_BOTTOM
    pixel.y = EVERY * ((IMAGE_HEIGHT - 1) / EVERY) - pixel.y;
#endif
    vec3 XYZ = scene_XYZ(pixel);
#if FORM == LUT && !(REDUCE || MARK || SIMULATE)
    vec3 code = clamp(code_from_adapted(XYZ), 0.0, 1.0);
#else
#if FORM == LINEAR
    vec3 linear = RGB_FROM_XYZ * XYZ;
#elif FORM == LUT
    vec3 linear = decode(code_from_adapted(XYZ));
#elif FIELD
    vec2 size = vec2(textureSize(coefficients, 0).xy);
    vec3 linear = displayed_from_scene(XYZ, (vec2(pixel) + 0.5) / size);
#else
    vec3 linear = displayed_from_scene(XYZ);
#endif
#if REDUCE || MARK
    bool outside = !is_shown(linear);
#endif
#if REDUCE
    if (outside) linear = reduce_chroma(linear);
#endif
#if SIMULATE
    linear = simulated(clamp(linear, 0.0, 1.0));
#endif
    vec3 code = encode(linear);
#endif
#if MARK
    if (outside) code = hatch(code, pixel);
#endif
    frame = vec4(code, 1.0);
}
