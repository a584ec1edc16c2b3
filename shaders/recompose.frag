// Recompose a coefficient image from its layers of opacity: one pass per change of opacities.
//
//     left = T exp(-Σ s_k τ_k),   C_gk += (T - left) s_k τ_k f_gk / Σ s_k τ_k,
//     white_g += (T - left) gloss_g,   T = left                      near to far
//
// and fade (C as cast - C at scale 1) is added. The result replaces what relight.frag reads.
//
// With DEPTH, layers are cut, and seen through fog F(d) = exp(-fog.x (d - fog.y)), which adds
//
//     white_g += fog_light_g T (F(d_i) - F(d_j))    between layers i and j, to the cut's far end.
//
// NumPy twin: volspec/raycast/layered.py (OpacityLayers.recompose), image.py (recompose), and
// depth.py with DEPTH.
//
// Reads   layers    texture array of RGBA, TEXELS slices a layer, near to far. Number i of a layer
//                   is component i % 4 of its slice i / 4: τ[MATERIALS],
//                   shade[GROUPS][MATERIALS], gloss[GROUPS]; with EXTENTS, where it begins, in mm
//                   beyond nearest_mm, and its width.
//         base      texture array with the result's slices: the picture as cast if DIFFERENCE,
//                   else its difference from its layers at scale 1.
//         scales    of the materials' optical depths; the first MATERIALS count.
//         fade      0 to 1.
//         cut_mm, fog (per mm, mm), fog_light, slope (of a pixel to the axis), nearest_mm  if DEPTH.
//         shade_code, gloss_code  if CODED.
// Writes  recomposed  SLICES_DRAWN slices of channels and alpha from FIRST_SLICE on, as in
//                   relight.frag; if DIFFERENCE, what the picture as cast has and its layers lack.
// Host    COUNT (layers), MATERIALS, GROUPS, TEXELS, EXTENTS, FIRST_SLICE, SLICES_DRAWN,
//         DIFFERENCE, DEPTH (needs EXTENTS), CODED (1 if the numbers are 8-bit codes c of τ = TAU_CODE c³, shade = shade_code c,
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

#if DEPTH
uniform vec2 cut_mm, fog;
uniform float fog_light[GROUPS], slope, nearest_mm;
#endif

layout(location = 0) out vec4 recomposed[SLICES_DRAWN];

#if DEPTH
float fog_clear(float distance_mm) {
    return exp(-fog.x * max(distance_mm - fog.y, 0.0));
}

// How deep light goes into a slab, as a fraction of its width.
float mean_position(float tau) {
    if (tau < 0.1) return 0.5 - tau * (1.0 / 12.0 - tau * tau / 720.0);
    return 1.0 / tau - 1.0 / (exp(min(tau, 64.0)) - 1.0);
}
#endif

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float through = 1.0, made[CHANNELS + 4];
#if DEPTH
    vec2 off_axis = slope * (gl_FragCoord.xy - 0.5 * vec2(textureSize(layers, 0).xy));
    float along = sqrt(1.0 + dot(off_axis, off_axis)), lit = 1.0, white = 0.0;
#endif
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
        float own = total;
#if DEPTH
        const int at = MATERIALS * (GROUPS + 1) + GROUPS;
        float begin = nearest_mm + number[at], width = number[at + 1];
        float start = max(begin, along * cut_mm.x), stop = min(begin + width, along * cut_mm.y);
        total *= width > 0.0 ? clamp((stop - start) / width, 0.0, 1.0) : float(start <= stop);
        if (total <= 0.0) continue;
        float clear = min(fog_clear(start + (stop - start) * mean_position(total)), lit);
        white += through * (lit - clear);
        lit = clear;
#endif
        // 1 - exp(-total) loses all precision in faint layers.
        float faint = total * (1.0 - total * (0.5 - total * (1.0 / 6.0 - total / 24.0)));
        float seen = through * (total < 0.1 ? faint : 1.0 - exp(-total));
        through -= seen;
#if DEPTH
        seen *= clear;
#endif
        float part = seen / own;
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
    }
#if DEPTH
    float end = fog_clear(along * cut_mm.y);
    white += through * (lit - end);
    through *= end;
    for (int g = 0; g < GROUPS; ++g) made[g * (MATERIALS + 1) + MATERIALS] += fog_light[g] * white;
#endif
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
