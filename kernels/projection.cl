// Cast rays through a scalar volume and show the maximum or the mean value along each.
//
//     C = opacity(v) · Σ light · s(v),  v = max or mean of the values at the steps' middles
//
// A sample with a part of a missing voxel does not count. Nothing is shaded:
// n · l = 1 for every source. NumPy twin: volspec/raycast/reference.py (_Projection).
//
// Launch and arguments: as raycast.cl, but
//         brick_codes  VOXEL per brick: its greatest value, which MAXIMUM uses to skip bricks
//         opacity      over the reference step instead of a step, and no logs
//         so_far       float2[height][width], with PARTS instead of through: of the parts before, in
//                      any order, the greatest value and its place, or the sum of values times
//                      lengths, and of lengths; this part is added. The picture is that of all
// The host sets MAXIMUM (1, or 0 for the mean) in addition to the constants of raycast.cl.

#include "lanes.clh"
#include "rays.clh"
#include "field.clh"
#include "classify.clh"
#include "shade.clh"
#include "picture.clh"

__kernel void projection(__global const VOXEL *restrict voxels,
                         __global const VOXEL *restrict brick_codes,
                         __global const float2 *restrict opacity,
                         __global const floatV *restrict material_weights,
                         __global const float *restrict channels,
                         __global const float4 *restrict sources,
                         __global const ushort *restrict light_volume,
                         __global const float2 *restrict spans, const Cast cast,
#if PARTS
                         __global float2 *restrict so_far,
#endif
                         __global float *restrict coefficients_out,
                         __global float *restrict alpha_out, __global float *restrict depth_out,
                         __global float *restrict first_out, const int first_tile) {
    const int2 pixel = tile_pixel(first_tile);
    if (pixel.x >= cast.width || pixel.y >= cast.height) return;
    const Rays r = make_rays(&cast, spans, pixel);
    March m = start_march(&cast, &r);
    floatN sum = 0.0f, length = 0.0f, best = -INFINITE, best_at = 0.0f;
#if PARTS
    floatL one, other;
    UNROLL(l, LANES) {
        const float2 before = so_far[lane_pixel(&cast, pixel, l)];
        one.s[l] = before.x;
        other.s[l] = before.y;
    }
#if MAXIMUM
    best = one.v;
    best_at = other.v;
#else
    sum = one.v;
    length = other.v;
#endif
#endif
    while (ANY(m.live)) {
#if MAXIMUM
        for (intN pending = PENDING(m); ANY(pending); pending = PENDING(m)) {
            const Bricks bricks = bricks_at(&cast, &r, step_middle(&cast, &r, m.k));
            intL number;
            floatL greatest;
            number.v = bricks.number;
            UNROLL(l, LANES) greatest.s[l] = brick_codes[(uint)number.s[l]];
            const floatN leave = bricks_exit(&r, &bricks, (intN)(0));
            const intN next = m.k + steps_beyond(&cast, m.k, leave);
            const intN lower = MASK(greatest.v - cast.domain_low <= best);
            m.next_brick = SELECT(pending & ~lower, next, m.next_brick);
            m.k = SELECT(pending & lower, next, m.k);
            m.live &= MASK(m.k < m.k_end);
        }
        if (!ANY(m.live)) break;
#endif
        const floatN begin = MAX(CONVERT_FLOAT(m.k) * cast.step, r.near);
        const floatN end = MIN(CONVERT_FLOAT(m.k + 1) * cast.step, r.far);
        const floatN middle = 0.5f * (begin + end);
        const Sample f = sample_at(&cast, voxels, opacity, &r, middle);
        intN counts = m.live & in_part(&r, middle);
#if MISSING
        counts &= f.present;
#endif
#if MAXIMUM
        const intN more = counts & MASK(f.value > best);
        best = SELECT(more, f.value, best);
        best_at = SELECT(more, middle, best_at);
#else
        const floatN clipped = SELECT(counts, end - begin, (floatN)(0.0f));
        sum += clipped * SELECT(counts, f.value, (floatN)(0.0f));
        length += clipped;
#endif
        m.k += 1;
        m.live &= MASK(m.k < m.k_end);
    }
    // Whether a ray that touches an edge meets anything is rounding.
    intN meets = MASK(r.far - r.near > CUT_TOLERANCE);
#if MAXIMUM
    meets &= MASK(best > -INFINITE);
#else
    meets &= MASK(length > 0.0f);
#endif
#if PARTS
#if MAXIMUM
    one.v = best;
    other.v = best_at;
#else
    one.v = sum;
    other.v = length;
#endif
    UNROLL(l, LANES) {
        const int column = pixel.x + l % TILE_WIDTH, line = pixel.y + l / TILE_WIDTH;
        if (column < cast.width && line < cast.height)
            so_far[lane_pixel(&cast, pixel, l)] = (float2)(one.s[l], other.s[l]);
    }
#endif
#if !MAXIMUM
    best = sum / MAX(length, 1e-30f);
    best_at = 0.5f * (r.near + r.far);
#endif
    Accumulator g;
    clear(&g, 1.0f);
    Sample shown;
#if MISSING
    shown.present = -1;
#endif
    shown.value = SELECT(meets, best, (floatN)(0.0f));
    const Entry entry = classify(&cast, opacity, &shown);
    const floatN visible = SELECT(meets, entry.opacity, (floatN)(0.0f));
    const floatN unshaded = 0.0f;
    floatN shading[GROUPS], highlight[GROUPS];
    shade(&cast, sources, light_volume, &r, best_at, unshaded, unshaded, unshaded, unshaded, visible,
          shading, highlight);
    reflect(&g, material_weights, &cast, &shown, &entry, shading);
    add_alpha(&cast, &g, visible, best_at);
    write_picture(&cast, &g, &r, pixel, first_tile * TILE_HEIGHT, channels, coefficients_out,
                  alpha_out, depth_out, first_out);
}
