// Make and fill elements. Text is inserted as text, never as markup.

const SVG = 'http://www.w3.org/2000/svg';

function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, '');
    else if (value !== null && value !== false) node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

const el = (tag, attributes = {}, ...children) => (
  filled(document.createElement(tag), attributes, children));

const svg = (tag, attributes = {}, ...children) => (
  filled(document.createElementNS(SVG, tag), attributes, children));

const byId = (id) => document.getElementById(id);

// Isolate a user's text, so that its direction marks do not affect the text around it. Isolates
// within it are removed, as they could close this one early.
const isolated = (words) => `\u2068${words.replace(/[\u2066-\u2069]/g, '')}\u2069`;

// Readable numbers: three digits, without an exponent if possible.
function figures(x, digits = 3) {
  if (x === 0) return '0';
  const size = Math.floor(Math.log10(Math.abs(x)));
  if (size < -4 || size > 6) return x.toExponential(digits - 1);
  return x.toFixed(clamped(digits - 1 - size, 0, 6));
}

// Directions of the arrow keys: across, down.
const ARROWS = {
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1],
};

// Call a function once before the next frame, however often it is requested until then.
function perFrame(call) {
  let requested = false;
  return () => {
    if (requested) return;
    requested = true;
    requestAnimationFrame(() => { requested = false; call(); });
  };
}

// Debounce: call a function when it has not been requested for a while.
function whenQuiet(call, milliseconds) {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(call, milliseconds);
  };
}
