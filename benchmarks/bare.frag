// What relighting cannot do without: read the channels, write D (e * C). For `330 core`.

uniform sampler2DArray coefficients;
uniform mat4x3 XYZ_from_layer[LAYERS];

out vec4 frame;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 XYZ = vec3(0.0);
    for (int layer = 0; layer < LAYERS; ++layer)
        XYZ += XYZ_from_layer[layer] * texelFetch(coefficients, ivec3(pixel, layer), 0);
    frame = vec4(XYZ, 1.0);
}
