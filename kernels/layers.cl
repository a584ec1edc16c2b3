// Pack the channels of cast pixels for the relighting shader: four per layer of a texture.
//
//     layers[c / 4][line][column][c % 4] = v within ±LIMIT, NaN as 0
//     v: channel c of the pixel; c = CHANNELS is alpha, the rest is 0
//
// With HALF channels are rounded to half-float, as the image in memory is.
//
// NumPy twin: volspec/relight/texture_planes.py (pack_layers). The same numbers.
//
// Launch: 3-D, one work-item per pixel and layer: (columns, lines of the band, layers), columns in
// whole work-groups. For GPUs: neighbours write neighbouring float4.
//
// Reads   coefficients float[lines][width][CHANNELS], alpha float[lines][width]: a band's
// Writes  layers float4[layers][height][width], lines first_line and on: a buffer of OpenGL,
//         acquired by the host (volspec/_gpu/sharing.py)
//
// The host sets CHANNELS, LIMIT, HALF and MAX_HALF.

static inline float bounded(float v, float limit) {
    return v != v ? 0.0f : v < -limit ? -limit : v > limit ? limit : v;
}

static inline float channel(float v) {
#if HALF
    ushort bits;
    vstore_half_rte(bounded(v, MAX_HALF), 0, (half *)&bits);
    return vload_half(0, (const half *)&bits);
#else
    return bounded(v, LIMIT);
#endif
}

__kernel void pack_layers(__global const float *coefficients, __global const float *alpha,
                          __global float4 *layers, const int width, const int height,
                          const int first_line) {
    const int column = get_global_id(0), line = get_global_id(1), first = 4 * get_global_id(2);
    if (column >= width) return;
    const size_t pixel = (size_t)line * width + column;
    float4 packed = 0.0f;
    float *out = (float *)&packed;
    for (int i = 0; i < 4; ++i) {
        const int c = first + i;
        if (c < CHANNELS) out[i] = channel(coefficients[pixel * CHANNELS + c]);
        if (c == CHANNELS) out[i] = bounded(alpha[pixel], LIMIT);
    }
    layers[((size_t)get_global_id(2) * height + first_line + line) * width + column] = packed;
}
