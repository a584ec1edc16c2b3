// Cast rays through several scalar fields that share one place, and composite front to back.
//
//     α_f = 1 − (1 − opacity_f(v_f))^(length / step),   τ_f = −log(1 − α_f)
//     α = 1 − Π (1 − α_f),  C += T α Σ_f (τ_f / Σ τ) (g_f s_f(v_f) + k_s,f),  T ← T (1 − α)
//
// Extinctions add, and materials mix by extinction, each shaded by its own field's gradient. Fields
// have lattices of their own; the steps are those of `frame`, a lattice around all of them, in whose
// index space lights are placed. A field is not sampled where its bricks are empty.
//
// A field with a mask has a curve by row of the mask: τ_f = Σ w_r τ_r(v_f), where w_r is the weight
// of the mask's corners with row r (mask.clh). In cells of one row α_f is that row's, without a log.
//
// NumPy twin: volspec/raycast/reference.py (_Fields). Same steps, same clipping, same order.
//
// Launch: as raycast.cl.
//
// Reads   voxels_f     VOXEL[nz][ny][nx] of each field, all of one type
//         brick_codes, opacity, material_weights: as raycast.cl, of one field after the other
//         channels, sources, light_volume, spans: as raycast.cl
//         casts        Cast[FIELDS + 1]: of each field, and of `frame`
//         places       int4[FIELDS]: first element of a field in brick_codes, opacity and
//                      material_weights (in vectors); 1 if the frame's crop cuts it, too
//         and with MASKED
//         curves       Curve[]: of each field, row by row of its mask
//         masks        Mask[FIELDS]
//         codes        ushort[nz][ny][nx] of each mask
// Writes  as raycast.cl
//
// The host sets FIELDS (up to 8), ALIGNED (all fields have the frame's lattice and planes), MASKED
// (a field has a mask), MIX_OPAQUE, and the constants of raycast.cl.

#include "lanes.clh"
#include "rays.clh"
#include "field.clh"
#include "classify.clh"
#include "shade.clh"
#include "picture.clh"
#if MASKED
#include "mask.clh"
#endif

#define NO_STEP 0x3fffffff

// −log(1 − opacity); of nearly opaque samples the log of MIX_OPAQUE, as 1 − opacity has no digits.
static inline floatN extinction_of(floatN opacity) {
    const floatN pass = 1.0f - opacity;
    // The ratio restores what 1 − opacity has lost of faint ones.
    const floatN ratio = opacity / MAX(1.0f - pass, 1e-30f);
    return SELECT(MASK(pass == 1.0f), opacity, minus_log(MAX(pass, MIX_OPAQUE)) * ratio);
}

#if LIT && !ALIGNED
// The frame's rays, with a field's own cut where it is behind theirs.
static inline Rays later_cut(const Rays *own, Rays r) {
    const intN later = MASK(own->cut > r.cut);
    r.cut = SELECT(later, own->cut, r.cut);
    r.cut_nx = SELECT(later, own->cut_nx, r.cut_nx);
    r.cut_ny = SELECT(later, own->cut_ny, r.cut_ny);
    r.cut_nz = SELECT(later, own->cut_nz, r.cut_nz);
    return r;
}
#endif

#if MASKED
// Give a field's settings the table of a row; samples and gradients do not depend on it.
static inline void take_table(Cast *cast, const Curve *curve) {
    cast->domain_rest = curve->domain_rest;
    cast->domain_scale = curve->domain_scale;
    cast->last_entry = curve->last_entry;
    cast->power = curve->power;
}

