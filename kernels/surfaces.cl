// Cast rays through a scalar volume and composite its isosurfaces, front to back.
//
//     C += T a (g s + k_s),  T ← T (1 − a)      at each crossing of a level of opacity a
//
// Within a cell the trilinear field along a ray is a cubic. It is cut at its extrema into monotone
// pieces, and a piece crosses a level if the values at its two ends are on different sides (below,
// or at and above): no surface is missed, whatever the step. NumPy twin:
// volspec/raycast/reference.py (_Surfaces).
//
// Launch and arguments: as raycast.cl, but
//         opacity           float2[SURFACES]: level and opacity of a surface, by increasing level
//         material_weights  floatV[SURFACES][VECTORS]
// The host sets SURFACES and ITERATIONS (of the rule of false position, in a piece) in addition to
// the constants of raycast.cl; TABLE_ROWS and LABELS are not used.

#include "lanes.clh"
#include "rays.clh"
#include "field.clh"
#include "shade.clh"
#include "picture.clh"
#include "step_ends.clh"

// Value along a ray within a cell: v + u (a + u (b + u c)), u from 0 to 1.
typedef struct { floatN v, a, b, c; } Cubic;

static inline floatN cubic_at(const Cubic *f, floatN u) {
    return f->v + u * (f->a + u * (f->b + u * f->c));
}

// The value at a distance from a sample, in its cell.
static inline floatN value_in_cell(const Sample *f, const Rays *r, floatN away) {
    const floatN fx = f->cell.fx + away * r->dx, fy = f->cell.fy + away * r->dy;
    floatN row[4];
    UNROLL(i, 4) row[i] = lerp(f->b[i], f->c[i], fx);
    return lerp(lerp(row[0], row[1], fy), lerp(row[2], row[3], fy), f->cell.fz + away * r->dz);
}

// The cubic through values at u = 0, 1/3, 2/3 and 1; exact if they are equal.
static inline Cubic cubic_through(floatN v0, floatN v1, floatN v2, floatN v3) {
    const floatN p = v1 - v0, q = v2 - v0, r = v3 - v0;
    Cubic f;
    f.v = v0;
    f.a = 9.0f * p - 4.5f * q + r;
    f.b = -22.5f * p + 18.0f * q - 4.5f * r;
    f.c = 13.5f * p - 13.5f * q + 4.5f * r;
    return f;
}

// The extrema between 0 and 1, in order; 0 in place of one that is not there.
static inline void extrema(const Cubic *f, floatN *first, floatN *second) {
    const floatN square = f->b * f->b - 3.0f * f->a * f->c;
    const floatN root = square * inverse_root(MAX(square, 1e-37f));
    const floatN q = -f->b - SELECT(MASK(f->b < 0.0f), -root, root);
    const floatN one = q / (3.0f * f->c), other = f->a / q;
    const intN real = MASK(square > 0.0f);
    const floatN u = SELECT(real & MASK(one > 0.0f) & MASK(one < 1.0f), one, (floatN)(0.0f));
    const floatN w = SELECT(real & MASK(other > 0.0f) & MASK(other < 1.0f), other, (floatN)(0.0f));
    *first = MIN(u, w);
    *second = MAX(u, w);
}

// The place between u and w at which a cubic, monotone there, is `level`; `back` is its value at w.
// At u it is `front` but for rounding, as cells' values differ on their face: it may have passed.
static inline floatN find_crossing(const Cubic *f, floatN u, floatN front, floatN w, floatN back,
                                   floatN level) {
    const intN below = MASK(front < level);
    floatN low = cubic_at(f, u) - level, high = back - level, at = u;
    w = SELECT(MASK(low < 0.0f) == below, w, u);
    intN advanced = 0, lowered = 0;  // which end moved last
    for (int i = 0; i < ITERATIONS; ++i) {
        const floatN rise = high - low;
        at = SELECT(MASK(rise == 0.0f), u, u - low / rise * (w - u));
        const floatN value = cubic_at(f, at) - level;
        const intN before = MASK(value < 0.0f) == below;
        // The value at an end that stays twice counts half (Illinois): else the other would creep.
        low = SELECT(before, value, SELECT(lowered, 0.5f * low, low));
        high = SELECT(before, SELECT(advanced, 0.5f * high, high), value);
        u = SELECT(before, at, u);
        w = SELECT(before, w, at);
        advanced = before;
        lowered = ~before;
    }
    return at;
}

