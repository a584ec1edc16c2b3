// A pixel's part of a splatted layer, by a tent: shaders/splat.vert.
//
// Writes  sums  premultiplied by opacity: three channels of each target, and the opacity.
// Host    TARGETS_DRAWN, and what include/opacity.glsl takes.
//
// Valid for `300 es`; the host writes the version line.
precision highp float;
precision highp int;
precision highp sampler2DArray;

#include "opacity.glsl"

flat in vec3 place;
flat in float tau;
flat in vec3 colours[TARGETS_DRAWN];

layout(location = 0) out vec4 sums[TARGETS_DRAWN];

void main() {
    vec2 near = max(1.0 - abs(gl_FragCoord.xy - 0.5 - place.xy) / place.z, 0.0);
    float seen = opacity_of(tau * near.x * near.y);
    sums[0] = seen * vec4(colours[0], 1.0);
#if TARGETS_DRAWN > 1
    sums[1] = seen * vec4(colours[1], 1.0);
#endif
#if TARGETS_DRAWN > 2
    sums[2] = seen * vec4(colours[2], 1.0);
#endif
#if TARGETS_DRAWN > 3
    sums[3] = seen * vec4(colours[3], 1.0);
#endif
}