// Opacity of a step by the rows of a mask, and the extinction of samples of several rows, else 0.
// The rows' weights become the fractions of the step that are of their materials.
static inline floatN opacity_of_rows(Cast *cast, __global const Curve *curves,
                                     __global const float2 *opacity, const Sample *sample,
                                     RowList *rows, floatN *extinction) {
    const floatN zero = 0.0f, one = 1.0f;
    floatN alone = zero, total = zero;
    for (int r = 0; r < rows->count; ++r) {
        const Curve curve = curves[rows->row[r]];
        take_table(cast, &curve);
        const Entry entry = classify(cast, opacity + curve.opacity, sample);
        const floatN weight = rows->weight[r];
        const intN whole = MASK(weight == 1.0f), some = ~whole & MASK(weight > 0.0f);
        alone = SELECT(whole, entry.opacity, alone);
        if (!ANY(some)) continue;
        const floatN part = weight * extinction_of(entry.opacity);
        rows->weight[r] = SELECT(some, part, weight);
        total += SELECT(some, part, zero);
    }
    *extinction = total;
    const intN mixed = MASK(total > 0.0f);
    if (!ANY(mixed)) return alone;
    const floatN per_total = SELECT(mixed, 1.0f / total, one);
    for (int r = 0; r < rows->count; ++r) rows->weight[r] *= per_total;
    return SELECT(mixed, 0.0f - expm1(0.0f - total), alone);
}

static inline floatN log_transmittance_of_rows(Cast *cast, __global const Curve *curves,
                                               __global const float2 *opacity,
                                               const Sample *sample, const RowList *rows,
                                               floatN extinction) {
    floatN log_step = 0.0f;
    for (int r = 0; r < rows->count; ++r) {
        const Curve curve = curves[rows->row[r]];
        take_table(cast, &curve);
        const Entry entry = classify(cast, opacity + curve.opacity, sample);
        const floatN own = log_transmittance(cast, opacity + curve.opacity, sample, &entry);
        log_step = SELECT(MASK(rows->weight[r] > 0.0f), own, log_step);
    }
    return SELECT(MASK(extinction > 0.0f), 0.0f - extinction, log_step);
}

static inline void reflect_rows(Accumulator *g, __global const floatV *material_weights, Cast *cast,
                                __global const Curve *curves, __global const float2 *opacity,
                                const Sample *sample, const RowList *rows,
                                const floatN shading[GROUPS]) {
    for (int r = 0; r < rows->count; ++r) {
        if (!ANY(MASK(rows->weight[r] > 0.0f))) continue;
        const Curve curve = curves[rows->row[r]];
        take_table(cast, &curve);
        const Entry entry = classify(cast, opacity + curve.opacity, sample);
        floatN of_row[GROUPS];
        UNROLL(group, GROUPS) of_row[group] = rows->weight[r] * shading[group];
        reflect(g, material_weights + curve.material_weights, cast, sample, &entry, of_row);
    }
}
#endif

