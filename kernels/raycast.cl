// Cast rays through a scalar volume and composite their samples, front to back.
//
//     α = 1 − (1 − opacity(v))^(length / step),  C += T α (g s(v) + k_s),  T ← T (1 − α)
//     g, k_s: shading by the light groups (include/shade.clh), one layer of C per group
//
// (docs/method.md §3.) With FILTERED every channel has its own transmittance t_k of a step, and
// α_k = 1 − t_k.
//
// NumPy twin: volspec/raycast/reference.py (cast). Same steps, same clipping, same order.
//
// Launch: 2-D, one work-item per tile of TILE_WIDTH × TILE_HEIGHT pixels (a packet of LANES
// rays), in bands: first_tile is the band's first row of tiles. (PoCL would build a second program
// for a launch with an offset.)
//
// Reads   voxels       VOXEL[nz][ny][nx] (include/voxels.clh)
//         brick_codes  uchar per brick of BRICK³ cells: visibility (include/rays.clh)
//         opacity      float2[2][rows][last_entry + 2]: opacity of one whole step, or with POWERS
//                      of the reference step, difference to the left limit of the next entry; then
//                      the log of a step's transmittance (finite, also for opaque entries), that
//                      of the next's limit; rows by gradient if TABLE_ROWS > 1
//         material_weights  floatV[rows][last_entry + 2][2][VECTORS]: weights of the materials in
//                      the reflectance, and their difference to the next entry
//         channels     float[WEIGHTS + 1][cast.channels]: channels of each material, then of white
//         filters      floatV[last_entry + 2][2][VECTORS], with FILTERED: transmittance of one
//                      whole step, channel by channel, and its difference; the last is white
//         sources, light_volume  (include/shade.clh, include/light.clh)
//         spans        float2[height][width], with SPANS: distances from the camera, in smallest
//                      spacings, between which rays are cast
//         cast         settings of the cast: CAST in volspec/raycast/launch/kernel_arguments.py
//         through      float[height][width], with PARTS: transmittance of what is in front of the
//                      part, which is written without it (include/rays.clh, include/picture.clh)
// Writes  coefficients_out float[height][width][GROUPS][cast.channels] premultiplied; alpha_out,
//         depth_out and first_out float[height][width] (expected and first depth in smallest
//         spacings, inf for empty pixels), from the band's first row on; with LAYERED, layers_out
//         (include/layered.clh), which are of whole rays
//
// The host sets LANES, TILE_WIDTH, TILE_HEIGHT, TABLE_ROWS, STEPS (samples processed together, so
// that loads of one overlap sums of another), and the constants of the includes.

#include "lanes.clh"
#include "rays.clh"
#include "field.clh"
#include "classify.clh"
#include "shade.clh"
#include "picture.clh"
#include "layered.clh"

