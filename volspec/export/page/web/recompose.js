// Opacities: the picture recomposed from its layers, one pass per change of scales.
//
//     codes of layers, scales -> shaders/recompose.frag -> half floats that relight.frag reads
//
// Twin of volspec/relight/recompose.py.

// How much of what the layers lack at scale 1 is added: volspec/raycast/layered.py.
function residualShare(scales) {
  if (Math.min(...scales) <= 0) return 0;
  return Math.max(0, 1 - Math.max(...scales.map((scale) => Math.abs(Math.log2(scale)))) / 2);
}

const isUnscaled = (scales) => scales.every((scale) => scale === 1);

// Targets of one draw; every browser has at least four. Units of textures: base, layers.
const MOST_TARGETS = 4, BASE_UNIT = 0, LAYERS_UNIT = 1;

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
    // Of each side: scales, and the texture that shows them.
    this.sides = [];
  }

  // A side's texture of channels at some scales; null for the view's own.
  texture(side, scales) {
    if (isUnscaled(scales)) return null;
    if (!this.layers) this.upload();
    this.sides[side] ??= { texture: this.blank(), scales: null };
    const own = this.sides[side], key = scales.join();
    if (own.scales !== key) {
      this.draw(this.difference, own.texture, scales, false);
      own.scales = key;
    }
    return own.texture;
  }

  blank() {
    const { relighter, relighter: { gl } } = this;
    return relighter.array(gl.RGBA16F, [...this.size, this.slices]);
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
    this.draw(relighter.shown, this.difference, opacity.materials.map(() => 1), true);
  }

  draw(base, into, scales, difference) {
    const { relighter, relighter: { gl, page: { opacity } }, slices } = this;
    gl.activeTexture(gl.TEXTURE0 + LAYERS_UNIT);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.layers);
    gl.activeTexture(gl.TEXTURE0 + BASE_UNIT);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, base);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, ...this.size);
    gl.scissor(0, 0, ...this.size);
    const uniforms = {
      scales: [...scales, 1, 1, 1].slice(0, 4), fade: [residualShare(scales)],
      shade_code: [opacity.shade], gloss_code: [opacity.gloss],
    };
    for (let first = 0; first < slices; first += MOST_TARGETS) {
      const drawn = Math.min(slices - first, MOST_TARGETS), targets = [];
      for (let i = 0; i < MOST_TARGETS; i++) {
        const place = gl.COLOR_ATTACHMENT0 + i;
        gl.framebufferTextureLayer(
          gl.FRAMEBUFFER, place, i < drawn ? into : null, 0, i < drawn ? first + i : 0);
        if (i < drawn) targets.push(place);
      }
      gl.drawBuffers(targets);
      const made = relighter.program({
        FIRST_SLICE: first, SLICES_DRAWN: drawn, DIFFERENCE: difference ? 1 : 0 }, 'recompose');
      gl.useProgram(made.program);
      gl.uniform1i(gl.getUniformLocation(made.program, 'layers'), LAYERS_UNIT);
      gl.uniform1i(gl.getUniformLocation(made.program, 'base'), BASE_UNIT);
      relighter.pass(made, uniforms);
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
