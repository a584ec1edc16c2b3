// State of the page as plain data, and as text after the # of the address.
//
// A look is the settings of one side of the picture: lights, eye, picture. Only differences from
// the page's initial state are written. An address may contain anything; only valid values count.

const within = (low, high) => ({
  write: (x) => String(+x.toPrecision(6)),
  read: (text) => {
    const x = text.trim() === '' ? NaN : Number(text);
    return x >= low && x <= high ? x : undefined;
  },
});

const choice = (...words) => ({
  write: (word) => word, read: (text) => (words.includes(text) ? text : undefined) });

const orNone = (kind) => ({
  write: (x) => (x === null ? 'own' : kind.write(x)),
  read: (text) => (text === 'own' ? null : kind.read(text)),
});

const yesOrNo = { write: (x) => (x ? '1' : '0'), read: (text) => ({ 0: false, 1: true })[text] };

const wholeNumber = (low, high) => ({
  write: String,
  read: (text) => (/^-?\d+$/.test(text) && +text >= low && +text <= high ? +text : undefined),
});

const numbers = (count, low, high) => ({
  write: (list) => list.map(within(low, high).write).join(','),
  read: (text) => {
    const list = text.split(',').map(within(low, high).read);
    return list.length === count && !list.includes(undefined) ? list : undefined;
  },
});

// Scales of opacity beyond a slider's end are those of a notebook.
const MAX_SCALE = 1000;

function lookFields(page) {
  const count = page.lights.length;
  const known = [...page.models.appearance, ...page.models.adaptation];
  const counted = page.lights.every((light) => light.parts.every((part) => part.lux !== null));
  return {
    weights: numbers(count, 0, 1), solo: wholeNumber(-1, count - 1), model: choice(...known),
    lux: within(1e-6, 1e9), L_A: orNone(within(0, 1e9)), Y_b: within(0, 2000),
    Y_A: orNone(within(0, 2000)),
    surround: within(0, 0.2), D: orNone(within(0, 1)), discount: yesOrNo,
    exposure: within(1e-6, 1e6), backdrop: within(0, 1), mode: choice(...page.models.modes),
    level: choice('relative', ...(counted ? ['absolute'] : [])),
    gamut: choice('clip', ...(page.gamut.CIECAM02 && page.gamut.CAM16 ? ['reduce'] : [])),
    mark: yesOrNo, deficiency: choice('none', ...Object.keys(page.deficiencies)),
    severity: within(0, 1),
    ...(page.opacity && { opacity: numbers(page.opacity.materials.length, 0, MAX_SCALE) }),
    ...depthFields(page),
  };
}

const desktopFields = (page) => ({
  compare: yesOrNo, divide: within(0, 1), view: wholeNumber(0, page.views.length - 1),
  errors: yesOrNo,
  probe: orNone(numbers(2, 0, Math.max(page.channels.width, page.channels.height))),
  ...(page.served && cameraFields(page.served)), ...turnFields(page),
});

const cameraFields = ({ distances }) => ({
  azimuth: within(-180, 180), elevation: within(-90, 90), distance: within(...distances) });

// Number of cameras; views are ordered by time step, and then by camera.
const camerasOf = ({ views }) => views.filter(({ step }) => step === views[0].step).length;

const stepsOf = (page) => page.views.length / camerasOf(page);

// Number of the view that some turns and time steps lead to; both go round.
function viewAfter(page, view, turns, steps) {
  const cameras = camerasOf(page), count = stepsOf(page);
  const around = (n, all) => ((n % all) + all) % all;
  const step = around(Math.floor(view / cameras) + steps, count);
  return step * cameras + around(view % cameras + turns, cameras);
}

// Initial state of a page: sides A and B are equal, and not compared.
const opened = (page) => ({
  sides: [page.look, page.look], edited: 0, compare: false, divide: 0.5, view: 0, errors: false,
  probe: null,
  ...(page.served && {
    azimuth: page.served.azimuth_deg, elevation: page.served.elevation_deg, distance: 1 }),
  ...turnOpened(page),
});

function written(state, page) {
  const first = opened(page), words = new URLSearchParams();
  const add = (fields, prefix, now, then) => {
    for (const [name, kind] of Object.entries(fields)) {
      const text = kind.write(now[name]);
      if (text !== kind.write(then[name])) words.set(prefix + name, text);
    }
  };
  add(desktopFields(page), '', state, first);
  add(lookFields(page), 'a.', state.sides[0], page.look);
  if (state.compare) add(lookFields(page), 'b.', state.sides[1], page.look);
  return words.toString().replaceAll('%2C', ',');
}

function readFrom(text, page) {
  const state = opened(page), words = new URLSearchParams(text);
  const take = (fields, prefix, onto) => {
    const found = { ...onto };
    for (const [name, kind] of Object.entries(fields)) {
      const word = words.get(prefix + name);
      const value = word === null ? undefined : kind.read(word);
      if (value !== undefined) found[name] = value;
    }
    return found;
  };
  const sides = ['a.', 'b.'].map((prefix) => take(lookFields(page), prefix, page.look));
  const { width, height } = page.channels;
  const read = { ...take(desktopFields(page), '', state), sides };
  if (read.probe) {
    read.probe = [clamped(Math.floor(read.probe[0]), 0, width - 1),
      clamped(Math.floor(read.probe[1]), 0, height - 1)];
  }
  return read;
}
