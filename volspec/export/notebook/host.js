// A cell's side of the widget: the page in a frame of its own, and settings carried both ways.
//
//     traits of widget.py <-> [host] <-> port <-> web/widget.js, inside the frame

const SETTINGS = ['weights', 'viewing', 'mode', 'backdrop', 'level', 'probe', '_room'];

// JupyterLab's theme, light or dark, which the page takes; elsewhere the system's counts.
const scheme = () => ({ true: 'light', false: 'dark' })[document.body.dataset.jpThemeLight];

function frameOf(page) {
  const frame = document.createElement('iframe');
  // Scripts without the notebook's own origin: nothing of the page reaches the notebook.
  frame.sandbox = 'allow-scripts allow-downloads';
  frame.title = 'Relightable picture';
  frame.style.cssText = 'position: absolute; inset: 0; width: 100%; height: 100%; border: 0';
  frame.srcdoc = page;
  return frame;
}

function render({ model, el }) {
  el.style.position = 'relative';
  // The frame that is shown, and the last one made: the same once that is loaded.
  let frame = null, newest = null, port = null, hearing = false;
  // Only what has changed: the rest may be older than what the page is just telling.
  const tell = (names) => {
    if (hearing) return;
    const settings = Object.fromEntries(names.map((name) => [name, model.get(name)]));
    port?.postMessage({ ...settings, scheme: scheme() });
  };
  const calls = SETTINGS.map((name) => [`change:${name}`, () => tell([name])]);

  const hear = ({ data }) => {
    hearing = true;
    for (const [name, value] of Object.entries(data)) model.set(name, value);
    hearing = false;
    model.save_changes();
  };

  // The page before stays until the next one is there. A frame that the notebook has taken out
  // and put back loads anew, and is told everything again.
  const loaded = (next) => {
    port?.close();
    const channel = new MessageChannel();
    port = channel.port1;
    port.onmessage = hear;
    next.contentWindow.postMessage('volspec', '*', [channel.port2]);
    tell(SETTINGS);
    if (frame !== next) frame?.remove();
    frame = next;
  };

  const open = () => {
    // One that still loads is out of date, and must not come after this one.
    if (newest !== frame) newest?.remove();
    const next = frameOf(model.get('_page'));
    newest = next;
    next.addEventListener('load', () => loaded(next));
    el.append(next);
  };

  const themed = new MutationObserver(() => tell([]));
  themed.observe(document.body, { attributeFilter: ['data-jp-theme-light'] });
  model.on('change:_page', open);
  for (const [event, call] of calls) model.on(event, call);
  open();
  return () => {
    themed.disconnect();
    model.off('change:_page', open);
    for (const [event, call] of calls) model.off(event, call);
    port?.close();
  };
}

export default { render };
