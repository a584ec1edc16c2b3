// Transform of a look, from the scene under a light to the display.
//
// Twin of volspec/appearance/scene_to_display.py and the modules that it calls: adaptation/*.py,
// models/rlab.py, models/lab.py. Transforms have one of three forms: LINEAR, CURVE, CAM.

// Cone responses to the white divided by its Y, kept within 1e-6 to 1e6.
function relativeWhite(matrix, seen) {
  return applied(matrix, seen.white.map((x) => x / seen.white[1])).map(boundedGain);
}

function boundedGain(x) {
  const size = clamped(Math.abs(x), 1e-6, 1e6);
  return x < 0 || Object.is(x, -0) ? -size : size;
}

const conesOfWhite = (k, seen) => (
  relativeWhite(k.CONES_FROM_XYZ, seen).map((x) => Math.max(x, 1e-6)));

const toPercent = (seen) => 100 / seen.white[1];

// Luminance of the white, cd/m².
const whiteLuminance = (seen) => (
  clamped(seen.L_A / Math.max(seen.Y_b / seen.white[1], 1e-4), 1e-4, 1e6));

function vonKries(k, name) {
  const matrix = k.adaptation_spaces[name];
  const byLuminance = name === 'CAT02' || name === 'CAT16';
  const adapted = (seen) => {
    const { F } = surroundAt(k, seen.surround);
    const own = byLuminance ? degreeOfAdaptation(F, seen.L_A) : 1;
    const D = seen.discount ? 1 : seen.D ?? own;
    const gains = relativeWhite(matrix, seen).map((R) => boundedGain(D / R + 1 - D));
    return scaled(scaledRows(matrix, gains), toPercent(seen));
  };
  return (scene, display) => linear(product(inverted(adapted(display)), adapted(scene)));
}

const linear = (matrix) => ({ form: 'LINEAR', matrix });

function curve(response_from_XYZ, XYZ_from_response, values) {
  const of = (value) => (Array.isArray(value) ? value : [value, value, value]);
  const { gain = 1, power = 1, shift = 0, offset = 0, outer = 1 } = values;
  return {
    form: 'CURVE', response_from_XYZ, XYZ_from_response, gain: of(gain), power: of(power),
    shift: of(shift), offset: of(offset), outer: of(outer),
  };
}

// Fairchild's model of 1990: incomplete adaptation and mixing of cone responses.
function fairchild(k, scene, display) {
  const adapted = (seen) => {
    const cones = conesOfWhite(k, seen);
    const share = cones.map((x, i) => x / k.CONES_FROM_XYZ[i].reduce((a, b) => a + b, 0));
    const sum = share.reduce((a, b) => a + b, 0);
    const base = 1 + whiteLuminance(seen) ** (1 / 3);
    const gains = cones.map((x, i) => {
      const e = 3 * share[i] / sum;
      return (seen.discount ? 1 : (base + e) / (base + 1 / e)) / x;
    });
    const c = 0.219 - 0.0784 * Math.log10(whiteLuminance(seen));
    const mixing = identity().map((row) => row.map((x) => (x ? 1 : c)));
    return scaled(product(mixing, scaledRows(k.CONES_FROM_XYZ, gains)), toPercent(seen));
  };
  return linear(product(inverted(adapted(display)), adapted(scene)));
}

// Nayatani's nonlinear model, and CIE 109 of 1994, which preserves the 20 % grey.
function nayatani(k, levelled, scene, display) {
  const background = (seen, Y_o = toPercent(seen) * seen.Y_b) => (
    conesOfWhite(k, seen).map((x) => Y_o * x + 1));
  const exponents = (seen) => conesOfWhite(k, seen).map((cone, i) => {
    const x = (seen.L_A * cone) ** (i < 2 ? 0.4495 : 0.5128);
    return i < 2 ? (6.469 + 6.362 * x) / (6.469 + x) : 0.7844 * (8.414 + 8.091 * x) / (8.414 + x);
  });
  const level = (seen) => {
    const [near, grey, beta] = [background(seen), background(seen, 20), exponents(seen)];
    return (near[0] / grey[0]) ** (beta[0] * 2 / 3) * (near[1] / grey[1]) ** (beta[1] / 3);
  };
  const near = background(scene), beta = exponents(display), own = exponents(scene);
  const K = levelled ? level(scene) / level(display) : 1;
  return curve(
    scaledRows(scaled(k.CONES_FROM_XYZ, toPercent(scene)), near.map((x) => 1 / x)),
    inverted(scaled(k.CONES_FROM_XYZ, toPercent(display))),
    {
      gain: background(display).map((x, i) => x * K ** (1 / beta[i])),
      power: own.map((x, i) => x / beta[i]),
      shift: near.map((x) => 1 / x),
      offset: -1,
    },
  );
}

