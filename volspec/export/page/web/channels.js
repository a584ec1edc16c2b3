// Unpack a view's channels: from text in the page, or a server's bytes, to texels for the shader.
//
//     base64 -> deflate -> residuals -> codes -> half floats, four channels to a layer
//
// Inverse of `pack_view` and `residual_bytes` in volspec/export/page/packing.py.

function bytesOf(base64) {
  const text = atob(base64.trim()), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const singles = new Float32Array(1), bitsOfSingle = new Uint32Array(singles.buffer);

// Bits of the nearest half float; underflow becomes 0, overflow the largest number.
function halfOf(x) {
  singles[0] = clamped(x, -65504, 65504);
  const bits = bitsOfSingle[0], sign = (bits >>> 16) & 0x8000;
  const exponent = ((bits >>> 23) & 0xff) - 112, mantissa = bits & 0x7fffff;
  if (exponent <= 0) {
    if (exponent < -10) return sign;
    return sign | Math.round((mantissa | 0x800000) / 2 ** (14 - exponent));
  }
  return sign | Math.min((exponent << 10) + Math.round(mantissa / 8192), 0x7bff);
}

function fromHalf(bits) {
  const exponent = (bits >> 10) & 31, mantissa = bits & 1023, sign = bits & 0x8000 ? -1 : 1;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + mantissa / 1024) : mantissa / 2 ** 24);
}

// Half floats by code: values are signed squares of evenly spaced roots.
function halvesByCode(low, high, bits) {
  const last = 2 ** bits - 1;
  return Uint16Array.from({ length: last + 1 }, (_, code) => {
    const root = low + code * (high - low) / last;
    return halfOf(Math.sign(root) * root * root);
  });
}

// Add residuals to a plane's predictions from neighbours; leave differences of codes in `plane`.
function unpredicted(residuals, plane, before, width, mask) {
  for (let at = 0, x = 0; at < plane.length; at++, x = x + 1 === width ? 0 : x + 1) {
    // At the edges the only neighbour counts for all.
    let north = at < width ? 0 : plane[at - width], west = north, corner = north;
    if (x > 0) {
      west = plane[at - 1];
      if (at < width) north = corner = west; else corner = plane[at - width - 1];
    }
    const high = west > north ? west : north, low = west > north ? north : west;
    const guess = corner >= high ? low : corner <= low ? high : west + north - corner;
    const code = (before[at] + guess + residuals[at]) & mask;
    plane[at] = code - before[at];
    before[at] = code;
  }
}

// A plane's residuals; above 8 bits, the high bytes come before the low bytes.
function residualsOf(bytes, start, pixels, wide) {
  if (!wide) return bytes.subarray(start, start + pixels);
  const low = start + pixels;
  return Uint16Array.from(
    { length: pixels }, (_, at) => (bytes[start + at] << 8) | bytes[low + at]);
}

// Samples along one side of an enlarged picture: the index before each pixel, and the weight of the
// next one. Both pictures have the same centre, and heights of the same length in the world.
function sampling(size, stored, scale) {
  const first = new Int32Array(size), weight = new Float32Array(size);
  for (let i = 0; i < size; i++) {
    const at = clamped((i - (size - 1) / 2) * scale + (stored - 1) / 2, 0, stored - 1);
    first[i] = Math.min(Math.floor(at), Math.max(stored - 2, 0));
    weight[i] = at - first[i];
  }
  return { first, weight };
}

// Interpolate a coarse plane's codes; these are roots, of which edges have no dark fringe.
function enlarged(codes, view, { width, height }) {
  if (view.width === width && view.height === height) return codes;
  const scale = view.height / height, made = new Int32Array(width * height);
  const across = sampling(width, view.width, scale), down = sampling(height, view.height, scale);
  const right = view.width > 1 ? 1 : 0, below = view.height > 1 ? view.width : 0;
  for (let y = 0, to = 0; y < height; y++) {
    const row = down.first[y] * view.width, v = down.weight[y];
    for (let x = 0; x < width; x++, to++) {
      const at = row + across.first[x], u = across.weight[x];
      const upper = codes[at] + u * (codes[at + right] - codes[at]);
      const lower = codes[at + below] + u * (codes[at + below + right] - codes[at + below]);
      made[to] = Math.round(upper + v * (lower - upper));
    }
  }
  return made;
}

// Half floats as Uint16, layer by layer of RGBA texels, as texSubImage3D takes them; of the page's
// size, also if the view is coarser.
async function texelsOf(deflated, view, channels) {
  const bytes = await inflated(deflated), { count, bits } = channels;
  const stored = view.width * view.height, pixels = channels.width * channels.height;
  const layers = Math.ceil(count / 4), wide = bits > 8;
  if (bytes.length !== stored * count * (wide ? 2 : 1)) throw new Error('the channels are cut off');
  const texels = new Uint16Array(layers * pixels * 4);
  const codes = new Int32Array(stored), plane = new Int32Array(stored);
  for (let channel = 0; channel < count; channel++) {
    const start = channel * stored * (wide ? 2 : 1);
    unpredicted(residualsOf(bytes, start, stored, wide), plane, codes, view.width, 2 ** bits - 1);
    const halves = halvesByCode(view.low[channel], view.high[channel], bits);
    const offset = (channel >> 2) * pixels * 4 + (channel & 3);
    const full = enlarged(codes, view, channels);
    for (let at = 0; at < pixels; at++) texels[offset + 4 * at] = halves[full[at]];
  }
  return texels;
}

// Codes of layers of opacity as shaders/recompose.frag reads them: RGBA texels, slice by slice.
//
// Inverse of `pack_layers` in volspec/export/page/packing.py: a plane is each number in each layer.
async function layersOf(deflated, { count, slots, texels: each }, { width, height }) {
  const bytes = await inflated(deflated), pixels = width * height, planes = count * slots.length;
  if (bytes.length !== pixels * planes) throw new Error('the layers are cut off');
  const texels = new Uint8Array(4 * pixels * count * each);
  const codes = new Int32Array(pixels), plane = new Int32Array(pixels);
  for (let i = 0; i < planes; i++) {
    const slot = slots[Math.floor(i / count)], slice = (i % count) * each + (slot >> 2);
    codes.fill(0);
    unpredicted(residualsOf(bytes, i * pixels, pixels, false), plane, codes, width, 255);
    const offset = 4 * pixels * slice + (slot & 3);
    for (let at = 0; at < pixels; at++) texels[offset + 4 * at] = codes[at];
    // The page stays responsive.
    if (i % count === 0) await new Promise((done) => { setTimeout(done); });
  }
  return texels;
}

// The channels of a pixel; opacity is the last.
function channelsAt(texels, { width, height, count }, x, y) {
  const pixels = width * height, at = 4 * (y * width + x);
  return Array.from({ length: count }, (_, channel) => (
    fromHalf(texels[(channel >> 2) * pixels * 4 + at + (channel & 3)])));
}
