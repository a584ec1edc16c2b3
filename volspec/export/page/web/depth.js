// Panel of what depends on depth: cuts and fog, a small turn of the camera, and two eyes.
//
//     sliders -> look.near, far, fog; state.turn, stereo -> [recompose, nearby] -> picture

// The volume's depth over the visibility, at most.
const MOST_FOG = 8;

// Cuts at the ends of what the picture shows cut nothing.
function depthFields(page) {
  if (!page.opacity) return {};
  const distance = within(1e-3, 1e7);
  return { near: within(0, 1e7), far: orNone(distance), fog: orNone(distance) };
}

const turnFields = (page) => (page.opacity?.camera
  ? { turn: numbers(2, -MOST_TURN, MOST_TURN), stereo: choice('off', 'anaglyph', 'pair') } : {});

const turnOpened = (page) => (page.opacity?.camera ? { turn: [0, 0], stereo: 'off' } : {});

function depthPanel(app) {
  const { page: { opacity } } = app;
  if (!opacity) return () => {};
  byId('depth').hidden = false;
  const [least, most] = opacity.range_mm, depth = most - least;
  const millimetres = (x) => `${figures(x)} mm`;
  const set = (changes) => app.edit((look) => ({ ...look, ...changes }));
  const cuts = { min: least, max: most, step: depth / 200 };
  const rows = [
    depthRow('near', { ...cuts, value: least }, (x) => set({ near: x > least ? x : 0 }),
      ({ near }) => [Math.max(near, least), near > least ? millimetres(near) : 'off']),
    depthRow('far', { ...cuts, value: most }, (x) => set({ far: x < most ? x : null }),
      ({ far }) => [far ?? most, far === null ? 'off' : millimetres(far)]),
    depthRow('fog', { min: 0, max: MOST_FOG, step: 0.1, value: 0 },
      (x) => set({ fog: x > 0 ? depth / x : null }),
      ({ fog }) => [fog === null ? 0 : depth / fog, fog === null ? 'off' : millimetres(fog)]),
  ];
  const turn = (i) => (x) => (
    app.put({ turn: app.state.turn.map((old, j) => (j === i ? x : old)) }));
  const degrees = (x) => `${x > 0 ? '+' : x < 0 ? '\u2212' : ''}${Math.abs(x).toFixed(1)}\u00b0`;
  const turns = { min: -MOST_TURN, max: MOST_TURN, step: 0.5, value: 0 };
  if (opacity.camera) {
    rows.push(...['turn-across', 'turn-down'].map((id, i) => depthRow(id, turns, turn(i),
      () => [app.state.turn[i], degrees(app.state.turn[i])])));
    byId('stereo').addEventListener('change', ({ target }) => app.put({ stereo: target.value }));
  }
  byId('turn-rows').hidden = !opacity.camera;
  const reset = byId('depth-reset');
  reset.addEventListener('click', () => {
    set({ near: 0, far: null, fog: null });
    app.put(turnOpened(app.page));
  });
  return () => {
    const look = app.look(), { stereo = 'off' } = app.state;
    rows.forEach((refresh) => refresh(look, Boolean(app.recomposer)));
    byId('stereo').value = stereo;
    byId('stereo').disabled = !app.recomposer;
    reset.setAttribute('aria-disabled', !isInDepth(look) && !app.isMoved);
  };
}

// A slider of the HTML; returns the function that shows its value.
function depthRow(id, range, set, shown) {
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
    slider.disabled = !ready;
    output.textContent = words;
    slider.setAttribute('aria-valuetext', words);
  };
}
