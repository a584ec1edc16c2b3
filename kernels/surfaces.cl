// Cast rays through a scalar volume and meet its isosurfaces, front to back.
//
//     C += T a (g s + k_s),  T ← T (1 − a)      where the value passes a level of opacity a
//
// A level lies in a step when the values at the step's two ends lie on either side of it (below,
// or at and above); its place follows from ROUNDS rounds of the rule of false position. NumPy twin:
// volspec/raycast/reference.py (_Surfaces).
//
// Launch and what is read and written: as raycast.cl, but
//         opacity  float2[SURFACES]: a surface's level and opacity, by rising level
//         shares   floatP[SURFACES][PARTS]
// The host sets SURFACES and ROUNDS beside what raycast.cl wants; TABLE_ROWS and LABELS have no
// meaning.

#include "casts.clh"
#include "ends.clh"

// Where between the step's ends the value is `level`.
static inline floatN place_of(const Cast *cast, __global const VOXEL *voxels,
                              __global const float2 *opacity, const Rays *r, const Ends *e,
                              floatN level) {
    floatN near = e->begin, far = e->end, front = e->front, back = e->back;
    floatN along = near + (level - front) / (back - front) * (far - near);
    for (int round = 0; round < ROUNDS; ++round) {
        const Field f = field_at(cast, voxels, opacity, r, along);
        const intN before = MASK(f.value < level) == MASK(front < level);
        near = PICK(before, along, near);
        front = PICK(before, f.value, front);
        far = PICK(before, far, along);
        back = PICK(before, back, f.value);
        const floatN rise = back - front;
        along = PICK(MASK(rise == 0.0f), near, near + (level - front) / rise * (far - near));
    }
    return along;
}

CASTS(surfaces, uchar) {
    TILE_OF_PIXELS(cast)
    const Rays r = rays_of(&cast, pixel_x, pixel_y);
    intN k = first_step(&cast, &r), due = k, stride = 1;
    const intN k_end = end_step(&cast, &r, k);
    Gathered g;
    begin(&g);
    Ends e;
    e.next = k - 1;
    e.back = 0.0f;

    intN live = MASK(k < k_end);
    while (ANY(live)) {
        leap(&cast, &r, codes, k_end, &k, &due, &stride, &live);
        if (!ANY(live)) break;
        read_ends(&cast, voxels, opacity, &r, k, 1, live, &e);
        const intN rising = MASK(e.back > e.front);
        for (int s = 0; s < SURFACES; ++s) {
            // Levels in the order the ray meets them.
            const float2 up = opacity[s], down = opacity[SURFACES - 1 - s];
            const floatN level = PICK(rising, (floatN)(up.x), (floatN)(down.x));
            const intN met = live & (MASK(e.front < level) ^ MASK(e.back < level));
            if (!ANY(met)) continue;
            const floatN own = PICK(rising, (floatN)(up.y), (floatN)(down.y));
            const floatN visible = PICK(met, g.through * own, (floatN)(0.0f));
            floatN along = place_of(&cast, voxels, opacity, &r, &e, level);
            along = PICK(met, along, e.begin);
            floatN nx = 0.0f, ny = 0.0f, nz = 0.0f;
#if NORMALS
            const Field f = field_at(&cast, voxels, opacity, &r, along);
            gradient_at(&cast, voxels, opacity, &f, &nx, &ny, &nz);
#endif
            floatN weight[GROUPS], gloss[GROUPS];
            shade(&cast, sources, layers, &r, along, nx, ny, nz, visible, weight, gloss);
            cover(&cast, &g, visible, along);
            live &= MASK(g.through > cast.opaque);
            intL which;
            floatL weights[GROUPS];
            which.v = PICK(rising, (intN)(s), (intN)(SURFACES - 1 - s));
            EACH(group, GROUPS) {
                weights[group].v = weight[group];
                g.gloss[group] += gloss[group];
            }
            FOR_LANES(l) {
                floatP row[PARTS];
                EACH(p, PARTS) row[p] = shares[which.s[l] * PARTS + p];
                gather(&g, l, weights, row);
            }
        }
        k += 1;
        live &= MASK(k < k_end);
    }
    WRITE_PICTURE(cast, g, r);
}
