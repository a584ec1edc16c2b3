// Drawings of spectra: bars in the colours of their wavelengths, a line for the light.

// Bars of `values` up to `top`, in a width x height box that stretches to the space it gets.
function spectrumBars(basis, values, top, { width, height, line = null }) {
  const step = width / values.length, at = (x) => clamped(x / top, 0, 1) * height;
  const bars = values.map((value, i) => svg('rect', {
    x: (i * step).toFixed(2), y: (height - at(value)).toFixed(2), width: (step + 0.15).toFixed(2),
    height: at(value).toFixed(2), fill: basis.colours[i],
  }));
  const drawing = svg('svg', {
    viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: 'none', 'aria-hidden': 'true',
  }, ...bars);
  if (line) {
    const points = line.map((value, i) => (
      [(i + 0.5) * step, height - at(value)].map((x) => x.toFixed(2)).join(',')));
    drawing.append(svg('polyline', {
      points: points.join(' '), fill: 'none', class: 'curve',
      'vector-effect': 'non-scaling-stroke',
    }));
  }
  return drawing;
}

// Colour of a light relative to the display's white, as bright as possible.
function lightColour(page, white) {
  const rgb = applied(page.constants.RGB_FROM_XYZ, white).map((x) => Math.max(x, 0));
  const most = Math.max(...rgb);
  const codes = rgb.map((x) => {
    const level = x / most;
    const code = level <= 0.0031308 ? 12.92 * level : 1.055 * level ** (1 / 2.4) - 0.055;
    return Math.round(255 * code);
  });
  return `rgb(${codes.join(' ')})`;
}

const wavelengthsInWords = ({ wavelengths_nm: at }) => (
  [at[0], at[at.length - 1]].map((x) => `${x} nm`));
