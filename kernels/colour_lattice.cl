// Turn sRGB codes into channels: trilinear interpolation in a lattice over the cube of codes.
//
//     channels[p] = Σ w(p, corner) lattice[corner],  8 corners of the code's cell
//
// NumPy twin: volspec/mesh/texture.py (interpolate). Equal to half-float's rounding.
//
// Launch: 1-D, one work-item per texel, in whole work-groups.
//
// Reads   codes     ushort[count][3]: red, green, blue; 65535 is 1
//         lattice   float4[SIDE][SIDE][SIDE][VECTORS]: by red, green, blue; channels, then 0
// Writes  channels  half[count][VECTORS * 4]
//
// The host sets SIDE and VECTORS.

__kernel void interpolate(__global const ushort *restrict codes,
                          __global const float4 *restrict lattice,
                          __global half *restrict channels, const uint count) {
    const size_t texel = get_global_id(0);
    if (texel >= count) return;
    const float3 at = convert_float3(vload3(texel, codes)) * ((SIDE - 1) / 65535.0f);
    const int3 cell = min(convert_int3(at), SIDE - 2);
    const float3 high = at - convert_float3(cell), low = 1.0f - high;
    float4 found[VECTORS];
    for (int v = 0; v < VECTORS; ++v) found[v] = 0.0f;
    for (int red = 0; red < 2; ++red) {
        for (int green = 0; green < 2; ++green) {
            const float pair = (red ? high.x : low.x) * (green ? high.y : low.y);
            const int row = ((cell.x + red) * SIDE + cell.y + green) * SIDE + cell.z;
            __global const float4 *entry = lattice + (size_t)row * VECTORS;
            const float near = pair * low.z, far = pair * high.z;
            for (int v = 0; v < VECTORS; ++v)
                found[v] += near * entry[v] + far * entry[VECTORS + v];
        }
    }
    for (int v = 0; v < VECTORS; ++v) vstore_half4(found[v], texel * VECTORS + v, channels);
}
