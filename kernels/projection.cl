// Cast rays through a scalar volume and show the greatest or the mean value along each.
//
//     C = opacity(v) · Σ light · s(v),  v = max or mean of the values at the steps' middles
//
// Nothing is shaded: every source counts as faced. NumPy twin: volspec/raycast/reference.py
// (_Projection).
//
// Launch and what is read and written: as raycast.cl, but
//         codes    VOXEL per brick: the greatest value in it, which the maximum leaps by
//         opacity  of the reference step, not of a step, and no logs
// The host sets MAXIMUM (1, or 0 for the mean) beside what raycast.cl wants.

#include "casts.clh"
#include "classify.clh"

CASTS(projection, VOXEL) {
    TILE_OF_PIXELS(cast)
    const Rays r = rays_of(&cast, pixel_x, pixel_y);
    intN k = first_step(&cast, &r), due = k;
    const intN k_end = end_step(&cast, &r, k), meets = MASK(k < k_end);
    intN live = meets;
    floatN sum = 0.0f, length = 0.0f, best = -FAR, place = 0.0f;
    while (ANY(live)) {
#if MAXIMUM
        for (intN ask = live & MASK(k >= due); ANY(ask); ask = live & MASK(k >= due)) {
            const Bricks bricks = bricks_at(&cast, &r, middle_of(&cast, &r, k));
            intL number;
            floatL most;
            number.v = bricks.number;
            FOR_LANES(l) most.s[l] = codes[(uint)number.s[l]];
            const floatN leave = leave_bricks(&r, &bricks, (intN)(0));
            const intN next = k + steps_beyond(&cast, k, leave);
            const intN lower = MASK(most.v <= best);
            due = PICK(ask & ~lower, next, due);
            k = PICK(ask & lower, next, k);
            live &= MASK(k < k_end);
        }
        if (!ANY(live)) break;
#endif
        const floatN begin = UPPER(CONVERT_FLOAT(k) * cast.step, r.near);
        const floatN end = LOWER(CONVERT_FLOAT(k + 1) * cast.step, r.far);
        const floatN middle = 0.5f * (begin + end);
        const Field f = field_at(&cast, voxels, opacity, &r, middle);
#if MAXIMUM
        const intN more = live & MASK(f.value > best);
        best = PICK(more, f.value, best);
        place = PICK(more, middle, place);
#else
        const floatN part = PICK(live, end - begin, (floatN)(0.0f));
        sum += part * f.value;
        length += part;
#endif
        k += 1;
        live &= MASK(k < k_end);
    }
#if !MAXIMUM
    best = sum / UPPER(length, 1e-30f);
    place = 0.5f * (r.near + r.far);
#endif
    Gathered g;
    begin(&g);
    Field shown;
    shown.value = PICK(meets, best, (floatN)(0.0f));
    const Entry entry = entry_at(&cast, opacity, &shown);
    const floatN visible = PICK(meets, entry.opacity, (floatN)(0.0f));
    const floatN unshaded = 0.0f;
    floatN weight[GROUPS], gloss[GROUPS];
    shade(&cast, sources, layers, &r, place, unshaded, unshaded, unshaded, visible, weight, gloss);
    reflect(&g, shares, &cast, &shown, &entry, weight);
    cover(&cast, &g, visible, place);
    WRITE_PICTURE(cast, g, r);
}
