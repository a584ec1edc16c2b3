// Panel of the materials' opacities: a logarithmic slider for each, from hidden to four times.
//
//     sliders -> look.opacity -> [recompose] -> picture

// Ends of a slider in octaves; 0 is a step to the left of 1/8.
const MIN_OCTAVE = -3, MAX_OCTAVE = 2, OCTAVE_STEP = 0.05;

const scaleAt = (octave) => (octave < MIN_OCTAVE - OCTAVE_STEP / 2 ? 0 : 2 ** octave);

const octaveOf = (scale) => (scale > 0
  ? clamped(Math.log2(scale), MIN_OCTAVE, MAX_OCTAVE) : MIN_OCTAVE - OCTAVE_STEP);

const timesInWords = (scale) => (scale === 0 ? 'hidden' : `\u00d7${figures(scale, 2)}`);

// Names and scales of the materials whose opacity is not the cast's.
function scaledInWords({ opacity }, { opacity: scales }) {
  const changed = (opacity?.materials ?? []).flatMap((name, k) => (
    scales[k] === 1 ? [] : [`${isolated(name)} ${timesInWords(scales[k])}`]));
  return changed.slice(0, 3).join(', ') + (changed.length > 3 ? ', \u2026' : '');
}

function opacityPanel(app) {
  const { page: { opacity } } = app;
  if (!opacity) return () => {};
  byId('opacity').hidden = false;
  const set = (change) => app.edit((look) => ({ ...look, opacity: look.opacity.map(change) }));
  const rows = opacity.materials.map((name, k) => (
    materialRow(name, opacity.present[k], (scale) => set((old, i) => (i === k ? scale : old)))));
  byId('opacity-list').append(...rows.map((row) => row.item));
  const reset = byId('opacity-reset');
  reset.addEventListener('click', () => set(() => 1));
  const colourLater = whenQuiet(() => {
    const { relighter } = app, look = app.look(), light = app.lit(look);
    if (relighter.gl.isContextLost()) return;
    app.swatches ??= new Swatches(relighter, rows.length, materialTexels(app.page));
    const codes = app.swatches.codes(light && drawingOf(app.page, light, look));
    rows.forEach((row, k) => row.colour(`rgb(${codes.slice(4 * k, 4 * k + 3).join(' ')})`));
  }, 60);
  let coloured = null;
  return () => {
    const look = app.look(), { opacity: scales, ...rest } = look;
    rows.forEach((row, k) => row.refresh(scales[k], Boolean(app.recomposer)));
    reset.setAttribute('aria-disabled', isUnscaled(scales));
    const key = JSON.stringify(rest);
    if (key !== coloured) colourLater();
    coloured = key;
  };
}

function materialRow(name, present, set) {
  const named = isolated(name), swatch = el('span', { class: 'swatch', 'aria-hidden': 'true' });
  let shown = 1;
  const slider = el('input', {
    type: 'range', min: MIN_OCTAVE - OCTAVE_STEP, max: MAX_OCTAVE, step: OCTAVE_STEP,
    list: 'opacity-marks',
    'aria-label': `Opacity of ${named}`, title: 'Double-click or Delete: back to the cast\u2019s',
    oninput: () => set(scaleAt(slider.valueAsNumber)),
    ondblclick: () => set(1),
    onkeydown: (event) => {
      if (!['Delete', 'Backspace'].includes(event.key)) return;
      event.preventDefault();
      set(1);
    },
  });
  const toggle = el('button', {
    type: 'button', class: 'material', title: `Show or hide ${named}`,
    onclick: () => set(slider.dataset.scale === '0' ? shown : 0),
  }, swatch, el('span', { class: 'words' }, el('bdi', {}, name),
    present ? '' : el('span', { class: 'quiet' }, 'none in the volume')));
  const output = el('output', { 'aria-hidden': 'true' });
  const item = el('li', {}, toggle, slider, output);
  const refresh = (scale, ready) => {
    if (scale > 0) shown = scale;
    slider.value = octaveOf(scale);
    slider.dataset.scale = scale;
    slider.disabled = toggle.disabled = !(ready && present);
    slider.setAttribute('aria-valuetext', timesInWords(scale));
    output.textContent = timesInWords(scale);
    toggle.setAttribute('aria-pressed', scale > 0);
    item.classList.toggle('off', scale === 0);
  };
  return { item, refresh, colour: (css) => { swatch.style.background = css; } };
}

// Texels of the materials, fully lit, in a row.
function materialTexels({ opacity, channels, groups }) {
  const count = opacity.materials.length;
  const texels = new Uint16Array(4 * count * Math.ceil(channels.count / 4));
  const put = (k, channel, value) => {
    texels[4 * ((channel >> 2) * count + k) + (channel & 3)] = halfOf(value);
  };
  for (let k = 0; k < count; k++) {
    Object.values(groups).forEach((share, g) => put(k, g * (count + 1) + k, share));
    put(k, channels.count - 1, 1);
  }
  return texels;
}

// Colours of a row of texels, drawn by the picture's own shader.
class Swatches {
  constructor(relighter, count, texels) {
    const { gl, page: { channels } } = relighter;
    this.relighter = relighter;
    // The shader finds the topmost row of a picture of its own height.
    this.size = [count, channels.height];
    this.texture = relighter.array(gl.RGBA16F, [count, 1, texels.length / (4 * count)], texels);
    const buffer = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, ...this.size);
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferRenderbuffer(
      gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, buffer);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // RGBA codes; black without light.
  codes(drawing) {
    const { relighter, relighter: { gl }, size: [count, height] } = this;
    const codes = new Uint8Array(4 * count);
    if (drawing) {
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.texture);
      gl.viewport(0, 0, count, height);
      gl.scissor(0, height - 1, count, 1);
      relighter.pass(relighter.program({ ...drawing.form, EVERY: 1 }), drawing.uniforms);
      gl.readPixels(0, height - 1, count, 1, gl.RGBA, gl.UNSIGNED_BYTE, codes);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    }
    return codes;
  }
}
