// The picture on WebGL 2: the desktop's shaders/relight.frag, one pass per light change.
//
//     illumination, transform -> uniforms -> [relight] -> canvas
//
// Twin of volspec/relight/programs.py; each view has a half-float texture of channels.

// Bytes of decoded views that are kept; others are decoded again when needed.
const KEPT_BYTES = 256e6;

class Refused extends Error {}

// Data for drawing one side of the picture: uniforms by GLSL name, and compile-time definitions.
function drawingOf(page, light, look) {
  const k = page.constants, channels = page.channels.count - 1;
  const transform = viewTransform(k, look, light.white, light.lux, page.display);
  const columns = transposed(light.matrix);
  columns[channels] = light.backdrop.map((x) => -x);
  while (columns.length % 4) columns.push([0, 0, 0]);
  const first = transform.form === 'LINEAR' ? transform.matrix : identity();
  const uniforms = {
    XYZ_from_layer: columns.flatMap((column) => applied(first, column)),
    backdrop_XYZ: applied(first, light.backdrop),
  };
  const form = {
    FORM: transform.form, SAME_SURROUND: 0, OUTER: 0, PROPORTIONAL: 0, FIELD: 0, CHECKED: 0,
  };
  if (transform.form !== 'LINEAR') {
    uniforms['view_transform.response_from_XYZ'] = transposed(transform.response_from_XYZ).flat();
    uniforms['view_transform.linear_from_response'] = transposed(
      product(k.RGB_FROM_XYZ, transform.XYZ_from_response)).flat();
  }
  let names = [];
  if (transform.form === 'CURVE') {
    form.OUTER = transform.outer.some((x) => x !== 1) ? 1 : 0;
    names = ['gain', 'power', 'shift', 'offset', ...(form.OUTER ? ['outer'] : [])];
  } else if (transform.form === 'CAM') {
    const near = (x) => Math.abs(x - 1) < 1e-7;
    form.PROPORTIONAL = transform.proportional ? 1 : 0;
    form.SAME_SURROUND = near(transform.lightness_power) && near(transform.chroma_gain) ? 1 : 0;
    names = ['scene_achromatic', 'display_achromatic'];
    if (!form.SAME_SURROUND) names.push('lightness_power', 'chroma_gain');
  }
  for (const name of names) uniforms[`view_transform.${name}`] = [transform[name]].flat();
  const gamut = look.gamut === 'reduce' && page.gamut[gamutModel(look.model)];
  if (gamut) Object.assign(uniforms, gamut);
  const simulate = look.deficiency !== 'none' && look.severity > 0;
  if (simulate) {
    Object.assign(uniforms, simulationOf(page.deficiencies[look.deficiency], look.severity));
  }
  const ends = { REDUCE: gamut ? 1 : 0, MARK: look.mark ? 1 : 0, SIMULATE: simulate ? 1 : 0 };
  return { uniforms, form: { ...form, ...ends } };
}

// Uniforms of a colour-vision deficiency: linear between equal steps of severity.
function simulationOf({ above, below, plane }, severity) {
  const place = severity * (above.length - 1), low = Math.min(Math.floor(place), above.length - 2);
  const at = (maps) => transposed(maps[low].map((row, i) => row.map(
    (x, j) => x + (place - low) * (maps[low + 1][i][j] - x)))).flat();
  return {
    'deficiency.above': at(above), 'deficiency.below': at(below), 'deficiency.plane': plane };
}

class Relighter {
  constructor(canvas, page) {
    this.canvas = canvas;
    this.page = page;
    this.programs = new Map();
    this.textures = new Map();
    // The texture of the view that is shown.
    this.shown = null;
    // The canvas is shown as large as the picture, even if fewer pixels are drawn.
    canvas.style.width = `${page.channels.width}px`;
    canvas.style.height = `${page.channels.height}px`;
    this.resize(1);
    const options = { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: false };
    this.gl = canvas.getContext('webgl2', options);
    if (!this.gl) {
      throw new Refused('This browser has no WebGL 2, so the light cannot be changed here.');
    }
    this.requireRoom();
    this.gl.enable(this.gl.SCISSOR_TEST);
  }

