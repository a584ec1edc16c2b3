// Bars of the colours that the fields' values have under the light, with numbers, below the picture.
//
//     channels of values -> Swatches -> canvas
//
// Twin of volspec/export/value_bars.py, whose numbers are in the page.

function valuesPanel(app) {
  const { page, page: { values } } = app;
  if (!values) return () => {};
  const count = values.width / values.bars.length, bars = values.bars.map((bar) => valueBar(bar, count));
  filled(byId('values'), {}, bars.map((bar) => bar.item)).hidden = false;
  const { width, height, bits } = values, channels = { ...page.channels, width, height, bits };
  let texels = null, coloured = null;
  const colourLater = whenQuiet(() => {
    const { relighter, state: { compare, sides } } = app;
    if (relighter.gl.isContextLost()) return;
    app.bars ??= new Swatches(relighter, width, texels);
    const shown = sides.slice(0, compare ? 2 : 1).map((look) => {
      const light = app.lit(look), codes = app.bars.codes(light && drawingOf(page, light, look));
      // What is transparent at a value has no colour.
      for (let x = 0; x < width; x++) codes[4 * x + 3] = 255 * channelsAt(texels, channels, x, 0).at(-1);
      return codes;
    });
    bars.forEach((bar, i) => bar.colour(
      shown.map((codes) => codes.subarray(4 * i * count, 4 * (i + 1) * count))));
  }, 60);
  texelsOf(bytesOf(values.text), values, channels).then((made) => { texels = made; app.refresh(); });
  return () => {
    const { compare, sides } = app.state, key = JSON.stringify([compare, sides]);
    if (texels && key !== coloured) colourLater();
    if (texels) coloured = key;
  };
}

// A bar of a field; two sides' colours are one above the other.
function valueBar({ title, ends, ticks }, count) {
  const canvas = el('canvas', { role: 'img', width: count, height: 1 });
  const numbers = ticks.map(([at, number]) => {
    const label = el('span', {}, number);
    label.style.left = `${100 * at}%`;
    return label;
  });
  const caption = el('figcaption', { title }, el('bdi', {}, title), el('span'));
  const row = el('div', { class: 'ticks', 'aria-hidden': 'true' }, ...numbers);
  // Numbers that would touch are left out.
  new ResizeObserver(() => {
    let free = -Infinity;
    for (const label of numbers) {
      const { left, right } = label.getBoundingClientRect();
      label.style.visibility = left > free ? '' : 'hidden';
      if (left > free) free = right + 4;
    }
  }).observe(row);
  const colour = (sides) => {
    canvas.height = sides.length;
    const words = sides.length > 1 ? 'A above B' : '';
    caption.lastChild.textContent = title && words ? ` \u00b7 ${words}` : words;
    canvas.setAttribute('aria-label', [`Colours of the values ${ends.join(' to ')}`,
      isolated(title), words].filter(Boolean).join(', '));
    sides.forEach((codes, y) => canvas.getContext('2d').putImageData(
      new ImageData(new Uint8ClampedArray(codes), count, 1), 0, y));
  };
  return { item: el('figure', {}, caption, canvas, row), colour };
}
