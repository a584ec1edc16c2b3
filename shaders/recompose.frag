// Recompose a coefficient image from its layers of opacity: one pass per change of opacities.
//
//     left = T exp(-Σ s_k τ_k),   C_gk += (T - left) s_k τ_k f_gk / Σ s_k τ_k,
//     white_g += (T - left) gloss_g,   T = left                      near to far
//
// and fade (C as cast - C at scale 1) is added. The result replaces what relight.frag reads.
//
// NumPy twin: volspec/raycast/layered.py (OpacityLayers.recompose), image.py (recompose).
//
// Reads   layers    texture array of RGBA, TEXELS slices a layer, near to far. Number i of a layer
//                   is component i % 4 of its slice i / 4: τ[MATERIALS],
//                   shade[GROUPS][MATERIALS], gloss[GROUPS].
//         base      texture array with the result's slices: the picture as cast if DIFFERENCE,
//                   else its difference from its layers at scale 1.
//         scales    of the materials' optical depths; the first MATERIALS count.
//         fade      0 to 1.
//         shade_code, gloss_code  if CODED.
// Writes  recomposed  SLICES_DRAWN slices of channels and alpha from FIRST_SLICE on, as in
//                   relight.frag; if DIFFERENCE, what the picture as cast has and its layers lack.
// Host    COUNT (layers), MATERIALS, GROUPS, TEXELS, FIRST_SLICE, SLICES_DRAWN, DIFFERENCE,
//         CODED (1 if the numbers are 8-bit codes c of τ = TAU_CODE c³, shade = shade_code c,
//         gloss = gloss_code c²), TAU_CODE.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2DArray;
#endif

#define CHANNELS (GROUPS * (MATERIALS + 1))

uniform sampler2DArray layers, base;
uniform vec4 scales;
uniform float fade;
#if CODED
uniform float shade_code, gloss_code;
#endif

layout(location = 0) out vec4 recomposed[SLICES_DRAWN];

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float through = 1.0, made[CHANNELS + 4];
    for (int i = 0; i < CHANNELS + 4; ++i) made[i] = 0.0;
    for (int layer = 0; layer < COUNT; ++layer) {
        float number[4 * TEXELS], total = 0.0;
        for (int j = 0; j < TEXELS; ++j) {
            vec4 texel = texelFetch(layers, ivec3(pixel, layer * TEXELS + j), 0);
            for (int i = 0; i < 4; ++i) number[4 * j + i] = texel[i];
        }
        for (int k = 0; k < MATERIALS; ++k) {
#if CODED
            number[k] *= TAU_CODE * number[k] * number[k];
#endif
            number[k] *= scales[k];
            total += number[k];
        }
        if (total <= 0.0) continue;
        // 1 - exp(-total) loses all precision in faint layers.
        float faint = total * (1.0 - total * (0.5 - total * (1.0 / 6.0 - total / 24.0)));
        float seen = through * (total < 0.1 ? faint : 1.0 - exp(-total)), part = seen / total;
        for (int g = 0; g < GROUPS; ++g) {
            float gloss = number[MATERIALS * (GROUPS + 1) + g], share = part;
#if CODED
            gloss *= gloss_code * gloss;
            share *= shade_code;
#endif
            for (int k = 0; k < MATERIALS; ++k) {
                made[g * (MATERIALS + 1) + k] += share * number[k] * number[MATERIALS * (g + 1) + k];
            }
            made[g * (MATERIALS + 1) + MATERIALS] += seen * gloss;
        }
        through -= seen;
    }
    made[CHANNELS] = 1.0 - through;
    vec4 drawn[SLICES_DRAWN];
    for (int j = 0; j < SLICES_DRAWN; ++j) {
        int slice = FIRST_SLICE + j, i = 4 * slice;
        vec4 now = vec4(made[i], made[i + 1], made[i + 2], made[i + 3]);
        vec4 own = texelFetch(base, ivec3(pixel, slice), 0);
#if DIFFERENCE
        drawn[j] = own - now;
#else
        drawn[j] = max(now + fade * own, 0.0);
        if (slice == CHANNELS / 4) drawn[j][CHANNELS % 4] = min(drawn[j][CHANNELS % 4], 1.0);
#endif
    }
    // `300 es` takes only constant indices of outputs.
    recomposed[0] = drawn[0];
#if SLICES_DRAWN > 1
    recomposed[1] = drawn[1];
#endif
#if SLICES_DRAWN > 2
    recomposed[2] = drawn[2];
#endif
#if SLICES_DRAWN > 3
    recomposed[3] = drawn[3];
#endif
}