// Guth's model: powers of the cones, and gains that saturate with the adapting light.
function guth(k, scene, display) {
  const { GAIN, NOISE, POWER, SIGMA, ADAPTING } = k.guth;
  const trolands = (seen) => 18 * whiteLuminance(seen) ** 0.8;
  const saturation = (seen) => conesOfWhite(k, seen).map((cone, i) => (
    SIGMA + GAIN[i] * (ADAPTING * trolands(seen) * cone) ** POWER + NOISE[i]));
  const fromXYZ = (seen) => scaled(k.CONES_FROM_XYZ, trolands(seen) / seen.white[1]);
  const before = saturation(scene);
  const kappa = saturation(display).map((x, i) => x / before[i]);
  return curve(fromXYZ(scene), inverted(fromXYZ(display)), {
    gain: kappa, power: POWER, offset: kappa.map((x, i) => (x - 1) * NOISE[i] / GAIN[i]),
    outer: 1 / POWER,
  });
}

// RLAB's exponent for a surround, and the matrix to its reference conditions.
const rlabExponent = (ratio) => interpolated(ratio, [0, 0.1, 0.2], [1 / 3.5, 1 / 2.9, 1 / 2.3]);

function rlabReference(k, seen) {
  const cones = applied(k.HPE_FROM_XYZ, seen.white);
  const sum = cones.reduce((a, b) => a + b, 0), level = 1 + Math.cbrt(seen.L_A);
  const D = seen.discount ? 1 : seen.D ?? 0;
  const gains = cones.map((cone) => {
    const share = 3 * cone / sum, p = (level + share) / (level + 1 / share);
    return (p + D * (1 - p)) / cone;
  });
  return product(k.RLAB_REFERENCE, scaledRows(k.HPE_FROM_XYZ, gains));
}

const TRANSFORMS = {
  CIECAM02: (k, scene, display) => camTransform(k, 'CIECAM02', scene, display),
  CAM16: (k, scene, display) => camTransform(k, 'CAM16', scene, display),
  Hellwig2022: (k, scene, display) => camTransform(k, 'Hellwig2022', scene, display),
  CIELAB: (k, scene, display) => linear(diagonal(display.white.map((x, i) => x / scene.white[i]))),
  RLAB: (k, scene, display) => curve(
    rlabReference(k, scene), inverted(rlabReference(k, display)),
    { power: rlabExponent(scene.surround) / rlabExponent(display.surround) }),
};

const ADAPTATIONS = {
  none: () => linear(identity()),
  ...Object.fromEntries(['von Kries', 'Bradford', 'Sharp', 'CAT02', 'CAT16'].map((name) => (
    [name, (k, scene, display) => vonKries(k, name)(scene, display)]))),
  Nayatani: (k, scene, display) => nayatani(k, false, scene, display),
  'CIE 1994': (k, scene, display) => nayatani(k, true, scene, display),
  Guth: guth,
  'Fairchild 1990': fairchild,
};

// Conditions to which the eye in the scene adapts; `lux` is the light's, or null if it has none.
function sceneConditions(look, white, lux) {
  const L_A = look.L_A ?? (lux ?? look.lux) / Math.PI * (look.Y_A ?? look.Y_b) / 100;
  return {
    white: white.map((x) => Math.max(x, 1e-6 * white[1])), L_A, Y_b: look.Y_b,
    surround: look.surround, D: look.discount ? null : look.D, discount: look.discount,
  };
}

function viewTransform(k, look, white, lux, display) {
  const scene = sceneConditions(look, white, lux);
  if (!(look.model in ADAPTATIONS)) return TRANSFORMS[look.model](k, scene, display);
  // Only the white changes, tones stay: models that depend on level get one level for both.
  const { L_A, Y_b, surround } = scene;
  return ADAPTATIONS[look.model](k, scene, { ...display, L_A, Y_b, surround });
}
