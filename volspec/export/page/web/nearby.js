// Views of a camera nearby: layers splatted as points, for a small turn, two eyes, and a lens, whose
// picture is the mean of what many eyes see.
//
//     codes of layers, turn -> shaders/splat.vert -> half floats for relight.frag
//
// Twin of volspec/image/reproject.py; eyes and anaglyphs of volspec/relight/stereo.py.

// Greatest turn, in degrees; and slices of depth in which points are sorted. Deep layers are up to so
// many points, one every so many pixels: their borders jump between pixels, which one point shows.
const MAX_TURN = 6, SORTED = 4096, MAX_PARTS = 4, PART_PX = 8;

const RADIANS = Math.PI / 180;

// Axes of a camera that is turned around its target, so that what is in front moves right and down:
// columns of a matrix.
function turned(across, down) {
  const [c, s] = [Math.cos(across * RADIANS), Math.sin(across * RADIANS)];
  const [d, t] = [Math.cos(down * RADIANS), Math.sin(down * RADIANS)];
  return [c, -t * s, d * s, 0, d, t, -s, -t * c, d * c];
}

// What views other than the cast's are made of; null for its own. `side` is -1 for the left eye, 1
// for the right one.
function viewOf({ opacity }, [across, down], side) {
  if (!opacity?.camera || (!across && !down && !side)) return null;
  const { distance_mm: distance, nearness, convergence_mm: meet, eyes } = opacity.camera;
  if (!nearness) {
    // Parallel rays have no shift: eyes turn around where they meet.
    const angle = 2 * Math.atan(eyes / 2) / RADIANS / 2;
    return { turn: turned(across - side * angle, down), eye_mm: [0, 0, 0, 0] };
  }
  const away = side * eyes / 2 * meet;
  return { turn: turned(across, down), eye_mm: [away, 0, away * distance / meet, 0] };
}

// Points of a lens, and its opening by the distance in focus if none is given.
const LENS_POINTS = 16, LENS_OPENING = 1 / 20;

const openingOf = ({ focus, aperture }) => aperture ?? focus * LENS_OPENING;

// Point `i` of a lens seen by a turned camera, as `viewOf`; from the middle to the edge.
function viewThrough({ opacity }, [across, down], look, i) {
  const { distance_mm: distance, pitch_mm: pitch } = opacity.camera;
  const { focus } = look, opening = openingOf(look), angle = i * Math.PI * (3 - Math.sqrt(5));
  const radius = 0.5 * opening * Math.sqrt(1 - 1 / LENS_POINTS) * Math.sqrt((i + 0.5) / LENS_POINTS);
  const [x, y] = [radius * Math.cos(angle), radius * Math.sin(angle)];
  const part = Math.sqrt(Math.PI / 4 / LENS_POINTS), shift = distance / focus;
  return {
    turn: turned(across, down), eye_mm: [x, y, x * shift, y * shift],
    lens: [part * opening / focus * distance / pitch, focus] };
}

class NearbyViews {
  constructor(recomposer) {
    this.recomposer = recomposer;
    this.order = this.sorted();
    this.forget();
  }

  forget() {
    this.points = null;
    // Of each side: what its lens shows, and by how many points.
    this.lenses = new Map();
  }

  // Parts of layers as `point` of shaders/splat.vert, far to near. Along a ray of a camera nearby that
  // is the same order.
  sorted() {
    const { texels, relighter: { page: { opacity } }, size: [width, height] } = this.recomposer;
    const { camera, nearest_mm: nearest, begin_mm, width_mm, surface_mm } = opacity;
    const pixels = width * height;
    const slant = camera.pitch_mm * camera.nearness;
    const cosines = new Float32Array(pixels);
    for (let y = 0, at = 0; y < height; y++) {
      for (let x = 0; x < width; x++, at++) {
        cosines[at] = 1 / Math.hypot(1, slant * (x - (width - 1) / 2), slant * (y - (height - 1) / 2));
      }
    }
    const most = nearest + Math.max(begin_mm + width_mm, surface_mm);
    const perMm = SORTED / most, counts = new Uint32Array(SORTED + 1);
    // Of points: far ones first.
    const each = (found) => {
      for (let layer = 0, i = 0; layer < opacity.count; layer++) {
        const depths = 4 * pixels * layer * opacity.texels;
        const extents = depths + 4 * pixels * (opacity.texels - 1);
        const isSurface = surface_mm > 0 && layer === opacity.count - 1;
        for (let at = 0; at < pixels; at++, i++) {
          const j = depths + 4 * at, k = extents + 4 * at;
          if (!(texels[j] || texels[j + 1] || texels[j + 2] || texels[j + 3])) continue;
          const near = texels[k], c = texels[k + 1];
          const begin = nearest + (isSurface
            ? (256 * near + c) / 65535 * surface_mm : near / 255 * begin_mm);
          const long = isSurface ? 0 : (c / 255) ** 2 * width_mm;
          const parts = clamped(Math.ceil(long / (PART_PX * camera.pitch_mm)), 1, MAX_PARTS);
          for (let part = 0; part < parts; part++) {
            const place = (begin + long * (part + 0.5) / parts) * cosines[at] * perMm;
            found(SORTED - clamped(Math.floor(place), 0, SORTED - 1), i, parts, part);
          }
        }
      }
    };
    each((key) => { counts[key]++; });
    const firsts = new Uint32Array(SORTED + 1);
    for (let key = 1; key <= SORTED; key++) firsts[key] = firsts[key - 1] + counts[key - 1];
    const order = new Uint32Array(firsts[SORTED] + counts[SORTED]);
    each((key, i, parts, part) => {
      order[firsts[key]++] = (part << 30 | (parts - 1) << 28 | i) >>> 0;
    });
    return order;
  }

