// A light's effect on a pixel: one 3 x L·M matrix, the white, and the backdrop's colour.
//
//     e = Σ_j w_j A E_j
//     XYZ = Σ_g M_g C_g         + (1 - alpha) XYZ_backdrop     fitted, M_g = Σ_j w_j M_E_j
//     XYZ = Σ_g D_g (e_g ∘ C_g) + (1 - alpha) XYZ_backdrop     componentwise
//     XYZ = Σ_g P_E_g C_g       + (1 - alpha) XYZ_backdrop     exact
//
// Twin of volspec/relight/illumination.py, volspec/relight/spec.py (LightRig) and
// volspec/basis/display.py; `basis` is from `basis_numbers` in volspec/export/page/payload.py.

const NO_COLOUR = 1e-3, MIN_STRETCH = 0.5, MAX_STRETCH = 2;
// volspec/spectra/photometry.py: INVISIBLE
const INVISIBLE = 0.01;

// The lights that are on, as parts {power, weight, lux, unit_lux, group}; null if all are off.
// Lux are used if every light that is on has them.
function rigOf(lights, weights) {
  const lit = lights.map((light, i) => [light, weights[i]]).filter(([, weight]) => weight > 0);
  if (!lit.length) return null;
  const counted = lit.every(([light]) => light.parts.every((part) => part.lux !== null));
  return lit.flatMap(([light, weight]) => light.parts.map((part) => ({
    ...part, weight: part.weight * weight, lux: counted ? part.lux : null,
  })));
}

// Factor on a part's power; the result is in W / (m² nm) if the part has lux.
const powerScale = (part) => part.weight * (part.lux === null ? 1 : part.lux / part.unit_lux);

// Sum of the parts' spectra.
function mixedPower(parts) {
  const total = new Array(parts[0].power.length).fill(0);
  for (const part of parts) {
    const scale = powerScale(part);
    part.power.forEach((E, k) => { total[k] += scale * E; });
  }
  return total;
}

// (3, m): the parts' own matrices, each weighted by its part of the luminous `total`.
function fittedMatrix(V, parts, total) {
  const sum = parts[0].fitted.map((row) => row.map(() => 0));
  for (const part of parts) {
    const brightness = powerScale(part) * dot(V, part.power) / total;
    part.fitted.forEach((row, i) => row.forEach((x, k) => { sum[i][k] += brightness * x; }));
  }
  return sum;
}

// Light on a surface that faces every source: each part weighted by its group.
const facing = (parts, shares) => parts.map((part) => ({
  ...part, weight: part.weight * (part.group ? shares[part.group] : 1),
}));

const shinesFrom = (parts, group) => {
  const own = parts.filter((part) => part.group === '' || part.group === group);
  return own.some((part) => part.weight * (part.lux === null ? 1 : part.lux) > 0) ? own : null;
};

// XYZ of the perfect diffuser, Y = 100.
function whiteOf(basis, E) {
  const Y = dot(basis.Q[1], E);
  return basis.Q.map((row) => 100 * dot(row, E) / Y);
}

// A row proportional to the channels' luminances, 1 for the diffuser.
function luminousShare(luminous, channels, Y) {
  const total = dot(luminous, channels), scale = Math.max(total, Y);
  const most = Math.max(...channels.map(Math.abs));
  const unit = channels.map((c) => c / most);
  const missing = (1 - total / scale) / unit.reduce((sum, u, i) => sum + u * channels[i], 0);
  return luminous.map((x, i) => x / scale + unit[i] * missing);
}

// Stretch rows, by a factor of at most two, so that the matrix yields the white.
function whiteExact(matrix, channels, white) {
  const stretched = matrix.map((row, i) => {
    const least = Math.max(white[i] / MAX_STRETCH, 1e-12);
    const ratio = Math.max(white[i] / Math.max(dot(row, channels), least), MIN_STRETCH);
    return row.map((x) => x * ratio);
  });
  const share = luminousShare(stretched[1], channels, white[1]);
  return stretched.map((row, i) => {
    const rest = white[i] - dot(row, channels);
    return row.map((x, k) => x + rest * share[k]);
  });
}

