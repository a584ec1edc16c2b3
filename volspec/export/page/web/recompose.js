// Opacities, cuts and fog: the picture recomposed from its layers, one pass per change of them.
//
//     codes of layers, scales, effects -> shaders/recompose.frag -> half floats for relight.frag
//
// Twin of volspec/relight/recompose.py.

// How much of what the layers lack at scale 1 is added: volspec/image/layers.py.
const residualShare = (scales, fades) => (
  Math.sqrt(Math.min(1, ...scales.filter((_, k) => fades[k]))));

const isUnscaled = (scales) => scales.every((scale) => scale === 1);

const isInDepth = ({ near, far, fog }) => near > 0 || far !== null || fog !== null;

const isFocused = ({ focus = null }) => focus !== null;

// True if a look has the cast's opacities, without effects of depth; so has one without layers.
const isAsCast = (look) => (
  !look.opacity || (isUnscaled(look.opacity) && !isInDepth(look) && !isFocused(look)));

// Targets of one draw; every browser has at least four. Units of textures: base, layers.
const MAX_TARGETS = 4, BASE_UNIT = 0, LAYERS_UNIT = 1;
// Farther than any layer; and the light that fog leaves at its visibility.
const FAR_MM = 1e30, LEFT_AT_VISIBILITY = 0.05;

class Recomposer {
  // Throws Refused if the browser cannot draw or hold what is needed.
  constructor(relighter, texels) {
    const { gl, page: { opacity, channels } } = relighter;
    this.relighter = relighter;
    this.texels = texels;
    this.slices = Math.ceil(channels.count / 4);
    this.size = [channels.width, channels.height];
    const depth = opacity.count * opacity.texels;
    if (!this.drawsHalfFloats()) throw new Refused('This browser cannot draw to half floats.');
    if (depth > gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS)) {
      throw new Refused(`This browser has no textures of ${depth} slices.`);
    }
    this.forget();
  }

  // Enable drawing to half floats, which a lost context forgets.
  drawsHalfFloats() {
    const { gl } = this.relighter;
    return ['EXT_color_buffer_float', 'EXT_color_buffer_half_float'].some(
      (name) => gl.getExtension(name));
  }

  // Forget the device's objects after the browser has lost the context.
  forget() {
    this.layers = null;
    // Textures of channels, by the side and eye that they are for, and what they show.
    this.made = new Map();
  }

  // A side's texture of channels; null for the view's own.
  texture(side, look) {
    const { opacity: scales } = look, inDepth = isInDepth(look);
    const { present } = this.relighter.page.opacity;
    if (isUnscaled(scales) && !inDepth) return null;
    return this.kept(`side ${side}`, [scales, this.effects(look)], (texture) => this.draw(
      this.difference, texture, inDepth ? { DEPTH: 1 } : {},
      { ...this.uniforms(look), fade: [inDepth ? 0 : residualShare(scales, present)] }));
  }

  // A texture of channels, drawn again if it is to show something else than before.
  kept(name, shows, draw) {
    if (!this.layers) this.upload();
    if (!this.made.has(name)) this.made.set(name, { texture: this.blank() });
    const own = this.made.get(name), key = JSON.stringify(shows);
    if (own.key !== key) {
      draw(own.texture);
      own.key = key;
    }
    return own.texture;
  }

  blank(slices = this.slices) {
    const { relighter, relighter: { gl } } = this;
    return relighter.array(gl.RGBA16F, [...this.size, slices]);
  }

  // Codes of the layers, and what the view has and they lack at scale 1.
  upload() {
    const { relighter, relighter: { gl, page: { opacity } }, texels, size } = this;
    const depth = opacity.count * opacity.texels;
    this.drawsHalfFloats();
    const layers = relighter.array(gl.RGBA8, [...size, depth], texels);
    this.difference = this.blank();
    [this.target, this.reader] = [gl.createFramebuffer(), gl.createFramebuffer()];
    this.layers = layers;
    const scales = opacity.materials.map(() => 1);
    this.draw(relighter.shown, this.difference, { DIFFERENCE: 1 }, this.uniforms({
      opacity: scales }));
  }

  // Uniforms of shaders/include/opacity.glsl.
  uniforms(look) {
    const { opacity } = this.relighter.page;
    return {
      scales: [...look.opacity, 1, 1, 1].slice(0, 4),
      shade_code: [opacity.shade], gloss_code: [opacity.gloss],
      nearest_mm: [opacity.nearest_mm], slope: [opacity.slope], fog_light: opacity.fog_light,
      ...this.effects(look),
    };
  }

  effects({ near = 0, far = null, fog = null }) {
    const { opacity } = this.relighter.page;
    const perMm = fog === null ? 0 : -Math.log(LEFT_AT_VISIBILITY) / fog;
    return { cut_mm: [near, far ?? FAR_MM], fog: [perMm, opacity.fog_from_mm] };
  }

  draw(base, into, form, uniforms) {
    this.drawInto(into, this.slices, (first, drawn) => {
      const made = this.relighter.program(
        { FIRST_SLICE: first, SLICES_DRAWN: drawn, DIFFERENCE: 0, ...form }, 'recompose.frag');
      this.bind(made, { base });
      this.relighter.pass(made, uniforms);
    });
  }

  // Give a program its textures: the layers, and another one by the name of its sampler.
  bind({ program }, others = {}) {
    const { gl } = this.relighter;
    gl.useProgram(program);
    for (const [name, texture] of Object.entries({ layers: this.layers, ...others })) {
      const unit = name === 'layers' ? LAYERS_UNIT : BASE_UNIT;
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
      gl.uniform1i(gl.getUniformLocation(program, name), unit);
    }
    gl.activeTexture(gl.TEXTURE0 + BASE_UNIT);
  }

  // Draw all slices of a texture, some at once.
  drawInto(texture, slices, draw) {
    const { gl } = this.relighter;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, ...this.size);
    gl.scissor(0, 0, ...this.size);
    for (let first = 0; first < slices; first += MAX_TARGETS) {
      const drawn = Math.min(slices - first, MAX_TARGETS), targets = [];
      for (let i = 0; i < MAX_TARGETS; i++) {
        const place = gl.COLOR_ATTACHMENT0 + i;
        gl.framebufferTextureLayer(
          gl.FRAMEBUFFER, place, i < drawn ? texture : null, 0, i < drawn ? first + i : 0);
        if (i < drawn) targets.push(place);
      }
      gl.drawBuffers(targets);
      draw(first, drawn);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // Channels of a pixel of a texture, as they are drawn; opacity is the last.
  channelsAt(texture, x, y) {
    const { relighter: { gl, page: { channels } }, slices } = this;
    const numbers = new Float32Array(4 * slices);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.reader);
    for (let slice = 0; slice < slices; slice++) {
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, texture, 0, slice);
      gl.readPixels(x, y, 1, 1, gl.RGBA, gl.FLOAT, numbers, 4 * slice);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return [...numbers.slice(0, channels.count)];
  }
}