  upload() {
    const { recomposer, recomposer: { relighter: { gl, page: { opacity } } } } = this;
    const channels = Object.keys(recomposer.relighter.page.groups).length
      * (opacity.materials.length + 1);
    this.slices = Math.ceil(channels / 3);
    this.splatted = recomposer.blank(this.slices);
    this.mostRadius = (gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE)[1] / 2).toFixed(1);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.order, gl.STATIC_DRAW);
    this.points = buffer;
  }

  // A side's texture of channels, as an eye sees it; the eyes of `viewOf`.
  texture(side, look, eye, view) {
    const { recomposer } = this, name = `side ${side}, eye ${eye}`;
    return recomposer.kept(name, [look.opacity, recomposer.effects(look), view], (texture) => {
      this.draw(texture, { ...recomposer.uniforms(look), ...view });
    });
  }

  // A side's texture of what a lens sees, by one more of its points if it is to be refined.
  focused(side, look, turn, refine) {
    const { recomposer, recomposer: { relighter: { page } } } = this, name = `side ${side}, lens`;
    const shows = [look.opacity, recomposer.effects(look), look.focus, look.aperture, turn];
    const key = JSON.stringify(shows);
    if (this.lenses.get(name)?.key !== key) this.lenses.set(name, { key, points: 0 });
    const lens = this.lenses.get(name);
    if (lens.points === 0 || (refine && lens.points < LENS_POINTS)) lens.points += 1;
    return recomposer.kept(name, [key, lens.points], (texture) => {
      const view = viewThrough(page, turn, look, lens.points - 1);
      this.draw(texture, { ...recomposer.uniforms(look), ...view }, 1 / lens.points);
    });
  }

  // True if all points of a side's lens were drawn.
  isWhole(side) { return this.lenses.get(`side ${side}, lens`)?.points >= LENS_POINTS; }

  // Draw a view into a texture, or into the mean of what is there with a share.
  draw(texture, uniforms, share = 1) {
    const { recomposer, recomposer: { relighter, relighter: { gl, page: { opacity } } } } = this;
    const { distance_mm, nearness, pitch_mm } = opacity.camera;
    const all = { lens: [0, 1], ...uniforms, camera: [distance_mm, nearness, pitch_mm] };
    if (!this.points) this.upload();
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    recomposer.drawInto(this.splatted, this.slices, (first, drawn) => {
      const form = {
        FIRST_TARGET: first, TARGETS_DRAWN: drawn, DEPTH: 1, MAX_RADIUS: this.mostRadius };
      const made = relighter.program(form, 'splat.frag', 'splat.vert');
      recomposer.bind(made);
      relighter.set(made, all);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      const place = gl.getAttribLocation(made.program, 'point');
      gl.bindBuffer(gl.ARRAY_BUFFER, this.points);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribIPointer(place, 1, gl.UNSIGNED_INT, 0, 0);
      gl.drawArrays(gl.POINTS, 0, this.order.length);
      gl.disableVertexAttribArray(place);
    });
    gl.blendColor(share, share, share, share);
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    recomposer.drawInto(texture, recomposer.slices, (first, drawn) => {
      const form = { FIRST_SLICE: first, SLICES_DRAWN: drawn, DEPTH: 1 };
      const made = relighter.program(form, 'splatted.frag');
      recomposer.bind(made, { splatted: this.splatted });
      relighter.pass(made, all);
    });
    gl.disable(gl.BLEND);
  }
}

// Both eyes' frames as one: an anaglyph, or half as large and next to each other.
class StereoPass {
  constructor(relighter) {
    this.relighter = relighter;
    this.forget();
  }

  forget() { this.eyes = null; }

  // Draw each eye's sides, `sidesOf(-1)` and `sidesOf(1)`, in every n-th row and column, and both
  // eyes on the canvas.
  draw(layout, every, sidesOf) {
    const { relighter, relighter: { gl, canvas, page: { opacity: { camera } } } } = this;
    const pair = layout === 'pair';
    relighter.resize(pair ? 1 : every);
    const size = [canvas.width, canvas.height].map((side) => (pair ? Math.ceil(side / 2) : side));
    if (this.eyes?.size.join() !== size.join()) this.allocate(size);
    this.eyes.frames.forEach(({ framebuffer }, i) => {
      relighter.draw(sidesOf([-1, 1][i]), pair ? 2 : every, { framebuffer, size });
    });
    const form = { SIDE_BY_SIDE: pair ? 1 : 0 };
    const made = relighter.program(form, 'stereo.frag');
    gl.useProgram(made.program);
    this.eyes.frames.forEach(({ texture }, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(gl.getUniformLocation(made.program, ['left', 'right'][unit]), unit);
    });
    gl.activeTexture(gl.TEXTURE0);
    const corner = [0, pair ? Math.floor((canvas.height - size[1]) / 2) : 0];
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.scissor(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (pair) gl.scissor(...corner, canvas.width, size[1]);
    relighter.pass(made, {
      corner, left_mix: transposed(camera.left_mix).flat(),
      right_mix: transposed(camera.right_mix).flat() });
  }

  allocate(size) {
    const { relighter: { gl } } = this;
    for (const { texture, framebuffer } of this.eyes?.frames ?? []) {
      gl.deleteTexture(texture);
      gl.deleteFramebuffer(framebuffer);
    }
    const frames = [-1, 1].map(() => {
      const texture = gl.createTexture(), framebuffer = gl.createFramebuffer();
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, ...size);
      for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
        gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
      }
      gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
      gl.framebufferTexture2D(
        gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
      return { texture, framebuffer };
    });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.eyes = { size, frames };
  }
}
