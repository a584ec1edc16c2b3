// Overlay of the picture's errors: CIEDE2000 from full bands, or from the exact light matrix.
//
// Twin of volspec/relight/difference_maps.py; computed when the user pauses.

// Approximate number of sampled pixels: finer than needed for a map.
const LOOKED_AT = 60000, COVERED = 0.05, HEAT_ALPHA = 230;
// The scale ends at one of these; smaller errors are invisible rounding of the page's channels.
const TOPS = [0.5, 1, 2, 5, 10, 20, 50, 100];

function errorsPanel(app) {
  const canvas = byId('heat');
  const update = whenQuiet(() => app.state.errors && app.texels && drawHeat(app, canvas), 120);
  return () => {
    const on = app.state.errors;
    byId('errors').checked = on;
    byId('heat-legend').hidden = !on;
    canvas.hidden = !on;
    if (on) update();
  };
}

// CIEDE2000 between a look's colours and the reference, as a function of channels and opacity.
function errorOf(page, look) {
  const plain = { ...look, exposure: 1, level: 'relative' };
  const parts = rigOf(page.lights, shining(look));
  if (!parts) return null;
  const { basis, groups } = page, full = { ...basis, synthesis: basis.full ?? basis.synthesis };
  const shown = illuminationOf(basis, groups, parts, plain);
  const exact = illuminationOf(full, groups, parts, { ...plain, mode: 'exact' });
  if (!shown) return null;
  const white = exact.white.map((x) => Math.max(x, NO_COLOUR * exact.white[1]));
  return (channels, alpha) => {
    const Lab = (light) => cielabOf(sceneXYZ(light, channels, alpha), white);
    return deltaE2000(Lab(exact), Lab(shown));
  };
}

const reference = (page) => (page.basis.full ? 'full bands' : 'the exact light matrix');

function drawHeat(app, canvas) {
  const { page, texels, state } = app, { width, height } = page.channels;
  const every = Math.max(1, Math.round(Math.sqrt(width * height / LOOKED_AT)));
  canvas.width = Math.ceil(width / every);
  canvas.height = Math.ceil(height / every);
  const found = [], covered = [], alphas = [];
  const sides = state.sides.map((look) => errorOf(page, look));
  for (let y = 0; y < canvas.height; y++) {
    for (let x = 0; x < canvas.width; x++) {
      const channels = channelsAt(texels, page.channels, x * every, y * every);
      const alpha = channels.pop();
      const error = sides[app.sideAt(x * every / width)];
      const delta = alpha > 0 && error ? error(channels, alpha) : 0;
      found.push(delta);
      alphas.push(alpha);
      if (alpha > COVERED) covered.push(delta);
    }
  }
  covered.sort((a, b) => a - b);
  const at = (fraction) => covered[Math.round(fraction * (covered.length - 1))] ?? 0;
  const top = TOPS.find((each) => each >= at(0.995)) ?? 100;
  paintHeat(canvas, found, alphas, top, page.heat);
  const mean = covered.reduce((a, b) => a + b, 0) / Math.max(covered.length, 1);
  byId('heat-top').textContent = top;
  byId('heat-figures').textContent = at(1) === 0
    ? `No difference from ${reference(page)}.`
    : `\u0394E00 mean ${figures(mean)}, 95 % ${figures(at(0.95))}, max ${figures(at(1))} from ${reference(page)}`;
}

function paintHeat(canvas, found, alphas, top, heat) {
  const context = canvas.getContext('2d');
  const picture = context.createImageData(canvas.width, canvas.height);
  found.forEach((delta, i) => {
    // Half of the colours are for the first quarter, where most errors are.
    const colour = heat[Math.round(Math.sqrt(Math.min(delta / top, 1)) * (heat.length - 1))];
    picture.data.set([...colour, alphas[i] > 0 ? HEAT_ALPHA : 0], 4 * i);
  });
  context.putImageData(picture, 0, 0);
}

function fillHeatScale(page) {
  const stops = page.heat.filter((_, i) => i % 8 === 0 || i === page.heat.length - 1)
    .map((rgb) => `rgb(${rgb.join(' ')})`);
  byId('heat-scale').style.background = `linear-gradient(90deg, ${stops.join(', ')})`;
}
