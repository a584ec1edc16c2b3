// Dial: lights on a rim, a knob between them that blends them, and their names around the rim.
//
//     look -> [dial] -> edit
//
// A unit of the drawing is a pixel of the page, so that names are as large as other text.

const DIAL_REACH = 52, DIAL_HALF_HEIGHT = 96;
// Gap between the rim and a name, for the light's dot; height of a line.
const NAME_GAP = 9, NAME_LINE = 15;
// With more lights than the first, names have one line; with more than the second, one is shown.
const MAX_IN_TWO_LINES = 10, MAX_NAMED = 12;
// From this number of lights, names at the top and bottom are moved outwards by this distance.
const CROWDED = 8, FURTHER_OUT = 16;

// Dragging or the arrow keys move the knob between the lights on the rim.
function lightDial(app, colours) {
  const { page } = app, host = byId('dial'), count = page.lights.length;
  const spokes = svg('g', {}), names = svg('g', {});
  const knob = svg('circle', { r: 7, class: 'knob' });
  const rim = dialCorners(count).map(([x, y]) => [x * DIAL_REACH, y * DIAL_REACH]);
  const points = rim.map((p) => p.map((x) => x.toFixed(1)).join(',')).join(' ');
  const drawing = svg('svg', {}, svg('polygon', { points, class: 'rim' }), spokes,
    ...rim.map((at, i) => dotOf(page.lights[i].name, at, colours[i], count)), names, knob);
  host.append(drawing);
  const hovered = dragged(app, host, drawing, rim);
  const named = namesAround(page.lights, rim, host, drawing, names);
  new ResizeObserver(() => app.refresh()).observe(host);
  return (look) => {
    const weights = shining(look), [x, y] = dialPlace(weights).map((v) => v * DIAL_REACH);
    const most = Math.max(...weights, 1e-9), strongest = weights.indexOf(Math.max(...weights));
    spokes.replaceChildren(...rim.map(([cx, cy], i) => svg('line', {
      x1: x, y1: y, x2: cx, y2: cy, class: 'spoke',
      'stroke-opacity': (weights[i] / most).toFixed(2),
    })));
    knob.setAttribute('cx', x);
    knob.setAttribute('cy', y);
    named(hovered() ?? (weights[strongest] > 0 ? strongest : null));
    host.setAttribute('aria-valuemax', count);
    host.setAttribute('aria-valuenow', strongest + 1);
    host.setAttribute('aria-valuetext', namesOf(page, look));
  };
}

// Handle pointers and keys; return a function for the light under the mouse, or null.
function dragged(app, host, drawing, rim) {
  const count = rim.length;
  let hovered = null;
  const moveTo = (x, y) => app.edit((look) => ({
    ...look, solo: -1, weights: blendedWeights(count, x, y) }));
  const within = (event) => {
    const { a, d, e, f } = drawing.getScreenCTM();
    return [(event.clientX - e) / a, (event.clientY - f) / d];
  };
  const drag = (event) => moveTo(...within(event).map((v) => v / DIAL_REACH));
  const hover = (found) => {
    if (found === hovered) return;
    hovered = found;
    app.refresh();
  };
  host.addEventListener('pointerdown', (event) => {
    if (event.button) return;
    host.setPointerCapture(event.pointerId);
    hover(null);
    drag(event);
  });
  host.addEventListener('pointermove', (event) => {
    if (host.hasPointerCapture(event.pointerId)) drag(event);
    else if (event.pointerType === 'mouse') hover(nearestOn(rim, within(event)));
  });
  host.addEventListener('pointerleave', () => hover(null));
  host.addEventListener('keydown', (event) => {
    const way = ARROWS[event.key];
    if (!way) return;
    event.preventDefault();
    const [x, y] = dialPlace(shining(app.look()));
    moveTo(x + 0.08 * way[0], y + 0.08 * way[1]);
  });
  return () => hovered;
}

