// Widget in a notebook's cell: the page in a frame, with settings in both directions.
//
//     traits of widget.py <-> [host] <-> port <-> web/widget.js, inside the frame

const SETTINGS = ['weights', 'viewing', 'mode', 'backdrop', 'level', 'probe', 'opacities', '_room'];

// JupyterLab's theme, light or dark, for the page; elsewhere the system's theme is used.
const scheme = () => ({ true: 'light', false: 'dark' })[document.body.dataset.jpThemeLight];

function frameOf(page) {
  const frame = document.createElement('iframe');
  // Scripts run without the notebook's origin, so that the page cannot reach the notebook.
  frame.sandbox = 'allow-scripts allow-downloads';
  frame.title = 'Relightable picture';
  frame.style.cssText = 'position: absolute; inset: 0; width: 100%; height: 100%; border: 0';
  frame.srcdoc = page;
  return frame;
}

function render({ model, el }) {
  el.style.position = 'relative';
  // Where ipywidgets' Layout, which replaces it, is not applied.
  el.style.height ||= '600px';
  // The visible frame and the newest: the same once the newest is loaded.
  let frame = null, newest = null, port = null, hearing = false;
  // Send only changes: other settings may be older than the page's own.
  const send = (names) => {
    if (hearing) return;
    const settings = Object.fromEntries(names.map((name) => [name, model.get(name)]));
    port?.postMessage({ ...settings, scheme: scheme() });
  };
  const calls = SETTINGS.map((name) => [`change:${name}`, () => send([name])]);

  const hear = ({ data }) => {
    hearing = true;
    for (const [name, value] of Object.entries(data)) model.set(name, value);
    hearing = false;
    model.save_changes();
  };

  // The last page stays until the next one is loaded. A frame that the notebook removes and
  // inserts is loaded again, and receives all settings again.
  const loaded = (next) => {
    port?.close();
    const channel = new MessageChannel();
    port = channel.port1;
    port.onmessage = hear;
    next.contentWindow.postMessage('volspec', '*', [channel.port2]);
    send(SETTINGS);
    if (frame !== next) frame?.remove();
    frame = next;
  };

  const open = () => {
    // A frame that is still loading is outdated, and must not replace this one.
    if (newest !== frame) newest?.remove();
    const next = frameOf(model.get('_page'));
    newest = next;
    next.addEventListener('load', () => loaded(next));
    el.append(next);
  };

  const themed = new MutationObserver(() => send([]));
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
