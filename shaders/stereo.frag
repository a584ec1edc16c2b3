// Combine both eyes' frames: next to each other, or as an anaglyph that is mixed in linear light.
//
//     mixed = left_mix decode(left) + right_mix decode(right),   code = encode(clamp(mixed, 0, 1))
//
// NumPy twin: volspec/relight/stereo.py (Stereo.combine).
//
// Reads   left, right   frames of equal size, codes of the display; SIDE_BY_SIDE shows left left.
//         decoded       linear light by code, 256 texels.
//         encoded       code by the root of linear light, 0 to 1, ENCODED texels.
//         left_mix, right_mix
// Writes  colour        codes.
// Host    SIDE_BY_SIDE (1 or 0), ENCODED.
//
// Valid for `330 core`; the host writes the version line.
uniform sampler2D left, right, decoded, encoded;
uniform mat3 left_mix, right_mix;

layout(location = 0) out vec4 colour;

vec3 linear_light(vec3 code) {
    ivec3 at = ivec3(code * 255.0 + 0.5);
    return vec3(texelFetch(decoded, ivec2(at.r, 0), 0).r, texelFetch(decoded, ivec2(at.g, 0), 0).r,
                texelFetch(decoded, ivec2(at.b, 0), 0).r);
}

float code_of(float light) {
    float place = sqrt(clamp(light, 0.0, 1.0)) * float(ENCODED - 1);
    int low = min(int(place), ENCODED - 2);
    return mix(texelFetch(encoded, ivec2(low, 0), 0).r,
               texelFetch(encoded, ivec2(low + 1, 0), 0).r, place - float(low));
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
#if SIDE_BY_SIDE
    int width = textureSize(left, 0).x;
    colour = at.x < width ? texelFetch(left, at, 0) : texelFetch(right, at - ivec2(width, 0), 0);
#else
    vec3 light = left_mix * linear_light(texelFetch(left, at, 0).rgb)
        + right_mix * linear_light(texelFetch(right, at, 0).rgb);
    colour = vec4(code_of(light.r), code_of(light.g), code_of(light.b), 1.0);
#endif
}