// The light whose dot is at a point of the drawing, or null.
function nearestOn(rim, [x, y]) {
  const away = rim.map(([cx, cy]) => Math.hypot(cx - x, cy - y)), least = Math.min(...away);
  return least < 12 ? away.indexOf(least) : null;
}

const dotOf = (name, [cx, cy], fill, count) => svg(
  'circle', { cx, cy, r: count > MAX_NAMED ? 4 : 6, fill, class: 'corner' },
  svg('title', {}, name));

// Write the names of all lights, or of a single one if there are too many.
function namesAround(lights, rim, host, drawing, names) {
  const pen = document.createElement('canvas').getContext('2d');
  let written = '';
  return (one) => {
    const width = host.clientWidth, all = lights.length <= MAX_NAMED;
    const named = all ? lights.map((_, i) => i) : [one].filter((i) => i !== null);
    const now = `${width} ${named}`;
    if (!width || now === written) return;
    written = now;
    const out = all && lights.length >= CROWDED ? FURTHER_OUT : 0, half = DIAL_HALF_HEIGHT + out;
    drawing.setAttribute('viewBox', `${-width / 2} ${-half} ${width} ${2 * half}`);
    drawing.setAttribute('height', 2 * half);
    pen.font = getComputedStyle(names).font;
    const wide = (words) => pen.measureText(words).width;
    const most = all && lights.length > MAX_IN_TWO_LINES ? 1 : 2;
    names.replaceChildren(...named.map((i) => {
      const { name } = lights[i], across = Math.abs(rim[i][0]);
      const room = isBeside(rim[i]) ? width / 2 - across - NAME_GAP - 4 : width - 4;
      return nameOf(name, rim[i], inLines(name, room, most, wide), out);
    }));
  };
}

const isBeside = ([x]) => Math.abs(x) > 1;

function nameOf(name, at, lines, out) {
  const [x, y] = at, beside = isBeside(at), tall = lines.length * NAME_LINE;
  const middle = y + (y / DIAL_REACH) * (NAME_GAP + tall / 2 + (beside ? 0 : out));
  const left = beside ? x + Math.sign(x) * (NAME_GAP + 2) : x;
  // The baseline is at 0.75 of the line's height.
  const first = middle - tall / 2 + 0.75 * NAME_LINE;
  const anchor = beside ? (x > 0 ? 'start' : 'end') : 'middle';
  return svg('g', {}, svg('title', {}, name), ...lines.map((line, i) => svg('text', {
    x: left.toFixed(1), y: (first + i * NAME_LINE).toFixed(1), 'text-anchor': anchor,
  }, isolated(line))));
}

// Wrap words into at most a number of lines that fit the width; the rest becomes an ellipsis.
function inLines(words, room, most, wide) {
  let left = words.replace(/[\p{Cc}\s]+/gu, ' ').trim();
  const lines = [];
  while (lines.length < most - 1 && wide(left) > room) {
    const head = fittingHead(left, room, wide), space = head.lastIndexOf(' ');
    const end = left[head.length] === ' ' || space < 1 ? head.length : space;
    lines.push(left.slice(0, end).trim());
    left = left.slice(end).trim();
  }
  if (wide(left) <= room) return [...lines, left];
  return [...lines, `${fittingHead(left, room - wide('\u2026'), wide).trim()}\u2026`];
}

// As many letters as there is room for, but at least one.
function fittingHead(words, room, wide) {
  const letters = [...words.slice(0, 200)];
  while (letters.length > 1 && wide(letters.join('')) > room) letters.pop();
  return letters.join('');
}

// Names of the lights that are on, as text.
function namesOf(page, look) {
  const lit = page.lights.filter((_, i) => shining(look)[i] > 0).map(({ name }) => isolated(name));
  return lit.slice(0, 3).join(' + ') + (lit.length > 3 ? ' + \u2026' : '') || 'no light';
}
