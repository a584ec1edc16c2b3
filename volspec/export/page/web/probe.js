// Reading of the pixel under the pointer: XYZ, appearance, error and reflected spectrum.
//
// Twin of volspec/viewer/work/probe.py.

function probePanel(app) {
  const card = byId('probe'), rows = byId('probe-rows'), drawing = byId('probe-spectrum');
  const say = whenQuiet(() => {
    byId('probe-status').textContent = app.probe ? inWords(readAt(app)) : '';
  }, 350);
  let shown = '';
  return () => {
    const reading = app.probe && app.texels ? readAt(app) : null;
    card.hidden = !reading;
    // Rows that stay the same are not replaced while they are read out.
    if (!reading || JSON.stringify(reading) === shown) return;
    shown = JSON.stringify(reading);
    rows.replaceChildren(...reading.rows.flatMap(([name, value, minor = false]) => {
      const how = { class: minor && 'minor' };
      return [el('dt', how, name), el('dd', how, value)];
    }));
    const { light, reflected } = reading, box = { width: 200, height: 64, line: light };
    drawing.replaceChildren(reflected ? spectrumBars(app.page.basis, reflected, 1.06, box) : '');
    if (app.spoken) say();
  };
}

const inWords = ({ rows }) => rows.map(([name, value]) => `${name} ${value}`).join('; ');

function readAt(app) {
  const { page, probe: [x, y] } = app, side = app.sideAt((x + 0.5) / page.channels.width);
  const channels = app.channelsAt(side, x, y), alpha = channels.pop();
  const look = app.state.sides[side], lit = app.lit(look);
  const rows = [['Pixel', `${x}, ${y}`, true], ['Opacity', alpha.toFixed(2), true]];
  if (!lit) return { rows };
  const XYZ = sceneXYZ(lit, channels, alpha);
  rows.push(['XYZ', XYZ.map((v) => v.toFixed(1)).join('  ')]);
  const scene = sceneConditions(look, lit.white, lit.lux);
  const found = lookOf(page.constants, XYZ, scene, look.model);
  rows.push(['J C h', found
    ? `${found.J.toFixed(1)}  ${found.C.toFixed(1)}  ${found.h.toFixed(0)}\u00b0`
    : 'not defined here']);
  if (page.basis.kind === 'spectral') {
    rows.push(['\u0394E00', errorOf(page, look)(channels, alpha).toFixed(2)]);
  }
  return { rows, ...spectraAt(page, look, lit, channels, alpha) };
}

// The light and its reflected part, scaled so that the light's peak is 1.
function spectraAt(page, look, lit, channels, alpha) {
  const parts = rigOf(page.lights, shining(look)), top = Math.max(...lit.power, 1e-12);
  const back = lit.power.map((E) => (1 - alpha) * look.backdrop * E);
  const size = page.basis.synthesis[0].length;
  Object.keys(page.groups).forEach((group, i) => {
    const own = shinesFrom(parts, group);
    if (!own) return;
    const E = mixedPower(own), layer = channels.slice(i * size, (i + 1) * size);
    applied(leavingLight(page.basis, E), layer).forEach((s, k) => { back[k] += s; });
  });
  const seen = filtered(page.basis, back);
  return {
    light: lit.power.map((E) => E / top), reflected: seen.map((v) => Math.max(v, 0) / top) };
}
