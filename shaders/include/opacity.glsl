// A layer of opacity: the optical depths of its materials, its light, and its place on the ray.
//
// Shades and highlights of groups that are SHADOWED or OCCLUDED are kept apart from the light that
// shadows take: they are multiplied by
//
//     1 - v + v p,   p = min(1, gain (1 + Σ s_k (exp(b E_k) - 1))^(-1/b))
//
// NumPy twins: volspec/image/layers.py (OpacityLayers.lit); depth.py (extents, _slabs) with DEPTH.
//
// Reads   layers    texture array of RGBA, TEXELS slices a layer, near to far: τ of up to four
//                   materials; for each light group their shades, and the highlight after them;
//                   four materials leave no place for it: highlights follow, four to a slice.
//                   From slice SHADOWS_AT on two slices for each group's shadow and occlusion: E;
//                   v of the shade and of the highlight, and b.
//                   With EXTENTS a slice more: where it begins, mm beyond nearest_mm; its width.
//         scales    of the materials' optical depths; the first MATERIALS count.
//         cut_mm, fog (per mm, mm), fog_light, slope (of a pixel to the axis), nearest_mm  if DEPTH.
//         shade_code, gloss_code  if CODED.
// Host    COUNT (layers), SOLID (1 if the last is of surfaces, which scales leave as they are),
//         FILLED (1 if layers are used from the first on), MATERIALS, GROUPS, TEXELS,
//         CODED (1 if the numbers are 8-bit codes c of τ = TAU_CODE c³, shade = shade_code c,
//         gloss = gloss_code c², E = PATH_CODE c³, b = BEND_CODE c³, a slab's begin = BEGIN_CODE c
//         and width = WIDTH_CODE c²; a surface's begin = SURFACE_CODE c, c of both), TAU_CODE,
//         PATH_CODE, BEND_CODE, BEGIN_CODE, WIDTH_CODE, SURFACE_CODE;
//         SHADOWED and OCCLUDED (bits of groups), SHADOWS_AT, OCCLUSION_GAIN, BEND_MIN and
//         MAX_EXPONENT.
#ifndef DEPTH
#define DEPTH 0
#endif
#define CHANNELS (GROUPS * (MATERIALS + 1))

uniform sampler2DArray layers;
uniform vec4 scales;
#if CODED
uniform float shade_code, gloss_code;
#endif

vec4 scaled_depths(ivec2 pixel, int slice) {
    vec4 tau = texelFetch(layers, ivec3(pixel, slice), 0);
#if CODED
    tau *= TAU_CODE * tau * tau;
#endif
#if SOLID
    if (slice >= (COUNT - 1) * TEXELS) return tau;
#endif
    return tau * scales;
}

// Layers to look at: none in a pixel without any, where software devices leave the loop. With FILLED
// a layer before the last is used only if the first is.
int layers_of(ivec2 pixel) {
#if FILLED
    float found = dot(texelFetch(layers, ivec3(pixel, 0), 0), vec4(1.0));
#if SOLID
    found += dot(texelFetch(layers, ivec3(pixel, (COUNT - 1) * TEXELS), 0), vec4(1.0));
#endif
    return found > 0.0 ? COUNT : 0;
#else
    return COUNT;
#endif
}

// 1 - exp(-tau), which loses all precision in faint layers.
float opacity_of(float tau) {
    float faint = tau * (1.0 - tau * (0.5 - tau * (1.0 / 6.0 - tau / 24.0)));
    return tau < 0.1 ? faint : 1.0 - exp(-tau);
}

