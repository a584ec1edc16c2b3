// The panel of lights: a row for each, the dial, and the spectrum of what shines together.

const DIAL_REACH = 64;

function lightsPanel(app) {
  const { page } = app, list = byId('light-list');
  const rows = page.lights.map((light, i) => lightRow(app, light, i));
  list.append(...rows.map((row) => row.item));
  const dial = page.lights.length > 1 ? lightDial(app) : null;
  byId('dial').hidden = !dial;
  const ends = wavelengthsInWords(page.basis).map((words) => el('span', {}, words));
  byId('nanometres').replaceChildren(...ends);
  return () => {
    const look = app.look();
    rows.forEach((row) => row.refresh(look));
    dial?.(look);
    const lit = app.lit(look);
    byId('mixed').replaceChildren(lit
      ? spectrumBars(
        page.basis, lit.power, Math.max(...lit.power) * 1.04, { width: 310, height: 90 })
      : el('span', {}, 'No light'));
    byId('white').textContent = lit ? whiteInWords(lit) : 'Every light is off.';
  };
}

function whiteInWords({ white: [X, Y, Z], lux }) {
  const sum = X + Y + Z;
  const told = `White x ${(X / sum).toFixed(4)}, y ${(Y / sum).toFixed(4)}`;
  return lux === null ? told : `${told}; ${figures(lux)} lx`;
}

// What a light's own rig gives, alone: for its swatch and its small spectrum.
function alone(page, light) {
  const parts = facing(light.parts, page.groups);
  const power = mixedPower(parts.some((part) => part.weight > 0) ? parts : light.parts);
  return { power, colour: lightColour(page, whiteOf(page.basis, power)) };
}

function lightRow(app, light, i) {
  const { power } = alone(app.page, light), named = isolated(light.name);
  const set = (weight) => app.edit((look) => ({
    ...look, weights: look.weights.map((w, j) => (j === i ? weight : w)) }));
  const slider = el('input', {
    type: 'range', min: 0, max: 1, step: 0.01, 'aria-label': `Weight of ${named}`,
    oninput: () => set(slider.valueAsNumber),
  });
  const output = el('output', { 'aria-hidden': 'true' });
  const only = el('button', {
    type: 'button', class: 'light-name', title: `${isolated(light.label)}, alone`,
    onclick: () => app.edit((look) => ({
      ...look, solo: -1, weights: look.weights.map((_, j) => (j === i ? 1 : 0)) })),
  }, spectrumBars(app.page.basis, power, Math.max(...power), { width: 40, height: 24 }),
  el('span', { class: 'words' }, el('bdi', {}, light.name), light.label === light.name ? ''
    : el('bdi', { class: 'quiet' }, light.label)));
  const solo = el('button', {
    type: 'button', class: 'solo', 'aria-label': `Solo ${named}`, title: 'Solo: the others are off',
    onclick: () => app.edit((look) => ({ ...look, solo: look.solo === i ? -1 : i,
      weights: look.weights.map((w, j) => (j === i && look.solo !== i && w === 0 ? 1 : w)) })),
  }, 'S');
  const item = el('li', {}, only, slider, output, solo);
  const refresh = (look) => {
    slider.value = look.weights[i];
    output.textContent = look.weights[i].toFixed(2);
    only.setAttribute('aria-pressed', shining(look).every((w, j) => (w > 0) === (j === i)));
    solo.setAttribute('aria-pressed', look.solo === i);
    item.classList.toggle('off', shining(look)[i] === 0);
  };
  return { item, refresh };
}

// The dial: drag, or the arrow keys, between the lights that stand on its rim.
function lightDial(app) {
  const { page } = app, host = byId('dial'), count = page.lights.length;
  const spokes = svg('g', {}), knob = svg('circle', { r: 10, class: 'knob' });
  const rim = dialCorners(count).map(([x, y]) => [x * DIAL_REACH, y * DIAL_REACH]);
  const points = rim.map((p) => p.map((x) => x.toFixed(1)).join(',')).join(' ');
  const drawing = svg(
    'svg', { viewBox: '-134 -100 268 196' }, svg('polygon', { points, class: 'rim' }), spokes,
    ...page.lights.flatMap((light, i) => cornerOf(light, rim[i], app)), knob);
  host.append(drawing);
  const moveTo = (x, y) => app.edit((look) => ({
    ...look, solo: -1, weights: blendedWeights(count, x, y) }));
  const drag = (event) => {
    const { a, d, e, f } = drawing.getScreenCTM();
    moveTo((event.clientX - e) / a / DIAL_REACH, (event.clientY - f) / d / DIAL_REACH);
  };
  host.addEventListener('pointerdown', (event) => {
    if (event.button) return;
    host.setPointerCapture(event.pointerId);
    drag(event);
  });
  host.addEventListener('pointermove', (event) => {
    if (host.hasPointerCapture(event.pointerId)) drag(event);
  });
  host.addEventListener('keydown', (event) => {
    const way = ARROWS[event.key];
    if (!way) return;
    event.preventDefault();
    const [x, y] = dialPlace(shining(app.look()));
    moveTo(x + 0.08 * way[0], y + 0.08 * way[1]);
  });
  return (look) => {
    const weights = shining(look), [x, y] = dialPlace(weights).map((v) => v * DIAL_REACH);
    const most = Math.max(...weights, 1e-9);
    spokes.replaceChildren(...rim.map(([cx, cy], i) => svg('line', {
      x1: x, y1: y, x2: cx, y2: cy, class: 'spoke',
      'stroke-opacity': (weights[i] / most).toFixed(2),
    })));
    knob.setAttribute('cx', x);
    knob.setAttribute('cy', y);
    host.setAttribute('aria-valuemax', count);
    host.setAttribute('aria-valuenow', weights.indexOf(Math.max(...weights)) + 1);
    host.setAttribute('aria-valuetext', namesOf(page, look));
  };
}

function cornerOf(light, [x, y], { page }) {
  const beside = Math.abs(x) > 20;
  const name = svg('text', {
    x: (x * 1.15 + (beside ? Math.sign(x) * 2 : 0)).toFixed(1),
    y: (y * 1.16 + (beside ? 4 : y > 0 ? 14 : -5)).toFixed(1),
    'text-anchor': beside ? (x > 0 ? 'start' : 'end') : 'middle',
  });
  const room = beside ? 6 : 14, letters = [...light.name];
  const cut = letters.length > room;
  name.textContent = isolated(cut ? `${letters.slice(0, room - 1).join('')}\u2026` : light.name);
  const fill = alone(page, light).colour;
  return [svg('circle', { cx: x, cy: y, r: 7, fill, class: 'corner' }), name];
}

// The names of what shines, in words.
function namesOf(page, look) {
  const lit = page.lights.filter((_, i) => shining(look)[i] > 0).map(({ name }) => isolated(name));
  return lit.slice(0, 3).join(' + ') + (lit.length > 3 ? ' + \u2026' : '') || 'no light';
}
