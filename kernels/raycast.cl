// Cast rays through a scalar volume and gather what they meet, front to back.
//
//     α = 1 − (1 − opacity(v))^(length / step),  C += T α (g s(v) + k_s),  T ← T (1 − α)
//     g, k_s: what the light groups shed (include/shade.clh), a layer of C each      (METHOD §3)
//
// NumPy twin: volspec/raycast/reference.py (cast). Same steps, same clipping, same order.
//
// Launch: 2-D, one work-item per tile of TILE_WIDTH × TILE_HEIGHT pixels (a packet of LANES
// rays), in bands: first_tile is the first row of tiles. (PoCL would build a second program for
// a launch with an offset.)
//
// Reads   voxels   VOXEL[nz][ny][nx] (include/voxels.clh)
//         codes    uchar per brick of BRICK³ cells: what may be seen (include/rays.clh)
//         opacity  float2[rows][last_entry + 2]: opacity of one whole step, difference to the
//                  next entry; rows by gradient where TABLE_ROWS > 1
//         shares   floatP[rows][last_entry + 2][PARTS], what is reflected
//         channels float[SHARES + 1][CHANNELS], what shares mix, and white
//         filters  floatP[last_entry + 2][PARTS], with FILTERED: transmittance of one whole step,
//                  channel by channel; the last row is white
//         sources, layers   light (include/shade.clh, include/light.clh)
// Writes  coefficients float[height][width][GROUPS][CHANNELS] premultiplied; alpha, depth and
//         first float[height][width] (expected and first depth in smallest spacings, inf where
//         nothing is), from the band's first row on
//
// The host sets LANES, TILE_WIDTH, TILE_HEIGHT, TABLE_ROWS, and what the includes want.

#include "lanes.clh"
#include "rays.clh"
#include "voxels.clh"
#include "field.clh"
#include "light.clh"
#include "shade.clh"
#include "picture.clh"
#include "classify.clh"

__kernel void raycast(__global const VOXEL *restrict voxels, __global const uchar *restrict codes,
                      __global const float2 *restrict opacity,
                      __global const floatP *restrict shares,
                      __global const float *restrict channels,
                      __global const floatP *restrict filters,
                      __global const float4 *restrict sources,
                      __global const ushort *restrict layers, const Cast cast,
                      __global float *restrict coefficients, __global float *restrict alpha,
                      __global float *restrict depth, __global float *restrict first,
                      const int first_tile) {
    const int pixel_x = get_global_id(0) * TILE_WIDTH;
    const int pixel_y = (first_tile + get_global_id(1)) * TILE_HEIGHT;
    if (pixel_x >= cast.width || pixel_y >= cast.height) return;
    const Rays r = rays_of(&cast, pixel_x, pixel_y);
    const float per_step = 1.0f / cast.step;
    intN k = first_step(&cast, &r), due = k, stride = 1;
    const intN k_end = end_step(&cast, &r, k);
    Gathered g;
    begin(&g);

    intN live = MASK(k < k_end);
    // Bricks are asked only where no ray of the packet sees anything: while one does, the others
    // would wait for it all the same.
    int blank = 1;
    while (ANY(live)) {
        if (blank | ADAPTIVE) {
            leap(&cast, &r, codes, k_end, &k, &due, &stride, &live);
            if (!ANY(live)) break;
        }
        // A step, clipped, and sampled at its middle; long ones end where their brick does.
        intN taken = 1;
#if ADAPTIVE
        taken = PICK(MASK(k + stride <= due), stride, 1);
#endif
        const floatN step_begin = CONVERT_FLOAT(k) * cast.step;
        const floatN step_end = CONVERT_FLOAT(k + taken) * cast.step;
        const floatN begin = UPPER(step_begin, r.near), end = LOWER(step_end, r.far);
        const floatN middle = 0.5f * (begin + end);
        const Field f = field_at(&cast, voxels, opacity, &r, middle);
        floatN nx, ny, nz;
#if TABLE_ROWS > 1
        gradient_at(&cast, voxels, opacity, &f, &nx, &ny, &nz);
        const Entry entry = entry_at(&cast, opacity, &f, nx, ny, nz);
#else
        const Entry entry = entry_at(&cast, opacity, &f);
#endif
        floatN share = entry.opacity;
#if ADAPTIVE
        const floatN once = 1.0f - share, twice = once * once;
        share = PICK(MASK(taken == 2), 1.0f - twice, share);
        share = PICK(MASK(taken == 4), 1.0f - twice * twice, share);
#endif
        const intN clipped = (MASK(begin > step_begin) | MASK(end < step_end)) & live;
        if (ANY(clipped & MASK(share > 0.0f)))
            share = PICK(clipped, 1.0f - pow(1.0f - entry.opacity, (end - begin) * per_step),
                         share);
        share = PICK(live, share, (floatN)(0.0f));

        blank = !ANY(MASK(share > 0.0f));
        if (!blank) {
#if SHADED && TABLE_ROWS == 1
            gradient_at(&cast, voxels, opacity, &f, &nx, &ny, &nz);
#endif
            floatN weight[GROUPS], gloss[GROUPS];
#if FILTERED
            shade(&cast, sources, layers, &r, middle, nx, ny, nz, share, weight, gloss);
            floatL length;
            length.v = PICK(MASK(share > 0.0f), (end - begin) * per_step, (floatN)(0.0f));
            reflect_filtered(&g, shares, filters, &cast, &entry, weight, gloss, length);
            cover(&cast, &g, g.through - passing(&g), middle);
#else
            const floatN visible = g.through * share;
            shade(&cast, sources, layers, &r, middle, nx, ny, nz, visible, weight, gloss);
            reflect(&g, shares, &cast, &f, &entry, weight);
            EACH(group, GROUPS) g.gloss[group] += gloss[group];
            cover(&cast, &g, visible, middle);
#endif
            live &= MASK(g.through > cast.opaque);
        }
        k += taken;
        live &= MASK(k < k_end);
    }
    write_picture(&cast, &g, &r, pixel_x, pixel_y, first_tile * TILE_HEIGHT, channels,
                  coefficients, alpha, depth, first);
}
