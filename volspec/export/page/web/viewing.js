// Panel of the eye and the picture: inputs in the HTML, bound to the fields that they change.

// Conversions between a slider's number and its field, and the field's text.
const SCALES = {
  plain: { of: (x) => x, from: (x) => x },
  log10: { of: (x) => 10 ** x, from: (x) => Math.log10(Math.max(x, 1e-12)) },
  log2: { of: (x) => 2 ** x, from: (x) => Math.log2(Math.max(x, 1e-12)) },
};

const READ_OUT = {
  lux: (x) => `${figures(x)} lx`,
  L_A: (x) => `${figures(x)} cd/m\u00b2`,
  Y_b: (x) => `${figures(x)} %`,
  D: (x) => x.toFixed(2),
  exposure: (x) => `${Math.log2(x) < 0 ? '\u2212' : '+'}${Math.abs(Math.log2(x)).toFixed(2)} EV`,
  backdrop: (x) => x.toFixed(2),
  severity: (x) => x.toFixed(2),
};

function viewingPanel(app) {
  const { page } = app;
  fillChoices(page);
  const bound = [...document.querySelectorAll('[data-look]')].map((input) => binding(app, input));
  return () => {
    const look = app.look(), lit = app.lit(look);
    const scene = sceneConditions(look, lit?.white ?? page.display.white, lit?.lux ?? null);
    const lux = lit?.lux ?? look.lux;
    const shown = { ...look, L_A: scene.L_A, lux, D: degreeShown(page, look, scene) };
    bound.forEach((refresh) => refresh(look, shown));
    byId('lux').disabled = look.L_A !== null || (lit && lit.lux !== null);
    byId('L_A').disabled = look.L_A === null;
    byId('D').disabled = look.D === null || look.discount;
    byId('own-D').disabled = look.discount;
    byId('severity-row').hidden = look.deficiency === 'none';
    byId('model-kind').textContent = page.models.appearance.includes(look.model)
      ? 'Lightness, chroma and hue as the eye in the scene sees them.'
      : look.model === 'none' ? 'Colours as they are, to an eye that does not adapt.'
        : 'The white moves to the display\u2019s; tones stay.';
  };
}

// Degree of adaptation: the given D, or else the model's own, which only some models have.
function degreeShown(page, look, scene) {
  if (look.discount) return 1;
  if (look.D !== null) return look.D;
  if (look.model === 'RLAB') return 0;
  const byLuminance = ['CIECAM02', 'CAM16', 'Hellwig2022', 'CAT02', 'CAT16'].includes(look.model);
  const { F } = surroundAt(page.constants, look.surround);
  return byLuminance ? degreeOfAdaptation(F, scene.L_A) : 1;
}

function fillChoices(page) {
  const options = (words) => words.map((word) => el('option', { value: word }, word));
  byId('model').append(
    el('optgroup', { label: 'Appearance models' }, ...options(page.models.appearance)),
    el('optgroup', { label: 'Adaptation only' }, ...options(page.models.adaptation)));
  const ratios = page.constants.surrounds.map(({ name, ratio }) => [ratio, name]);
  const own = page.look.surround;
  if (!ratios.some(([ratio]) => ratio === own)) ratios.push([own, `ratio ${own}`]);
  byId('surround').append(
    ...ratios.reverse().map(([ratio, name]) => el('option', { value: ratio }, name)));
  byId('deficiency').append(
    el('option', { value: 'none' }, 'normal'), ...options(Object.keys(page.deficiencies)));
  const fields = lookFields(page);
  byId('filter').textContent = page.filter;
  byId('filter-row').hidden = !page.filter;
  // If channels are materials, colours are exact in every mode.
  byId('mode-row').hidden = byId('errors-row').hidden = page.basis.kind === 'materials';
  byId('level-row').hidden = fields.level.read('absolute') === undefined;
  byId('gamut-row').hidden = fields.gamut.read('reduce') === undefined;
}

// Bind an input to its field; return the function that shows the field's value.
function binding(app, input) {
  const field = input.dataset.look, scale = SCALES[input.dataset.scale ?? 'plain'];
  const output = input.closest('.row')?.querySelector('output');
  const set = (value) => app.edit((look) => ({ ...look, [field]: value }));
  if (input.type === 'checkbox' && input.dataset.own) {
    input.addEventListener('change', () => set(input.checked ? app.shownNumber(field) : null));
    return (look) => { input.checked = look[field] !== null; };
  }
  if (input.type === 'checkbox') {
    input.addEventListener('change', () => set(input.checked));
    return (look) => { input.checked = look[field]; };
  }
  if (input.tagName === 'SELECT') {
    const numeric = field === 'surround';
    input.addEventListener('change', () => set(numeric ? Number(input.value) : input.value));
    return (look) => { input.value = look[field]; };
  }
  input.addEventListener('input', () => set(scale.of(input.valueAsNumber)));
  return (_, shown) => {
    input.value = scale.from(shown[field]);
    const words = READ_OUT[field](shown[field]);
    if (output) output.textContent = words;
    input.setAttribute('aria-valuetext', words);
  };
}
