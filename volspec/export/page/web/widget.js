// In a notebook's cell: show settings from the kernel, and send it the changes made here.
//
//     volspec/export/notebook/host.js <-> port <-> [widget] <-> state

const TOLD_EVERY_MS = 100;

const named = (names, values) => Object.fromEntries(names.map((name, i) => [name, values[i]]));

// State shared with a notebook: side A and the pinned pixel.
function changesOf({ page: { opacity: layers }, state: { sides: [look], probe } }) {
  const { mode, backdrop, level, weights, solo, opacity, ...seen } = look;
  // What depends on depth is the page's alone.
  const { near, far, fog, focus, aperture, ...viewing } = seen;
  // Discounting means D = 1; the page's state keeps its own D for later.
  if (viewing.discount) viewing.D = null;
  const opacities = layers && { opacities: named(layers.materials, opacity) };
  return { weights: shining(look), viewing, mode, backdrop, level, probe, ...opacities };
}

// Use the notebook's theme instead of the system's in the page's styles.
function themed(rules, scheme) {
  if (!scheme) return;
  document.documentElement.style.colorScheme = scheme;
  for (const [rule, wanted] of rules) rule.media.mediaText = wanted === scheme ? 'all' : 'not all';
}

// Rules of the styles that depend on the system's theme, each with that theme.
const themeRules = () => [...document.styleSheets]
  .flatMap(({ cssRules }) => [...cssRules])
  .map((rule) => [rule, rule.media?.mediaText.match(/prefers-color-scheme: (\w+)/)?.[1]])
  .filter(([, wanted]) => wanted);

// Apply the notebook's changes.
function taken(app, { viewing, weights, probe, opacities, _room, scheme, ...settings }) {
  Object.assign(app.page, _room);
  const [look, other] = app.state.sides;
  const lit = weights ? { weights, solo: -1 } : {};
  if (viewing) offerSurround(viewing.surround);
  const scaled = opacities && app.page.opacity
    ? { opacity: app.page.opacity.materials.map((name) => opacities[name] ?? 1) } : {};
  const sides = [{ ...look, ...viewing, ...lit, ...scaled, ...settings }, other];
  app.put(probe === undefined ? { sides } : { sides, probe });
}

// Add an option for a ratio that has none.
function offerSurround(ratio) {
  const select = byId('surround');
  if ([...select.options].some(({ value }) => Number(value) === ratio)) return;
  select.append(el('option', { value: ratio }, `ratio ${ratio}`));
}

// Throttle: call at once, and again after a pause if requested in the meantime.
function atMostEvery(call, milliseconds) {
  let resting = false, requested = false;
  return function ask() {
    requested = true;
    if (resting) return;
    requested = false;
    resting = true;
    call();
    setTimeout(() => {
      resting = false;
      if (requested) ask();
    }, milliseconds);
  };
}

function connected(app, port) {
  // The notebook's value of each setting, by name. Nothing is sent until the notebook has sent its
  // settings, which would otherwise be overwritten.
  const known = new Map(), rules = themeRules();
  const news = () => Object.entries(changesOf(app))
    .filter(([name, value]) => known.get(name) !== JSON.stringify(value));
  const learn = ([name, value]) => known.set(name, JSON.stringify(value));
  const send = atMostEvery(() => {
    const changes = known.size ? news() : [];
    changes.forEach(learn);
    if (changes.length) port.postMessage(Object.fromEntries(changes));
  }, TOLD_EVERY_MS);
  port.onmessage = ({ data }) => {
    themed(rules, data.scheme);
    taken(app, data);
    news().filter(([name]) => name in data).forEach(learn);
  };
  app.panels.push(send);
}

// Listen to the notebook if the page is in a frame made by host.js.
function inNotebook(app) {
  if (!location.href.startsWith('about:srcdoc')) return;
  window.addEventListener('message', ({ data, source, ports: [port] }) => {
    if (source !== window.parent || data !== 'volspec' || !port) return;
    // The frame has no address to share.
    byId('share').hidden = true;
    connected(app, port);
  });
}