__kernel void fields(__global const VOXEL *restrict voxels_0, __global const VOXEL *restrict voxels_1,
                     __global const VOXEL *restrict voxels_2, __global const VOXEL *restrict voxels_3,
                     __global const VOXEL *restrict voxels_4, __global const VOXEL *restrict voxels_5,
                     __global const VOXEL *restrict voxels_6, __global const VOXEL *restrict voxels_7,
                     __global const uchar *restrict brick_codes,
                     __global const float2 *restrict opacity,
                     __global const floatV *restrict material_weights,
                     __global const float *restrict channels,
                     __global const float4 *restrict sources,
                     __global const ushort *restrict light_volume,
                     __global const float2 *restrict spans, __global const Cast *restrict casts_in,
                     __global const int4 *restrict places,
#if MASKED
                     __global const Curve *restrict curves, __global const Mask *restrict masks_in,
                     __global const ushort *restrict codes,
#endif
                     __global float *restrict coefficients_out,
                     __global float *restrict alpha_out, __global float *restrict depth_out,
                     __global float *restrict first_out, const int first_tile) {
    __global const VOXEL *const voxels[8] = {voxels_0, voxels_1, voxels_2, voxels_3,
                                             voxels_4, voxels_5, voxels_6, voxels_7};
    Cast casts[FIELDS + 1];
    for (int f = 0; f <= FIELDS; ++f) casts[f] = casts_in[f];
    const Cast *frame = &casts[FIELDS];
#if MASKED
    Mask masks[FIELDS];
    for (int f = 0; f < FIELDS; ++f) masks[f] = masks_in[f];
#endif
    const int2 pixel = tile_pixel(first_tile);
    if (pixel.x >= frame->width || pixel.y >= frame->height) return;
    const float step = frame->step, per_step = 1.0f / step;

    const Rays r = make_rays(frame, spans, pixel);
#if ALIGNED
#define RAYS(f) r
#else
    Rays rays[FIELDS];
#define RAYS(f) rays[f]
#endif
    March march[FIELDS];
    int transparent[FIELDS];
    for (int f = 0; f < FIELDS; ++f) {
#if !ALIGNED
        rays[f] = make_rays(&casts[f], spans, pixel);
        if (places[f].w) {
            rays[f].near = MAX(rays[f].near, r.near);
            rays[f].far = MIN(rays[f].far, r.far);
        }
#endif
        march[f] = start_march(&casts[f], &RAYS(f));
        transparent[f] = 1;
    }
    Accumulator g;
    clear(&g, 1.0f);

    for (;;) {
        // Every lane goes on with its first step at which some field is not empty.
        intN k = NO_STEP, live = 0;
        for (int f = 0; f < FIELDS; ++f) {
            if (transparent[f])
                skip_empty_bricks(&casts[f], &RAYS(f), brick_codes + places[f].x, &march[f]);
            live |= march[f].live;
            k = SELECT(march[f].live & MASK(march[f].k < k), march[f].k, k);
        }
        if (!ANY(live)) break;

        floatN middle[FIELDS][STEPS], alpha[FIELDS][STEPS], passes[STEPS];  // whole steps, all
        UNROLL(s, STEPS) passes[s] = 1.0f;
        floatN nx[FIELDS][STEPS], ny[FIELDS][STEPS], nz[FIELDS][STEPS];
#if MASKED
        RowList rows[FIELDS][STEPS];
        floatN value[FIELDS][STEPS], extinction[FIELDS][STEPS];
#endif
        Entry entry[FIELDS][STEPS];
        int seen[FIELDS], seen_count = 0;
        for (int f = 0; f < FIELDS; ++f) {
            March *m = &march[f];
            seen[f] = 0;
            if (!ANY(m->live & MASK(m->k < k + STEPS))) continue;
            Cast *cast = &casts[f];
            __global const float2 *table = opacity + places[f].y;
            Sample sample[STEPS];
            floatN fraction[STEPS];
            UNROLL(s, STEPS) {
                const floatN begin = MAX(CONVERT_FLOAT(k + s) * step, RAYS(f).near);
                const floatN end = MIN(CONVERT_FLOAT(k + s + 1) * step, RAYS(f).far);
                middle[f][s] = 0.5f * (begin + end);
                fraction[s] = (end - begin) * per_step;
                sample[s] = sample_at(cast, voxels[f], table, &RAYS(f), middle[f][s]);
            }
            UNROLL(s, STEPS) {
                const intN due = m->live & MASK(k + s >= m->k) & MASK(k + s < m->k_end);
#if MASKED
                rows_at(&masks[f], codes,
                        position_at(RAYS(f).ox, RAYS(f).dx, middle[f][s], 0.0f, cast->last.x),
                        position_at(RAYS(f).oy, RAYS(f).dy, middle[f][s], 0.0f, cast->last.y),
                        position_at(RAYS(f).oz, RAYS(f).dz, middle[f][s], 0.0f, cast->last.z), due,
                        &rows[f][s]);
                const Curve curve = curves[masks[f].curves + rows[f][s].row[0]];
                floatN opaque;
                extinction[f][s] = 0.0f;
                if (rows[f][s].count == 1) {
                    take_table(cast, &curve);
                    entry[f][s] = classify(cast, opacity + curve.opacity, &sample[s]);
                    opaque = entry[f][s].opacity;
                } else {
                    opaque = opacity_of_rows(cast, curves + masks[f].curves, opacity, &sample[s],
                                             &rows[f][s], &extinction[f][s]);
                }
                value[f][s] = sample[s].value;
#else
                entry[f][s] = classify(cast, table, &sample[s]);
                const floatN opaque = entry[f][s].opacity;
#endif
                alpha[f][s] = SELECT(due, opaque, (floatN)(0.0f));
                passes[s] *= 1.0f - alpha[f][s];
                seen[f] |= ANY(MASK(alpha[f][s] > 0.0f));
            }
            transparent[f] = !seen[f];
            m->k = MAX(m->k, k + STEPS);
            m->live &= MASK(m->k < m->k_end);
            if (!seen[f]) continue;
            ++seen_count;
            UNROLL(s, STEPS) {
                nx[f][s] = ny[f][s] = nz[f][s] = 0.0f;
#if NORMALS
                if (ANY(MASK(alpha[f][s] > 0.0f)))
                    gradient_at(cast, voxels[f], table, &sample[s], &nx[f][s], &ny[f][s], &nz[f][s]);
#endif
            }
            UNROLL(s, STEPS) {
                const intN clipped = MASK(alpha[f][s] > 0.0f) & MASK(fraction[s] < 1.0f - 1e-5f);
                if (ANY(clipped)) {
#if MASKED
                    const floatN log_step = log_transmittance_of_rows(
                        cast, curves + masks[f].curves, opacity, &sample[s], &rows[f][s],
                        extinction[f][s]);
#else
                    const floatN log_step =
                        log_transmittance(cast, table, &sample[s], &entry[f][s]);
#endif
                    const floatN shorter = opacity_along(alpha[f][s], log_step, fraction[s]);
                    alpha[f][s] = SELECT(clipped, shorter, alpha[f][s]);
                }
            }
        }
        if (seen_count == 0) continue;

        UNROLL(s, STEPS) {
            floatN total = 0.0f;
            intN mixed = 0;
            for (int f = 0; f < FIELDS; ++f) {
                if (!seen[f]) continue;
                mixed |= MASK(total > 0.0f) & MASK(alpha[f][s] > 0.0f);
                total = alpha[f][s] + total * (1.0f - alpha[f][s]);
            }
            const intN reached = MASK(g.transmittance > frame->min_transmittance);
            const floatN visible = SELECT(reached, g.transmittance * total, (floatN)(0.0f));
            if (!ANY(MASK(visible > 0.0f))) continue;
            // Extinctions count only where there are several; a field alone is all of itself.
            floatN parts[FIELDS], sum = 0.0f;
            const int any_mixed = ANY(mixed);
            for (int f = 0; f < FIELDS; ++f) {
                if (!seen[f]) continue;
                parts[f] = any_mixed ? extinction_of(alpha[f][s]) : alpha[f][s];
                sum += parts[f];
            }
            const floatN per_part = visible / MAX(sum, 1e-30f);
            const floatN away = lift_at(frame, minus_log(MAX(passes[s], 1e-30f)));
            floatN along = 0.0f;
            for (int f = 0; f < FIELDS; ++f) {
                if (!seen[f] || !ANY(MASK(alpha[f][s] > 0.0f))) continue;
                const floatN part = SELECT(MASK(parts[f] == sum), visible, per_part * parts[f]);
                floatN shading[GROUPS], highlight[GROUPS];
#if LIT && !ALIGNED
                const Rays own = later_cut(&rays[f], r), *from = &own;
#else
                const Rays *from = &r;
#endif
                shade(frame, sources, light_volume, from, middle[f][s], nx[f][s], ny[f][s],
                      nz[f][s], away, part, shading, highlight);
#if MASKED
                if (rows[f][s].count == 1) {
                    const Curve curve = curves[masks[f].curves + rows[f][s].row[0]];
                    reflect(&g, material_weights + curve.material_weights, &casts[f], 0,
                            &entry[f][s], shading);
                } else {
                    Sample sample;  // of which curves take the value alone
#if MISSING
                    sample.present = -1;
#endif
                    sample.value = value[f][s];
                    reflect_rows(&g, material_weights, &casts[f], curves + masks[f].curves,
                                 opacity, &sample, &rows[f][s], shading);
                }
#else
                reflect(&g, material_weights + places[f].z, &casts[f], 0, &entry[f][s], shading);
#endif
                UNROLL(group, GROUPS) g.highlight[group] += highlight[group];
                along += part * middle[f][s];
            }
            add_alpha(frame, &g, visible, along / MAX(visible, 1e-30f));
        }
        for (int f = 0; f < FIELDS; ++f)
            march[f].live &= MASK(g.transmittance > frame->min_transmittance);
    }
    write_picture(frame, &g, &r, pixel, first_tile * TILE_HEIGHT, channels, coefficients_out,
                  alpha_out, depth_out, first_out);
}