// Distance from step 0 at which a ray leaves its cell along one axis, beyond `along`.
static inline floatN next_face(floatN o, floatN d, floatN inverse, floatN along) {
    const intN ahead = SELECT(MASK(d > 0.0f), (intN)(1), (intN)(0));
    const floatN face = (CONVERT_FLOAT(CONVERT_INT(o + along * d) + ahead) - o) * inverse;
    const floatN cell = SELECT(MASK(d > 0.0f), inverse, -inverse);
    const floatN beyond = SELECT(MASK(face > along), face, face + cell);
    return SELECT(MASK(d == 0.0f), INFINITE, beyond);
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
    floatN at = r.near, value = 0.0f;  // where rays are, and the value there
    intN known = 0;

    while (ANY(m.live)) {
        skip_empty_bricks(&cast, &r, brick_codes, &m);
        if (!ANY(m.live)) break;
        const floatN begin = MAX(CONVERT_FLOAT(m.k) * cast.step, r.near);
        const floatN end = MIN(CONVERT_FLOAT(m.k + 1) * cast.step, r.far);
        known &= MASK(begin <= at);
        at = MAX(at, begin);
        const floatN x = next_face(r.ox, r.dx, r.inverse_x, at);
        const floatN y = next_face(r.oy, r.dy, r.inverse_y, at);
        const floatN z = next_face(r.oz, r.dz, r.inverse_z, at);
        const floatN leave = MIN(MIN(x, y), MIN(z, end)), reach = 0.5f * (leave - at);
        const Sample f = sample_at(&cast, voxels, opacity, &r, at + reach);
        // All values in the cell lie between its voxels'.
        floatN least = SELECT(known, value, f.value), greatest = least;
        UNROLL(row, 4) {
            least = MIN(least, MIN(f.b[row], f.c[row]));
            greatest = MAX(greatest, MAX(f.b[row], f.c[row]));
        }
        intN near = 0;
        for (int s = 0; s < SURFACES; ++s)
            near |= MASK(least < opacity[s].x) & MASK(greatest >= opacity[s].x);
        intN whole = (intN)(-1);
#if MISSING
        // Missing voxels end a surface and make none.
        whole = f.present;
        near &= whole;
#endif
        if (ANY(near & m.live)) {
            const intN here = in_part(&r, 0.5f * (begin + end));
            const floatN v0 = value_in_cell(&f, &r, -reach);
            const floatN v1 = value_in_cell(&f, &r, reach * -0.33333333f);
            const floatN v2 = value_in_cell(&f, &r, reach * 0.33333333f);
            const floatN v3 = value_in_cell(&f, &r, reach);
            const Cubic cubic = cubic_through(v0, v1, v2, v3);
            floatN first, second, from = 0.0f, front = SELECT(known, value, v0);
            extrema(&cubic, &first, &second);
            value = v3;
            for (int piece = 0; piece < 3; ++piece) {
                const floatN to = piece == 0 ? first : piece == 1 ? second : (floatN)(1.0f);
                const floatN there = piece == 2 ? v3 : cubic_at(&cubic, to);
                const floatN back = SELECT(MASK(to > from), there, front);
                const intN rising = MASK(back > front);
                for (int s = 0; s < SURFACES; ++s) {
                    // Levels in the order in which the ray meets them.
                    const float2 up = opacity[s], down = opacity[SURFACES - 1 - s];
                    const floatN level = SELECT(rising, (floatN)(up.x), (floatN)(down.x));
                    const intN crossed = MASK(front < level) ^ MASK(back < level);
                    const intN met = near & here & m.live & crossed;
                    if (!ANY(met)) continue;
                    const floatN alpha = SELECT(rising, (floatN)(up.y), (floatN)(down.y));
                    const floatN visible = SELECT(met, g.transmittance * alpha, (floatN)(0.0f));
                    const floatN u = find_crossing(&cubic, from, front, to, back, level);
                    const floatN along = at + SELECT(met, u, (floatN)(0.5f)) * (leave - at);
                    floatL shading[GROUPS];
                    add_shaded(&cast, voxels, opacity, sources, light_volume, &r, along,
                               cast.light_lift, visible, &g, shading);
                    m.live &= MASK(g.transmittance > cast.min_transmittance);
                    intL surface;
                    surface.v = SELECT(rising, (intN)(s), (intN)(SURFACES - 1 - s));
                    UNROLL(l, LANES) {
                        floatV row[VECTORS];
                        UNROLL(v, VECTORS)
                            row[v] = material_weights[surface.s[l] * VECTORS + v];
                        accumulate(&g, l, shading, row);
                    }
                }
                from = to;
                front = back;
            }
        } else
            value = f.value;
        known = whole;
        at = leave;
        m.k += SELECT(MASK(leave >= end), (intN)(1), (intN)(0));
        m.live &= MASK(m.k < m.k_end);
    }
    write_picture(&cast, &g, &r, pixel, first_tile * TILE_HEIGHT, channels, coefficients_out,
                  alpha_out, depth_out, first_out);
}
