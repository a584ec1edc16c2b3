// In a notebook's cell: settings that the kernel sends are shown, those made here are told.
//
//     volspec/export/notebook/host.js <-> port <-> [widget] <-> state

const TOLD_EVERY_MS = 100;

// What a notebook knows of the state: side A as it shines, and the pixel that is kept.
function toldOf({ sides: [look], probe }) {
  const { mode, backdrop, level, weights, solo, ...viewing } = look;
  // Discounting is D = 1; the state keeps a D of its own for later.
  if (viewing.discount) viewing.D = null;
  return { weights: shining(look), viewing, mode, backdrop, level, probe };
}

// Takes the notebook's theme for the system's, in the page's own styles.
function themed(rules, scheme) {
  if (!scheme) return;
  document.documentElement.style.colorScheme = scheme;
  for (const [rule, wanted] of rules) rule.media.mediaText = wanted === scheme ? 'all' : 'not all';
}

// The styles' rules for a system of one theme, and which.
const themeRules = () => [...document.styleSheets]
  .flatMap(({ cssRules }) => [...cssRules])
  .map((rule) => [rule, rule.media?.mediaText.match(/prefers-color-scheme: (\w+)/)?.[1]])
  .filter(([, wanted]) => wanted);

// Shows what the notebook has changed.
function taken(app, { viewing, weights, probe, _room, scheme, ...settings }) {
  Object.assign(app.page, _room);
  const [look, other] = app.state.sides;
  const lit = weights ? { weights, solo: -1 } : {};
  if (viewing) offerSurround(viewing.surround);
  const sides = [{ ...look, ...viewing, ...lit, ...settings }, other];
  app.put(probe === undefined ? { sides } : { sides, probe });
}

// A ratio that no option stands for gets one.
function offerSurround(ratio) {
  const select = byId('surround');
  if ([...select.options].some(({ value }) => Number(value) === ratio)) return;
  select.append(el('option', { value: ratio }, `ratio ${ratio}`));
}

// Calls at once, and after a rest once more if it was asked for meanwhile.
function atMostEvery(call, milliseconds) {
  let resting = false, asked = false;
  return function ask() {
    asked = true;
    if (resting) return;
    asked = false;
    resting = true;
    call();
    setTimeout(() => {
      resting = false;
      if (asked) ask();
    }, milliseconds);
  };
}

function connected(app, port) {
  // By its name, what the notebook knows of each setting. Nothing is told before it has said how
  // things stand: that would undo them.
  const known = new Map(), rules = themeRules();
  const news = () => Object.entries(toldOf(app.state))
    .filter(([name, value]) => known.get(name) !== JSON.stringify(value));
  const learn = ([name, value]) => known.set(name, JSON.stringify(value));
  const tell = atMostEvery(() => {
    const told = known.size ? news() : [];
    told.forEach(learn);
    if (told.length) port.postMessage(Object.fromEntries(told));
  }, TOLD_EVERY_MS);
  port.onmessage = ({ data }) => {
    themed(rules, data.scheme);
    taken(app, data);
    news().filter(([name]) => name in data).forEach(learn);
  };
  app.panels.push(tell);
}

// Listens to the notebook, where the page stands in a frame that its own host has filled.
function inNotebook(app) {
  if (!location.href.startsWith('about:srcdoc')) return;
  window.addEventListener('message', ({ data, source, ports: [port] }) => {
    if (source !== window.parent || data !== 'volspec' || !port) return;
    // The frame has no address that could be shared.
    byId('share').hidden = true;
    connected(app, port);
  });
}
