// Panel of what depends on depth: cuts, fog, a lens, a small turn of the camera, and two eyes.
//
//     sliders -> look.near, far, fog, focus, aperture; state.turn, stereo
//             -> [recompose, nearby] -> picture

// The volume's depth over the visibility, at most.
const MAX_FOG = 8;
// Least and greatest f-number, the distance in focus over the lens's opening.
const F_NUMBERS = [4, 100];

// A lens needs a perspective.
const hasLens = ({ opacity }) => Boolean(opacity?.camera?.nearness);

// Cuts at the ends of what the picture shows cut nothing.
function depthFields(page) {
  if (!page.opacity) return {};
  const distance = within(1e-3, 1e7);
  return {
    near: within(0, 1e7), far: orNone(distance), fog: orNone(distance),
    ...(hasLens(page) && { focus: orNone(distance), aperture: orNone(distance) }),
  };
}

const turnFields = (page) => (page.opacity?.camera
  ? { turn: numbers(2, -MAX_TURN, MAX_TURN), stereo: choice('off', 'anaglyph', 'pair') } : {});

const turnOpened = (page) => (page.opacity?.camera ? { turn: [0, 0], stereo: 'off' } : {});

// What a look has of cuts, fog and a lens.
function depthInWords(look) {
  if (!look.opacity) return '';
  const { near, far, fog } = look;
  return [(near > 0 || far !== null) && 'cut', fog !== null && 'fog',
    isFocused(look) && `focus ${figures(look.focus)} mm`].filter(Boolean).join(', ');
}

const NO_LENS = { focus: null, aperture: null };

function depthPanel(app) {
  const { page: { opacity } } = app;
  if (!opacity) return () => {};
  byId('depth').hidden = false;
  const [least, most] = opacity.range_mm, depth = most - least;
  const millimetres = (x) => `${figures(x)} mm`;
  const set = (changes) => app.edit((look) => ({ ...look, ...changes }));
  const cuts = { min: least, max: most, step: depth / 200 };
  const rows = [
    depthRow('near', { ...cuts, value: least },
      (x) => set({ near: x > least ? Math.min(x, (app.look().far ?? Infinity) - cuts.step) : 0 }),
      ({ near }) => [Math.max(near, least), near > least ? millimetres(near) : 'off']),
    depthRow('far', { ...cuts, value: most },
      (x) => set({ far: x < most ? Math.max(x, app.look().near + cuts.step) : null }),
      ({ far }) => [far ?? most, far === null ? 'off' : millimetres(far)]),
    depthRow('fog', { min: 0, max: MAX_FOG, step: 0.1, value: 0 },
      (x) => set({ fog: x > 0 ? depth / x : null }),
      ({ fog }) => [fog === null ? 0 : depth / fog, fog === null ? 'off' : millimetres(fog)]),
  ];
  const turn = (i) => (x) => (
    app.put({ turn: app.state.turn.map((old, j) => (j === i ? x : old)) }));
  const degrees = (x) => `${x > 0 ? '+' : x < 0 ? '\u2212' : ''}${Math.abs(x).toFixed(1)}\u00b0`;
  const turns = { min: -MAX_TURN, max: MAX_TURN, step: 0.5, value: 0 };
  const lens = byId('lens');
  byId('lens-rows').hidden = !hasLens(app.page);
  if (hasLens(app.page)) {
    const shown = (look) => isFocused(look) && !app.isStereo;
    rows.push(
      depthRow('focus', { ...cuts, value: least + depth / 2 }, (x) => set({ focus: x }),
        ({ focus }) => [focus ?? least + depth / 2, focus === null ? 'off' : millimetres(focus)],
        shown),
      depthRow('aperture', {
        min: -Math.log2(F_NUMBERS[1]), max: -Math.log2(F_NUMBERS[0]),
        step: Math.log2(F_NUMBERS[1] / F_NUMBERS[0]) / 100,
        value: Math.log2(LENS_OPENING) },
      (x) => set({ aperture: app.look().focus * 2 ** x }),
      (look) => (isFocused(look) ? [Math.log2(openingOf(look) / look.focus),
        `f/${figures(look.focus / openingOf(look), 2)}`] : [Math.log2(LENS_OPENING), '']), shown));
    lens.addEventListener('change', () => set(
      { focus: lens.checked ? byId('focus').valueAsNumber : null, aperture: null }));
  }
  if (opacity.camera) {
    rows.push(...['turn-across', 'turn-down'].map((id, i) => depthRow(id, turns, turn(i),
      () => [app.state.turn[i], degrees(app.state.turn[i])])));
    byId('stereo').addEventListener('change', ({ target }) => app.put({ stereo: target.value }));
  }
  byId('turn-rows').hidden = !opacity.camera;
  const reset = byId('depth-reset');
  reset.addEventListener('click', () => {
    set({ near: 0, far: null, fog: null, ...(hasLens(app.page) && NO_LENS) });
    app.put(turnOpened(app.page));
  });
  return () => {
    const look = app.look(), { stereo = 'off' } = app.state;
    rows.forEach((refresh) => refresh(look, Boolean(app.recomposer)));
    byId('stereo').value = stereo;
    byId('stereo').disabled = !app.recomposer;
    // Both eyes have no lens.
    lens.disabled = !app.recomposer || app.isStereo;
    lens.checked = isFocused(look);
    reset.setAttribute('aria-disabled', !isInDepth(look) && !isFocused(look) && !app.isMoved);
  };
}

// A slider of the HTML; returns the function that shows its value, and if a look has any.
function depthRow(id, range, set, shown, has = () => true) {
  const slider = byId(id), output = slider.closest('.row').querySelector('output');
  const { value, ...limits } = range;
  Object.assign(slider, limits);
  slider.title = 'Double-click or Delete: back to the cast\u2019s';
  slider.addEventListener('input', () => set(slider.valueAsNumber));
  slider.addEventListener('dblclick', () => set(value));
  slider.addEventListener('keydown', (event) => {
    if (!['Delete', 'Backspace'].includes(event.key)) return;
    event.preventDefault();
    set(value);
  });
  return (look, ready) => {
    const [x, words] = shown(look);
    slider.value = x;
    slider.disabled = !ready || !has(look);
    output.textContent = words;
    slider.setAttribute('aria-valuetext', words);
  };
}