  // Refuse what does not fit before the driver fails.
  requireRoom() {
    const { gl, page: { channels } } = this, layers = Math.ceil(channels.count / 4);
    const side = Math.max(channels.width, channels.height);
    const most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    if (side > most) {
      throw new Refused(`The picture is ${side} pixels long; this browser draws up to ${most}.`);
    }
    const room = Math.min(
      gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS),
      Math.floor((gl.getParameter(gl.MAX_FRAGMENT_UNIFORM_VECTORS) - 16) / 4));
    if (layers > room) {
      throw new Refused(
        `The picture has ${channels.count} channels; this browser draws up to ${4 * room}.`);
    }
  }

  // Program for compile-time definitions; the `#define` lines follow the `#version` line.
  program(form, fragment = 'fragment', vertex = 'vertex') {
    const { gl, page: { shader } } = this;
    const lines = Object.entries(form)
      .map(([name, value]) => `#define ${name} ${value}\n`).join('');
    const key = fragment + lines;
    if (!this.programs.has(key)) {
      const program = gl.createProgram();
      for (const [name, kind] of [[vertex, gl.VERTEX_SHADER], [fragment, gl.FRAGMENT_SHADER]]) {
        const text = shader[name], end = text.indexOf('\n') + 1;
        const part = gl.createShader(kind);
        gl.shaderSource(part, text.slice(0, end) + lines + text.slice(end));
        gl.compileShader(part);
        gl.attachShader(program, part);
        if (!gl.getShaderParameter(part, gl.COMPILE_STATUS) && !gl.isContextLost()) {
          throw new Refused(`This browser refuses the shader: ${gl.getShaderInfoLog(part)}`);
        }
      }
      gl.linkProgram(program);
      if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
        throw new Refused(`This browser refuses the shader: ${gl.getProgramInfoLog(program)}`);
      }
      this.programs.set(key, { program, setters: this.settersOf(program) });
    }
    return this.programs.get(key);
  }

  // Setters of a program's uniforms, by name.
  settersOf(program) {
    const { gl } = this, setters = new Map();
    const calls = {
      [gl.FLOAT]: (at, v) => gl.uniform1fv(at, v), [gl.FLOAT_VEC2]: (at, v) => gl.uniform2fv(at, v),
      [gl.FLOAT_VEC3]: (at, v) => gl.uniform3fv(at, v),
      [gl.FLOAT_VEC4]: (at, v) => gl.uniform4fv(at, v),
      [gl.FLOAT_MAT3]: (at, v) => gl.uniformMatrix3fv(at, false, v),
      [gl.FLOAT_MAT4x3]: (at, v) => gl.uniformMatrix4x3fv(at, false, v),
    };
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
      const { name, type } = gl.getActiveUniform(program, i);
      if (!(type in calls)) continue;
      const at = gl.getUniformLocation(program, name);
      setters.set(name.replace('[0]', ''), (values) => calls[type](at, values));
    }
    return setters;
  }

  // Upload a view's texels unless the device has them; the least recently shown view makes room.
  show(view, texels) {
    const { gl, page: { channels: { width, height } } } = this;
    const layers = texels.length / (4 * width * height);
    if (!this.textures.has(view)) {
      if ((this.textures.size + 1) * texels.byteLength > KEPT_BYTES && this.textures.size) {
        const [oldest] = this.textures.keys();
        gl.deleteTexture(this.textures.get(oldest));
        this.textures.delete(oldest);
      }
      this.textures.set(view, this.array(gl.RGBA16F, [width, height, layers], texels));
    }
    const texture = this.textures.get(view);
    this.textures.delete(view);
    this.textures.set(view, texture);
    this.shown = texture;
  }

  // A texture array of half floats or bytes; empty without texels.
  array(format, size, texels = null) {
    const { gl } = this, target = gl.TEXTURE_2D_ARRAY, texture = gl.createTexture();
    const type = format === gl.RGBA16F ? gl.HALF_FLOAT : gl.UNSIGNED_BYTE;
    gl.bindTexture(target, texture);
    gl.texStorage3D(target, 1, format, ...size);
    if (texels) gl.texSubImage3D(target, 0, 0, 0, 0, ...size, gl.RGBA, type, texels);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
      gl.texParameteri(target, side, gl.NEAREST);
    }
    if (gl.getError() === gl.OUT_OF_MEMORY) {
      throw new Refused('This browser has no room for the picture.');
    }
    return texture;
  }

  // Forget a view's texels, which others replace.
  drop(view) {
    this.gl.deleteTexture(this.textures.get(view) ?? null);
    this.textures.delete(view);
  }

  // Resize the canvas to all pixels, or to every second column and row.
  resize(every) {
    const { canvas, page: { channels } } = this;
    const [width, height] = [channels.width, channels.height].map((n) => Math.ceil(n / every));
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
  }

  // Draw adjacent sides: [{drawing, texture, from, to}] in fractions of the width; black if drawing
  // is null, the view's own channels if texture is. On the canvas unless another target is given,
  // {framebuffer, size}.
  draw(sides, every, target = null) {
    if (!target) this.resize(every);
    const { gl, canvas } = this, [width, height] = target?.size ?? [canvas.width, canvas.height];
    gl.bindFramebuffer(gl.FRAMEBUFFER, target?.framebuffer ?? null);
    gl.viewport(0, 0, width, height);
    for (const { drawing, texture, from, to } of sides) {
      const left = Math.round(from * width);
      gl.scissor(left, 0, Math.round(to * width) - left, height);
      if (!drawing) {
        gl.clearColor(0, 0, 0, 1);
        gl.clear(gl.COLOR_BUFFER_BIT);
        continue;
      }
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture ?? this.shown);
      this.pass(this.program({ ...drawing.form, EVERY: every }), drawing.uniforms);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // Use a program of `program`, with values of its uniforms.
  set({ program, setters }, uniforms) {
    this.gl.useProgram(program);
    for (const [name, values] of Object.entries(uniforms)) {
      setters.get(name)?.(new Float32Array(values));
    }
  }

  // Draw with a program of `program`.
  pass(made, uniforms) {
    this.set(made, uniforms);
    this.gl.drawArrays(this.gl.TRIANGLES, 0, 3);
  }

  // Red, green and blue of a pixel, directly after it was drawn in full.
  codesAt(x, y) {
    const codes = new Uint8Array(4), { gl, canvas: { height } } = this;
    gl.readPixels(x, height - 1 - y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, codes);
    return [...codes.slice(0, 3)];
  }

  // Forget the device's objects after the browser has lost the context.
  forget() {
    this.programs.clear();
    this.textures.clear();
    this.gl.enable(this.gl.SCISSOR_TEST);
  }
}
