// Viewing conditions as scalars of CIECAM02, CAM16 and Hellwig2022, and the transform between two conditions.
//
// Twin of volspec/appearance/models/cam.py and level.py; `k` has the constants of
// volspec/appearance/display/constants.py.

// F, c and N_c by the surround's ratio to white, linear between dark, dim and average.
function surroundAt(k, ratio) {
  const of = (name) => interpolated(
    ratio, k.surrounds.map((s) => s.ratio), k.surrounds.map((s) => s[name]));
  return { F: of('F'), c: of('c'), N_c: of('N_c') };
}

// x times 400 f / (27.13 + f), f = |x|^0.42.
function compressed(k, r) {
  const f = Math.abs(r) ** k.RESPONSE_POWER;
  return Math.sign(r) * k.RESPONSE_POLE * f / (k.RESPONSE_HALF + f);
}

const degreeOfAdaptation = (F, L_A) => F * (1 - Math.exp(-(L_A + 42) / 92) / 3.6);

function levelFactor(L_A) {
  const five = 5 * clamped(L_A, 1e-6, 1e9), k4 = (five + 1) ** -4;
  return 0.1 * (2 * k4 * five + (1 - k4) ** 2 * Math.cbrt(five));
}

// The model of gamut mapping: CAM16 for models with its lightness and hue.
const gamutModel = (model) => (['CAM16', 'Hellwig2022'].includes(model) ? 'CAM16' : 'CIECAM02');

// seen: {white, L_A, Y_b, surround (a ratio), D, discount}; model: CIECAM02, CAM16 or Hellwig2022.
function conditionsOf(k, seen, model) {
  const { F, c, N_c } = surroundAt(k, seen.surround);
  const sharp = gamutModel(model) === 'CAM16';
  const adaptedFromXYZ = sharp ? k.CAT16_FROM_XYZ : k.CAT02_FROM_XYZ;
  const compressedFromAdapted = sharp ? identity() : k.HPE_FROM_CAT02;
  const Y_w = seen.white[1];
  const D = seen.discount ? 1 : seen.D === null ? degreeOfAdaptation(F, seen.L_A) : seen.D;
  const F_L = levelFactor(seen.L_A), n = Math.max(seen.Y_b / Y_w, 1e-4);
  const floor = 1e-6 * Y_w;
  // A spectral light can have a zero response: keep its gain finite.
  const gains = applied(adaptedFromXYZ, seen.white).map((R) => {
    const kept = Math.abs(R) < floor ? (R < 0 ? -floor : floor) : R;
    return Y_w * D / kept + 1 - D;
  });
  const response = scaled(
    product(compressedFromAdapted, scaledRows(adaptedFromXYZ, gains)), F_L / 100);
  const N_bb = 0.725 * n ** -0.2;
  const achromatic = dot(
    k.ACHROMATIC, applied(response, seen.white).map((r) => compressed(k, r)));
  return {
    model, D, F_L, n, c, N_c, N_bb, responseFromXYZ: response, achromatic,
    A_w: N_bb * achromatic,
    lightnessPower: c * (1.48 + Math.sqrt(n)),
    chromaScale: (1.64 - 0.29 ** n) ** 0.73,
    eccentricityScale: k.ECCENTRICITY_SCALE * N_c * N_bb / 4,
  };
}

// Transform of J, C and h from the scene to the display: uniforms of shaders/include/cam.glsl.
function camTransform(k, model, scene, display) {
  const [from, to] = [scene, display].map((seen) => conditionsOf(k, seen, model));
  const proportional = model === 'Hellwig2022';
  const chroma = (from.chromaScale / to.chromaScale) ** (1 / k.CHROMA_POWER);
  return {
    form: 'CAM', proportional,
    response_from_XYZ: from.responseFromXYZ,
    XYZ_from_response: scaled(
      inverted(to.responseFromXYZ), k.RESPONSE_HALF ** (1 / k.RESPONSE_POWER)),
    scene_achromatic: from.achromatic,
    display_achromatic: to.achromatic,
    lightness_power: from.lightnessPower / to.lightnessPower,
    chroma_gain: proportional
      ? from.N_c / from.achromatic * to.achromatic / to.N_c
      : chroma * from.eccentricityScale / to.eccentricityScale,
  };
}
