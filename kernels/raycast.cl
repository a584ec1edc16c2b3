// Cast rays through a scalar volume and gather what they meet, front to back.
//
//     α = 1 − (1 − opacity(v))^(length / step),  C += T α (g s(v) + k_s),  T ← T (1 − α)
//     g, k_s: what the light groups shed (include/shade.clh), a layer of C each      (METHOD §3)
//
// With FILTERED every channel has its own transmittance t_k of a step, and α_k = 1 − t_k.
//
// NumPy twin: volspec/raycast/reference.py (cast). Same steps, same clipping, same order.
//
// Launch: 2-D, one work-item per tile of TILE_WIDTH × TILE_HEIGHT pixels (a packet of LANES
// rays), in bands: first_tile is the first row of tiles. (PoCL would build a second program for
// a launch with an offset.)
//
// Reads   voxels   VOXEL[nz][ny][nx] (include/voxels.clh)
//         codes    uchar per brick of BRICK³ cells: what may be seen (include/rays.clh)
//         opacity  float2[2][rows][last_entry + 2]: opacity of one whole step, difference to the
//                  next entry; then the log of what one lets through (finite, also where that
//                  is nothing), that of the next entry; rows by gradient where TABLE_ROWS > 1
//         shares   floatP[rows][last_entry + 2][2][PARTS], what is reflected, and its difference
//         channels float[SHARES + 1][CHANNELS], what shares mix, and white
//         filters  floatP[last_entry + 2][2][PARTS], with FILTERED: transmittance of one whole
//                  step, channel by channel, and its difference; the last is white
//         sources, layers   light (include/shade.clh, include/light.clh)
// Writes  coefficients float[height][width][GROUPS][CHANNELS] premultiplied; alpha, depth and
//         first float[height][width] (expected and first depth in smallest spacings, inf where
//         nothing is), from the band's first row on
//
// The host sets LANES, TILE_WIDTH, TILE_HEIGHT, TABLE_ROWS, STEPS (how many are sampled at once, so
// that one's loads overlap another's sums), and what the includes want.

#include "casts.clh"
#include "classify.clh"

CASTS(raycast, uchar) {
    TILE_OF_PIXELS(cast)
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
        // Steps, clipped, and sampled at their middles: STEPS at once and stage by stage, so that
        // one's loads overlap another's.
        floatN middle[STEPS], share[STEPS], whole[STEPS], taken[STEPS];
        floatN nx[STEPS], ny[STEPS], nz[STEPS];
        intN marched[STEPS];
        Field f[STEPS];
        Entry entry[STEPS];
        blank = 1;
        EACH(s, STEPS) {
            intN steps = 1;
#if ADAPTIVE
            // Long steps end where their brick does.
            steps = PICK(MASK(k + stride <= due), stride, 1);
#endif
            taken[s] = CONVERT_FLOAT(steps);
            const floatN begin = UPPER(CONVERT_FLOAT(k) * cast.step, r.near);
            const floatN end = LOWER(CONVERT_FLOAT(k + steps) * cast.step, r.far);
            middle[s] = 0.5f * (begin + end);
            whole[s] = (end - begin) * per_step;
            f[s] = field_at(&cast, voxels, opacity, &r, middle[s]);
            live &= MASK(k < k_end);
            marched[s] = live;
            k += steps;
        }
        EACH(s, STEPS) {
#if TABLE_ROWS > 1
            gradient_at(&cast, voxels, opacity, &f[s], &nx[s], &ny[s], &nz[s]);
            entry[s] = entry_at(&cast, opacity, &f[s], nx[s], ny[s], nz[s]);
#else
            entry[s] = entry_at(&cast, opacity, &f[s]);
#endif
            share[s] = entry[s].opacity;
#if ADAPTIVE
            // Not by way of 1 − share, where faint media have no digits left.
            const floatN two = share[s] * (2.0f - share[s]), four = two * (2.0f - two);
            share[s] = PICK(MASK(taken[s] == 2.0f), two, share[s]);
            share[s] = PICK(MASK(taken[s] == 4.0f), four, share[s]);
#endif
            share[s] = PICK(marched[s], share[s], (floatN)(0.0f));
            blank &= !ANY(MASK(share[s] > 0.0f));
        }
#if TABLE_ROWS == 1
        EACH(s, STEPS) {
            nx[s] = ny[s] = nz[s] = 0.0f;
#if NORMALS
            // In one block they overlap; for rows of two-byte voxels it would want more registers
            // than there are.
            if (FOUR_SHORTS ? ANY(MASK(share[s] > 0.0f)) : !blank)
                gradient_at(&cast, voxels, opacity, &f[s], &nx[s], &ny[s], &nz[s]);
#endif
        }
#endif
        EACH(s, STEPS) {
            share[s] = PICK(MASK(g.through > cast.opaque), share[s], (floatN)(0.0f));
            const intN seen = MASK(share[s] > 0.0f);
            if (!ANY(seen)) continue;
            // The first and the last step of a ray are clipped.
            const intN clipped = seen & MASK(whole[s] < taken[s] - 1e-5f);
            if (ANY(clipped)) {
                const floatN through = log_through(&cast, opacity, &f[s], &entry[s]);
                const floatN along = opacity_along(entry[s].opacity, through, whole[s]);
                share[s] = PICK(clipped, along, share[s]);
            }
            floatN weight[GROUPS], gloss[GROUPS];
#if FILTERED
            // Each channel is weighted by its own loss, in gather_filtered.
            const floatN once = PICK(seen, (floatN)(1.0f), (floatN)(0.0f));
            floatL length;
            length.v = PICK(seen, whole[s], (floatN)(0.0f));
            shade(&cast, sources, layers, &r, middle[s], nx[s], ny[s], nz[s], once, weight, gloss);
            reflect_filtered(&g, shares, filters, &cast, &entry[s], weight, gloss, length);
            cover(&cast, &g, g.through - passing(&g), middle[s]);
#else
            const floatN visible = g.through * share[s];
            shade(&cast, sources, layers, &r, middle[s], nx[s], ny[s], nz[s], visible, weight,
                  gloss);
            reflect(&g, shares, &cast, &f[s], &entry[s], weight);
            EACH(group, GROUPS) g.gloss[group] += gloss[group];
            cover(&cast, &g, visible, middle[s]);
#endif
        }
        live &= MASK(k < k_end) & MASK(g.through > cast.opaque);
    }
    WRITE_PICTURE(cast, g, r);
}
