// Cast rays through a scalar volume and composite its isosurfaces, front to back.
//
//     C += T a (g s + k_s),  T ← T (1 − a)      at each crossing of a level of opacity a
//
// A step crosses a level if the values at its two ends are on different sides (below, or at and
// above); ITERATIONS of the rule of false position find the crossing. NumPy twin:
// volspec/raycast/reference.py (_Surfaces).
//
// Launch and arguments: as raycast.cl, but
//         opacity           float2[SURFACES]: level and opacity of a surface, by increasing level
//         material_weights  floatV[SURFACES][VECTORS]
// The host sets SURFACES and ITERATIONS in addition to the constants of raycast.cl; TABLE_ROWS and
// LABELS are not used.

#include "lanes.clh"
#include "rays.clh"
#include "field.clh"
#include "shade.clh"
#include "picture.clh"
#include "step_ends.clh"

// Position between the step's ends at which the value is `level`.
static inline floatN find_crossing(const Cast *cast, __global const VOXEL *voxels,
                                   __global const float2 *opacity, const Rays *r,
                                   const StepEnds *e, floatN level) {
    floatN begin = e->begin, end = e->end, front = e->front, back = e->back;
    floatN along = begin + (level - front) / (back - front) * (end - begin);
    for (int i = 0; i < ITERATIONS; ++i) {
        const Sample f = sample_at(cast, voxels, opacity, r, along);
        const intN before = MASK(f.value < level) == MASK(front < level);
        begin = SELECT(before, along, begin);
        front = SELECT(before, f.value, front);
        end = SELECT(before, end, along);
        back = SELECT(before, back, f.value);
        const floatN rise = back - front;
        along = SELECT(MASK(rise == 0.0f), begin, begin + (level - front) / rise * (end - begin));
    }
    return along;
}

__kernel void surfaces(__global const VOXEL *restrict voxels,
                       __global const uchar *restrict brick_codes,
                       __global const float2 *restrict opacity,
                       __global const floatV *restrict material_weights,
                       __global const float *restrict channels,
                       __global const float4 *restrict sources,
                       __global const ushort *restrict light_volume,
                       __global const float2 *restrict spans, const Cast cast,
#if PARTS
                       __global const float *restrict through,
#endif
                       __global float *restrict coefficients_out,
                       __global float *restrict alpha_out, __global float *restrict depth_out,
                       __global float *restrict first_out, const int first_tile) {
    const int2 pixel = tile_pixel(first_tile);
    if (pixel.x >= cast.width || pixel.y >= cast.height) return;
    const Rays r = make_rays(&cast, spans, pixel);
    March m = start_march(&cast, &r);
    Accumulator g;
    clear(&g, THROUGH_FRONT);
    m.live &= MASK(g.transmittance > cast.min_transmittance);
    StepEnds e = no_ends(m.k);

    while (ANY(m.live)) {
        skip_empty_bricks(&cast, &r, brick_codes, &m);
        if (!ANY(m.live)) break;
        read_ends(&cast, voxels, opacity, &r, &m, 1, &e);
        const intN rising = MASK(e.back > e.front);
        intN here = in_part(&r, 0.5f * (e.begin + e.end));
#if MISSING
        // Missing voxels end a surface and make none.
        here &= e.has_front & e.has_back;
#endif
        for (int s = 0; s < SURFACES; ++s) {
            // Levels in the order in which the ray meets them.
            const float2 up = opacity[s], down = opacity[SURFACES - 1 - s];
            const floatN level = SELECT(rising, (floatN)(up.x), (floatN)(down.x));
            const intN met = m.live & here & (MASK(e.front < level) ^ MASK(e.back < level));
            if (!ANY(met)) continue;
            const floatN alpha = SELECT(rising, (floatN)(up.y), (floatN)(down.y));
            const floatN visible = SELECT(met, g.transmittance * alpha, (floatN)(0.0f));
            floatN along = find_crossing(&cast, voxels, opacity, &r, &e, level);
            along = SELECT(met, along, e.begin);
            floatL shading[GROUPS];
            add_shaded(&cast, voxels, opacity, sources, light_volume, &r, along, visible, &g,
                       shading);
            m.live &= MASK(g.transmittance > cast.min_transmittance);
            intL surface;
            surface.v = SELECT(rising, (intN)(s), (intN)(SURFACES - 1 - s));
            UNROLL(l, LANES) {
                floatV row[VECTORS];
                UNROLL(v, VECTORS) row[v] = material_weights[surface.s[l] * VECTORS + v];
                accumulate(&g, l, shading, row);
            }
        }
        m.k += 1;
        m.live &= MASK(m.k < m.k_end);
    }
    write_picture(&cast, &g, &r, pixel, first_tile * TILE_HEIGHT, channels, coefficients_out,
                  alpha_out, depth_out, first_out);
}
