// Panel of the lights: a row for each, the dial, and the spectrum of their mixture.

function lightsPanel(app) {
  const { page } = app, list = byId('light-list');
  const rows = page.lights.map((light, i) => lightRow(app, light, i));
  list.append(...rows.map((row) => row.item));
  const dial = page.lights.length > 1
    ? lightDial(app, page.lights.map((light) => alone(page, light).colour)) : null;
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
  const text = `White x ${(X / sum).toFixed(4)}, y ${(Y / sum).toFixed(4)}`;
  return lux === null ? text : `${text}; ${figures(lux)} lx`;
}

// Illumination by one light alone, for its swatch and small spectrum.
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
  const advice = el('p', { class: 'advice' });
  const item = el('li', {}, only, slider, output, solo, advice);
  const refresh = (look) => {
    slider.value = look.weights[i];
    output.textContent = look.weights[i].toFixed(2);
    only.setAttribute('aria-pressed', shining(look).every((w, j) => (w > 0) === (j === i)));
    solo.setAttribute('aria-pressed', look.solo === i);
    item.classList.toggle('off', shining(look)[i] === 0);
    advice.textContent = shining(look)[i] > 0 ? light.advice[look.mode] ?? '' : '';
  };
  return { item, refresh };
}