__kernel void raycast(__global const VOXEL *restrict voxels,
                      __global const uchar *restrict brick_codes,
                      __global const float2 *restrict opacity,
                      __global const floatV *restrict material_weights,
                      __global const float *restrict channels,
                      __global const floatV *restrict filters,
                      __global const float4 *restrict sources,
                      __global const ushort *restrict light_volume,
                      __global const float2 *restrict spans, const Cast cast,
#if PARTS
                      __global const float *restrict through,
#endif
                      __global float *restrict coefficients_out, __global float *restrict alpha_out,
                      __global float *restrict depth_out, __global float *restrict first_out,
#if LAYERED
                      __global float *restrict layers_out,
#endif
                      const int first_tile) {
    const int2 pixel = tile_pixel(first_tile);
    if (pixel.x >= cast.width || pixel.y >= cast.height) return;
    const Rays r = make_rays(&cast, spans, pixel);
    const float per_step = 1.0f / cast.step;
    March m = start_march(&cast, &r);
    Accumulator g;
    clear(&g, THROUGH_FRONT);
#if LAYERED
    Layers layers;
    clear_layers(&layers);
#else
    m.live &= MASK(g.transmittance > cast.min_transmittance);
#endif

    // Bricks are looked up only after steps without opacity in any lane: while one lane samples
    // something, the others wait for it anyway.
    int transparent = 1;
    while (ANY(m.live)) {
        if (transparent | ADAPTIVE) {
            skip_empty_bricks(&cast, &r, brick_codes, &m);
            if (!ANY(m.live)) break;
        }
        // Steps are clipped and sampled at their midpoints, STEPS together and stage by stage, so
        // that their loads overlap.
        floatN middle[STEPS], alpha[STEPS], steps[STEPS];
        floatN fraction[STEPS];  // the clipped length, in steps
        floatN nx[STEPS], ny[STEPS], nz[STEPS];
        intN marched[STEPS];
        Sample f[STEPS];
        Entry entry[STEPS];
        transparent = 1;
        UNROLL(s, STEPS) {
            intN count = 1;
#if ADAPTIVE
            // Long steps end at the boundary of their brick.
            count = SELECT(MASK(m.k + m.stride <= m.next_brick), m.stride, 1);
#endif
            steps[s] = CONVERT_FLOAT(count);
            const floatN begin = MAX(CONVERT_FLOAT(m.k) * cast.step, r.near);
            const floatN end = MIN(CONVERT_FLOAT(m.k + count) * cast.step, r.far);
            middle[s] = 0.5f * (begin + end);
            fraction[s] = (end - begin) * per_step;
            f[s] = sample_at(&cast, voxels, opacity, &r, middle[s]);
            m.live &= MASK(m.k < m.k_end);
            marched[s] = m.live & in_part(&r, middle[s]);
            m.k += count;
        }
        UNROLL(s, STEPS) {
#if TABLE_ROWS > 1
            gradient_at(&cast, voxels, opacity, &f[s], &nx[s], &ny[s], &nz[s]);
            entry[s] = classify(&cast, opacity, &f[s], nx[s], ny[s], nz[s]);
#else
            entry[s] = classify(&cast, opacity, &f[s]);
#endif
            alpha[s] = entry[s].opacity;
#if ADAPTIVE
            // Not via 1 − alpha, which loses all precision for faint media.
            const floatN two = alpha[s] * (2.0f - alpha[s]), four = two * (2.0f - two);
            alpha[s] = SELECT(MASK(steps[s] == 2.0f), two, alpha[s]);
            alpha[s] = SELECT(MASK(steps[s] == 4.0f), four, alpha[s]);
#endif
            alpha[s] = SELECT(marched[s], alpha[s], (floatN)(0.0f));
            transparent &= !ANY(MASK(alpha[s] > 0.0f));
        }
#if TABLE_ROWS == 1
        UNROLL(s, STEPS) {
            nx[s] = ny[s] = nz[s] = 0.0f;
#if NORMALS
            // In one block, loads overlap; with rows of two-byte voxels that would need too many
            // registers.
            if (FOUR_SHORTS ? ANY(MASK(alpha[s] > 0.0f)) : !transparent)
                gradient_at(&cast, voxels, opacity, &f[s], &nx[s], &ny[s], &nz[s]);
#endif
        }
#endif
        UNROLL(s, STEPS) {
            const intN reached = MASK(g.transmittance > cast.min_transmittance);
#if !LAYERED
            alpha[s] = SELECT(reached, alpha[s], (floatN)(0.0f));
#endif
            const intN opaque = MASK(alpha[s] > 0.0f);
            if (!ANY(opaque)) continue;
            // The first and the last step of a ray are clipped.
            const intN clipped = opaque & MASK(fraction[s] < steps[s] - 1e-5f);
            if (ANY(clipped)) {
                const floatN log_step = log_transmittance(&cast, opacity, &f[s], &entry[s]);
                const floatN shorter = opacity_along(entry[s].opacity, log_step, fraction[s]);
                alpha[s] = SELECT(clipped, shorter, alpha[s]);
            }
            const floatN away = lift_at(&cast, depth_of_matter(opacity, &f[s], &entry[s]));
            floatN shading[GROUPS], highlight[GROUPS];
#if FILTERED
            // Each channel is weighted by its own loss, in accumulate_filtered.
            const floatN unweighted = SELECT(opaque, (floatN)(1.0f), (floatN)(0.0f));
            const floatN length = SELECT(opaque, fraction[s], (floatN)(0.0f));
            shade(&cast, sources, light_volume, &r, middle[s], nx[s], ny[s], nz[s], away,
                  unweighted, shading, highlight);
            reflect_filtered(&g, material_weights, filters, &cast, &entry[s], shading, highlight,
                             length);
            add_alpha(&cast, &g, g.transmittance - mean_transmittance(&g), middle[s]);
#elif LAYERED
            const floatN unweighted = SELECT(opaque, (floatN)(1.0f), (floatN)(0.0f));
#if SLOTS
            Unshadowed bare;
            shade(&cast, sources, light_volume, &r, middle[s], nx[s], ny[s], nz[s], away,
                  unweighted, &bare, shading, highlight);
#else
            shade(&cast, sources, light_volume, &r, middle[s], nx[s], ny[s], nz[s], away,
                  unweighted, shading, highlight);
#endif
            // The picture ends where it would without layers.
            const floatN visible = SELECT(reached, g.transmittance * alpha[s], (floatN)(0.0f));
            floatN seen[GROUPS];
            UNROLL(group, GROUPS) {
                seen[group] = visible * shading[group];
                g.highlight[group] += visible * highlight[group];
            }
            reflect(&g, material_weights, &cast, &f[s], &entry[s], seen);
            add_alpha(&cast, &g, visible, middle[s]);
#if SLOTS
            add_to_layers(&layers, g.rows, alpha[s], middle[s], &bare, bare.diffuse,
                          bare.highlight);
#else
            add_to_layers(&layers, g.rows, alpha[s], middle[s], shading, highlight);
#endif
#else
            const floatN visible = g.transmittance * alpha[s];
            shade(&cast, sources, light_volume, &r, middle[s], nx[s], ny[s], nz[s], away,
                  visible, shading, highlight);
            reflect(&g, material_weights, &cast, &f[s], &entry[s], shading);
            UNROLL(group, GROUPS) g.highlight[group] += highlight[group];
            add_alpha(&cast, &g, visible, middle[s]);
#endif
        }
        m.live &= MASK(m.k < m.k_end);
#if !LAYERED
        m.live &= MASK(g.transmittance > cast.min_transmittance);
#endif
    }
    write_picture(&cast, &g, &r, pixel, first_tile * TILE_HEIGHT, channels, coefficients_out,
                  alpha_out, depth_out, first_out);
#if LAYERED
    write_layers(&cast, &layers, &r, pixel, first_tile * TILE_HEIGHT, layers_out);
#endif
}