#if SHADOWED || OCCLUDED
// Fractions of a shade and of a highlight that are taken from it.
vec2 taken(ivec2 pixel, int slice, float gain) {
    vec4 path = texelFetch(layers, ivec3(pixel, slice), 0);
    vec4 part = texelFetch(layers, ivec3(pixel, slice + 1), 0);
#if CODED
    path *= PATH_CODE * path * path;
    part.z *= BEND_CODE * part.z * part.z;
#endif
    float bend = max(part.z, BEND_MIN);
    vec4 depth = min(bend * path, vec4(MAX_EXPONENT));
    // exp(depth) - 1 loses all precision of small depths.
    vec4 small = depth * (1.0 + depth * (0.5 + depth / 6.0));
    vec4 grown = mix(exp(depth) - 1.0, small, lessThan(depth, vec4(0.02)));
    float passes = exp(-log(1.0 + dot(grown, scales)) / bend);
    return part.xy * (1.0 - min(gain * passes, 1.0));
}
#endif

// A layer's shades of the materials and its highlight, under the light of a group.
struct Light {
    vec4 shade;
    float gloss;
};

Light light_of(ivec2 pixel, int slice, int g) {
    vec4 shade = texelFetch(layers, ivec3(pixel, slice + 1 + g), 0);
#if MATERIALS == 4
    vec4 highlights = texelFetch(layers, ivec3(pixel, slice + 1 + GROUPS + g / 4), 0);
    float gloss = dot(highlights, vec4(equal(ivec4(g % 4), ivec4(0, 1, 2, 3))));
#else
    float gloss = shade[MATERIALS];
#endif
#if CODED
    gloss *= gloss_code * gloss;
    shade *= shade_code;
#endif
#if SHADOWED || OCCLUDED
    bool shadowed = ((SHADOWED >> g) & 1) == 1, occluded = ((OCCLUDED >> g) & 1) == 1;
    int at = slice + SHADOWS_AT;
    for (int i = 0; i < g; ++i) at += 2 * (((SHADOWED >> i) & 1) + ((OCCLUDED >> i) & 1));
    vec2 kept = vec2(1.0);
    if (shadowed) kept -= taken(pixel, at, 1.0);
    if (occluded) kept -= taken(pixel, at + (shadowed ? 2 : 0), OCCLUSION_GAIN);
    shade *= kept.x;
    gloss *= kept.y;
#endif
    return Light(shade, gloss);
}

#if DEPTH
uniform vec2 cut_mm, fog;
uniform float fog_light[GROUPS], slope, nearest_mm;

float fog_clear(float distance_mm) {
    return exp(-fog.x * max(distance_mm - fog.y, 0.0));
}

// Distance along the ray of a pixel by that along the axis.
float stretch_of(vec2 from_middle) {
    vec2 off_axis = slope * from_middle;
    return sqrt(1.0 + dot(off_axis, off_axis));
}

// How deep light goes into a slab, as a fraction of its width.
float mean_position(float tau) {
    if (tau < 0.1) return 0.5 - tau * (1.0 / 12.0 - tau * tau / 720.0);
    return 1.0 / tau - 1.0 / (exp(min(tau, 64.0)) - 1.0);
}

// Optical depth that the cuts leave of a layer's, its expected distance along the ray, and the width.
vec3 slab_of(ivec2 pixel, int slice, float tau, float stretch) {
    vec2 extent = texelFetch(layers, ivec3(pixel, slice + TEXELS - 1), 0).xy;
#if CODED && SOLID
    bool surface = slice >= (COUNT - 1) * TEXELS;
    vec2 place = vec2(SURFACE_CODE * (256.0 * extent.x + extent.y) / 257.0, 0.0);
    extent = surface ? place : extent * vec2(BEGIN_CODE, WIDTH_CODE * extent.y);
#elif CODED
    extent *= vec2(BEGIN_CODE, WIDTH_CODE * extent.y);
#endif
    float begin = nearest_mm + extent.x, end = begin + extent.y;
    float start = max(begin, stretch * cut_mm.x), stop = min(end, stretch * cut_mm.y);
    tau *= extent.y > 0.0 ? clamp((stop - start) / extent.y, 0.0, 1.0) : float(start <= stop);
    return vec3(tau, start + (stop - start) * mean_position(tau), stop - start);
}
#endif
