// Appearance of a colour, for the probe, and colour differences.
//
// Twins of volspec/appearance/models/{cam,hellwig2022,cielab,rlab}.py and of delta_E_2000.

// J, C and h of CIECAM02, CAM16 or Hellwig2022; null where the model is undefined.
function camLook(k, XYZ, scene, model) {
  const own = conditionsOf(k, scene, model);
  const linear = applied(own.responseFromXYZ, XYZ);
  const R = linear.map((r) => compressed(k, r));
  const signal = dot(k.ACHROMATIC, R), achromatic = Math.max(signal, 0);
  const a = dot(k.OPPONENT_A, R), b = dot(k.OPPONENT_B, R), radius = Math.hypot(a, b);
  const h = polarAngle(a, b);
  const J = 100 * (achromatic / own.achromatic) ** own.lightnessPower;
  if (R.some((r) => Math.abs(r) > k.RESPONSE_LIMIT)) return null;
  const black = R.every((r) => r === 0);
  if (model === 'Hellwig2022') {
    if (linear.some((r) => r < -1e-12)) return null;
    const e_t = 1 + k.HELLWIG_COSINES.reduce((sum, c, i) => {
      const angle = (i + 1) * h * Math.PI / 180;
      return sum + c * Math.cos(angle) + k.HELLWIG_SINES[i] * Math.sin(angle);
    }, 0);
    const M = 43 * own.N_c * e_t * radius, Q = 2 / own.c * J / 100 * own.achromatic;
    return { J, C: 35 * M / own.achromatic, h, Q, M, s: Q > 0 ? 100 * M / Q : 0 };
  }
  const p2 = achromatic + k.ACHROMATIC_NOISE;
  const sum = dot(k.CHROMA_SUM, R) + k.RESPONSE_NOISE * k.CHROMA_SUM.reduce((x, y) => x + y, 0);
  const sound = sum >= k.CHROMA_FLOOR * p2 && p2 >= k.CHROMA_FLOOR * sum && signal > 0;
  if (!(sound || black)) return null;
  const eccentricity = Math.cos(h * Math.PI / 180 + 2) + k.ECCENTRICITY_OFFSET;
  const t = own.eccentricityScale * eccentricity * radius / Math.max(sum, k.CHROMA_FLOOR * p2);
  const C = t ** k.CHROMA_POWER * Math.sqrt(J / 100) * own.chromaScale;
  const Q = 4 / own.c * (own.A_w + 4) * Math.sqrt(J / 100) * own.F_L ** 0.25;
  const M = C * own.F_L ** 0.25;
  return { J, C, h, Q, M, s: Q > 0 ? 100 * Math.sqrt(M / Q) : 0 };
}

const polarAngle = (a, b) => (Math.atan2(b, a) * 180 / Math.PI + 360) % 360;

const polarLook = ([J, a, b]) => ({ J, C: Math.hypot(a, b), h: polarAngle(a, b) });

function cielabOf(XYZ, white) {
  const [x, y, z] = XYZ.map((value, i) => {
    const ratio = value / white[i];
    return ratio > (6 / 29) ** 3 ? Math.cbrt(ratio) : (29 / 6) ** 2 / 3 * ratio + 4 / 29;
  });
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

// Appearance by the picture's model, or by CIECAM02 if the model only adapts.
function lookOf(k, XYZ, scene, model) {
  if (model === 'CIELAB') {
    const defined = XYZ.every((x, i) => x >= -1e-12 * scene.white[i]);
    return defined ? polarLook(cielabOf(XYZ, scene.white)) : null;
  }
  if (model === 'RLAB') {
    const sigma = rlabExponent(scene.surround);
    const reference = applied(rlabReference(k, scene), XYZ);
    if (reference.some((x) => x < -1e-12)) return null;
    const [X, Y, Z] = reference.map((x) => signedPower(x, sigma));
    return polarLook([100 * Y, 430 * (X - Y), 170 * (Y - Z)]);
  }
  const cams = ['CAM16', 'Hellwig2022'];
  return camLook(k, XYZ, scene, cams.includes(model) ? model : 'CIECAM02');
}

const saturated = (C) => Math.sqrt(C ** 7 / (C ** 7 + 25 ** 7));

const inDegrees = (f, x) => f(x * Math.PI / 180);

// CIEDE2000 of two CIELAB colours.
function deltaE2000([L1, a1, b1], [L2, a2, b2]) {
  const stretch = 1 + 0.5 * (1 - saturated((Math.hypot(a1, b1) + Math.hypot(a2, b2)) / 2));
  const C1 = Math.hypot(stretch * a1, b1), C2 = Math.hypot(stretch * a2, b2);
  const h1 = polarAngle(stretch * a1, b1), h2 = polarAngle(stretch * a2, b2);
  let turn = h2 - h1;
  if (turn > 180) turn -= 360; else if (turn < -180) turn += 360;
  const dH = 2 * Math.sqrt(C1 * C2) * inDegrees(Math.sin, turn / 2);
  const C = (C1 + C2) / 2, L = (L1 + L2) / 2;
  let h = h1 + h2;
  if (C1 * C2 !== 0) {
    h = (Math.abs(h1 - h2) > 180 ? h + (h < 360 ? 360 : -360) : h) / 2;
  }
  const T = 1 - 0.17 * inDegrees(Math.cos, h - 30) + 0.24 * inDegrees(Math.cos, 2 * h)
    + 0.32 * inDegrees(Math.cos, 3 * h + 6) - 0.2 * inDegrees(Math.cos, 4 * h - 63);
  const S_L = 1 + 0.015 * (L - 50) ** 2 / Math.sqrt(20 + (L - 50) ** 2);
  const lightness = (L2 - L1) / S_L, chroma = (C2 - C1) / (1 + 0.045 * C);
  const hue = dH / (1 + 0.015 * C * T);
  const R_T = -2 * saturated(C) * inDegrees(Math.sin, 60 * Math.exp(-(((h - 275) / 25) ** 2)));
  const square = lightness ** 2 + chroma ** 2 + hue ** 2 + R_T * chroma * hue;
  return Math.sqrt(Math.max(square, 0));
}