// K with XYZ = K (e * c); X or Z that the light nearly lacks follows Y.
function displayMatrix(D, e, E, Q) {
  const flat = Q[1].reduce((sum, q) => sum + q, 0);
  const kappa = 100 / dot(Q[1], E);
  const white = Q.map((row) => kappa * dot(row, E));
  const K = whiteExact(scaled(D, kappa * flat / 100), e, white);
  const share = luminousShare(K[1], e, white[1]);
  return K.map((row, i) => {
    const trust = clamped(white[i] / (NO_COLOUR * white[1]), 0, 1);
    return row.map((x, k) => trust * x + (1 - trust) * white[i] * share[k]);
  });
}

// kappa Q diag(E) B: exact but for the basis's error in reflectances.
function litMatrix(B, E, Q) {
  const kappa = 100 / dot(Q[1], E);
  return product(Q.map((row) => row.map((q, k) => kappa * q * E[k])), B);
}

// (N, m): light that each channel reflects and emits under a light of power E.
function leavingLight(basis, E) {
  const rows = basis.synthesis.map((row, i) => row.map((b) => b * E[i]));
  for (const [k, matrix] of basis.emission) {
    applied(matrix, E).forEach((emitted, i) => { rows[i][k] += emitted; });
  }
  return rows;
}

// Power through the filter in the eye's path.
const filtered = (basis, E) => (basis.filter ? E.map((e, k) => e * basis.filter[k]) : E);

// (3, m): channels to XYZ under a light of power E, Y = 100 for white without the filter.
function colourMatrix(basis, E, mode) {
  const { Q, analysis: A, synthesis: B, D } = basis;
  if (basis.kind === 'materials') {
    const kappa = 100 / dot(Q[1], E);
    return product(scaled(Q.map((row) => filtered(basis, row)), kappa), leavingLight(basis, E));
  }
  if (basis.filter) {
    const passed = filtered(basis, E), share = dot(Q[1], passed) / dot(Q[1], E);
    if (!(share > 0)) return Q.map(() => new Array(B[0].length).fill(0));
    return scaled(colourMatrix({ ...basis, filter: null }, passed, mode), share);
  }
  const ones = new Array(B[0].length).fill(1);
  if (mode === 'exact') return whiteExact(litMatrix(B, E, Q), ones, whiteOf(basis, E));
  const e = applied(A, E);
  if (mode === 'componentwise') {
    return displayMatrix(D, e, E, Q).map((row) => row.map((x, k) => x * e[k]));
  }
  const R = product(A, scaledRows(B, applied(B, e)));
  return displayMatrix(product(D, R), ones, E, Q);
}

// Uniforms of a light. `look` has mode, level, exposure, lux, backdrop.
function illuminationOf(basis, shares, parts, look) {
  const front = facing(parts, shares);
  if (!front.some((part) => part.weight > 0)) return null;
  const lux = front[0].lux === null
    ? null : front.reduce((sum, part) => sum + part.weight * part.lux, 0);
  const power = mixedPower(front), white = whiteOf(basis, power), V = basis.Q[1];
  const seen = dot(V, power) / V.reduce((sum, v) => sum + v, 0);
  const mean = power.reduce((sum, e) => sum + e, 0) / power.length;
  const gain = look.exposure * (look.level === 'absolute'
    ? lux / look.lux : seen >= INVISIBLE * mean ? 1 : seen / mean);
  const matrix = [[], [], []], dark = basis.synthesis[0].map(() => 0);
  const total = dot(V, power), fitted = look.mode === 'fitted' && basis.kind === 'spectral';
  for (const group of Object.keys(shares)) {
    const own = shinesFrom(parts, group);
    const E = own && mixedPower(own);
    // The basis scales each group to Y = 100; the white is of all groups together.
    let columns = matrix.map(() => dark);
    if (own && fitted) columns = scaled(fittedMatrix(V, own, total), gain);
    else if (own) columns = scaled(colourMatrix(basis, E, look.mode), gain * dot(V, E) / total);
    matrix.forEach((row, i) => row.push(...columns[i]));
  }
  const kappa = 100 / dot(V, power), behind = filtered(basis, power);
  const backdrop = basis.Q.map((row) => kappa * dot(row, behind) * gain * look.backdrop);
  return { matrix, white, lux, gain, power, backdrop };
}

// XYZ of a pixel from its channels and opacity.
function sceneXYZ(light, channels, alpha) {
  return light.matrix.map((row, i) => (
    row.reduce((sum, x, k) => sum + x * channels[k], 0) + (1 - alpha) * light.backdrop[i]
  ));
}
