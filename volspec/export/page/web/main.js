// The page: state, drawing, and timing.
//
//     inputs -> edit, put -> state -> refresh -> picture, panels, address

// Time of a slow frame, number of slow frames in a row that makes pictures coarse, and time
// without changes after which pictures are drawn in full again.
const SLOW_MS = 42, FEW = 2, REST_MS = 250;

// Opacity below which a pixel shows the backdrop alone.
const CLEAR = 1e-3;

class App {
  constructor(page) {
    this.page = page;
    this.state = readFrom(location.hash.slice(1), page);
    this.decoded = new Map();
    // Texels and number of the view that is drawn.
    this.texels = null;
    this.shown = -1;
    this.turning = false;
    this.playing = false;
    // Camera of a served page.
    this.camera = null;
    this.run = 0;
    // Pixel under the mouse; the pinned one is in the state.
    this.hovered = null;
    this.spoken = false;
    this.relighter = new Relighter(byId('picture'), page);
    // Of pages with layers of opacity, once they are unpacked.
    this.recomposer = this.nearby = this.stereo = null;
    this.forget();
    // Number of full pictures in a row that took too long.
    this.late = 0;
    this.refresh = perFrame(() => this.refreshed());
    this.sharpenLater = whenQuiet(() => { this.forget(); this.refresh(); }, REST_MS);
    this.rememberLater = whenQuiet(() => this.remember(), 400);
  }

  // The side that the panel edits.
  look() { return this.state.sides[this.state.compare ? this.state.edited : 0]; }

  // Side at a fraction of the picture's width.
  sideAt(x) { return this.state.compare && x >= this.state.divide ? 1 : 0; }

  edit(change) {
    const at = this.state.compare ? this.state.edited : 0;
    this.put({ sides: this.state.sides.map((look, i) => (i === at ? change(look) : look)) });
  }

  put(changes) {
    this.state = { ...this.state, ...changes };
    this.refresh();
    this.rememberLater();
  }

  // Write the state into the address.
  remember() {
    const words = written(this.state, this.page);
    if (words === location.hash.slice(1)) return;
    try {
      history.replaceState(null, '', words ? `#${words}` : location.pathname);
    } catch {
      // A sandboxed frame has no address of its own; sharing still works.
    }
  }

  lit(look) {
    const parts = rigOf(this.page.lights, shining(look));
    return parts && illuminationOf(this.page.basis, this.page.groups, parts, look);
  }

  // Value of a slider, from which a given value starts when it replaces the model's own.
  shownNumber(field) {
    const input = byId(field);
    return SCALES[input.dataset.scale ?? 'plain'].of(input.valueAsNumber);
  }

  // Pixel that is read: the one under the mouse, else the pinned one; none of two eyes' pictures.
  get probe() { return this.isStereo ? null : this.hovered ?? this.state.probe; }

  hover(pixel) {
    this.hovered = pixel;
    this.refresh();
  }

  // Show another view; while one is being unpacked, only the last request waits.
  async turnTo(view) {
    if (view !== this.state.view) this.put({ view });
    if (this.turning) return;
    this.turning = true;
    try {
      while (this.shown !== this.state.view) await this.unpack(this.state.view);
    } finally {
      this.turning = false;
    }
    // Faults of a view are reported when it is shown.
    for (const by of this.playing ? [[0, 1]] : [[1, 0], [-1, 0], [0, 1]]) {
      this.decode(viewAfter(this.page, this.shown, ...by)).catch(() => {});
    }
  }

  // Play the time steps, in a loop; a step that takes longer to unpack is shown late.
  async play(wanted) {
    this.playing = wanted && stepsOf(this.page) > 1;
    // A call ends the ones before.
    const run = ++this.run;
    this.refresh();
    while (this.playing && run === this.run) {
      const due = new Promise((done) => { setTimeout(done, 1000 / this.page.fps); });
      await this.turnTo(viewAfter(this.page, this.state.view, 0, 1));
      await due;
    }
  }

  // Show a view, or explain why the previous one stays.
  async unpack(view) {
    try {
      this.texels = await this.decode(view);
    } catch (error) {
      if (this.shown < 0) throw error;
      this.playing = false;
      notify(`This view cannot be unpacked: ${error.message}. You see the previous one.`);
      // A view requested in the meantime is shown.
      if (this.state.view === view) this.put({ view: this.shown });
      return;
    }
    this.shown = view;
    this.showMarks(view);
    // Hide a message about an earlier view, but not a refusal.
    byId('notice').hidden = !byId('controls').disabled;
    this.refresh();
  }

  // Labels and measurements, which are projected for each view.
  showMarks(view) {
    const own = `marks-${view}`, marks = byId('marks');
    for (const each of marks.children) each.setAttribute('display', each.id === own ? 'inline' : 'none');
    const texts = [...document.querySelectorAll(`#${own} text`)].map((each) => each.textContent);
    marks.setAttribute('aria-label', texts.join(', '));
    marks.setAttribute('aria-hidden', !texts.length);
  }

  // A view's texels, kept while there is room.
  decode(view) {
    const { page, decoded } = this;
    if (!decoded.has(view)) {
      const packed = bytesOf(byId(`view-${view}`).textContent);
      const made = texelsOf(packed, page.views[view], page.channels);
      decoded.set(view, made);
      const { width, height, count } = page.channels;
      const bytes = decoded.size * width * height * Math.ceil(count / 4) * 8;
      if (bytes > KEPT_BYTES && decoded.size > 3) {
        decoded.delete(decoded.keys().next().value);
      }
    }
    return decoded.get(view);
  }

  // Replace the only view by another camera's.
  replace(texels, marks) {
    this.decoded.set(0, Promise.resolve(texels));
    this.relighter.drop(0);
    byId('marks').replaceChildren(svg('g', { id: 'marks-0' }, ...marks));
    this.showMarks(0);
    this.texels = texels;
    this.refresh();
  }

  // The picture, or every second column and row of it; through one more point of a lens if it is to
  // be refined.
  draw(every = 1, refine = false) {
    const { state, page, relighter } = this;
    if (!this.texels || relighter.gl.isContextLost()) return;
    relighter.show(this.shown, this.texels);
    const drawings = state.sides.map((look) => {
      const light = this.lit(look);
      return light && drawingOf(page, light, look);
    });
    const split = state.compare ? state.divide : 1;
    const sidesOf = (eye) => [[0, split], [split, 1]].slice(0, state.compare ? 2 : 1).map(
      ([from, to], i) => ({
        drawing: drawings[i], texture: this.recomposed(i, eye, refine), from, to }));
    if (this.isStereo) this.stereo.draw(state.stereo, every, sidesOf);
    else relighter.draw(sidesOf(0), every);
    const whole = !state.compare && state.stereo !== 'pair';
    if (every === 1) byId('port').style.background = whole ? this.backdropColour() : '';
    byId('picture').setAttribute('aria-busy', this.refines);
    // Marks are those of the cast's camera.
    byId('marks').style.visibility = this.isMoved ? 'hidden' : '';
  }

  // Texture of a side's opacities and view, of both eyes between -1 and 1; null if it is the cast's.
  recomposed(side, eye = 0, refine = false) {
    const look = this.state.sides[side], { turn } = this.state;
    if (this.nearby && isFocused(look) && !eye) {
      return this.nearby.focused(side, look, turn, refine);
    }
    const view = this.nearby && viewOf(this.page, turn, eye);
    if (view) return this.nearby.texture(side, look, eye, view);
    return this.recomposer?.texture(side, look) ?? null;
  }

  // True if both eyes' pictures are shown.
  get isStereo() { return Boolean(this.stereo) && this.state.stereo !== 'off'; }

  // True if a lens shows more with each frame.
  get refines() {
    const { compare, sides } = this.state, shown = compare ? sides : [sides[0]];
    return Boolean(this.nearby) && !this.isStereo
      && shown.some((look, side) => isFocused(look) && !this.nearby.isWhole(side));
  }

  // True if the picture is not seen from the cast's camera.
  get isMoved() { return this.isStereo || Boolean(this.state.turn?.some((angle) => angle)); }

  // Turn a little, if the page has a camera and layers.
  lean(across, down) {
    const angles = [across, down].map((by, i) => (
      clamped(this.state.turn[i] + by, -MAX_TURN, MAX_TURN)));
    this.put({ turn: angles });
  }

  // Channels of a side's pixel; opacity is the last.
  channelsAt(side, x, y) {
    const texture = this.recomposed(side);
    return texture ? this.recomposer.channelsAt(texture, x, y)
      : channelsAt(this.texels, this.page.channels, x, y);
  }

  // Unpack the layers of opacity, after the picture is shown.
  async loadOpacity() {
    try {
      const packed = bytesOf(byId('layers').textContent);
      const texels = await layersOf(packed, this.page.opacity, this.page.channels);
      this.recomposer = new Recomposer(this.relighter, texels);
      if (this.page.opacity.camera) {
        this.nearby = new NearbyViews(this.recomposer);
        this.stereo = new StereoPass(this.relighter);
        byId('keys').append(' Page Up and Page Down turn the view a little, with Shift they tilt it.');
      }
      byId('opacity-status').textContent = '';
      this.forget();
    } catch (error) {
      byId('opacity-status').textContent = error instanceof Refused
        ? `${error.message} Opacities cannot be changed here.`
        : `The layers of opacity cannot be unpacked: ${error.message}.`;
    }
    this.refresh();
  }

  // CSS colour of the backdrop, to continue it around the picture; empty if no corner shows it.
  backdropColour() {
    const { page: { channels }, relighter } = this;
    const [right, low] = [channels.width - 1, channels.height - 1];
    const corner = [[0, 0], [right, 0], [0, low], [right, low]].find(
      ([x, y]) => this.isStereo || this.state.sides[0].fog
        || this.channelsAt(0, x, y).at(-1) < CLEAR);
    return corner ? `rgb(${relighter.codesAt(...corner).join(' ')})` : '';
  }

  // State on which the picture depends; the probe, for example, is not part of this.
  get pictured() {
    const { texels, state: { sides, compare, divide, turn, stereo } } = this;
    return [texels, sides, compare, compare && divide, turn, stereo];
  }

  // Draw the picture if it has changed; coarsely while it keeps changing in a slow browser.
  redraw() {
    const pictured = this.pictured, now = performance.now();
    if (pictured.every((part, i) => part === this.drawn[i])) {
      if (this.refines) this.draw(1, true);
      if (this.refines) this.refresh();
      return;
    }
    const coarse = this.late >= FEW && now - this.drawnAt < REST_MS;
    this.drawn = pictured;
    this.draw(coarse ? 2 : 1);
    if (coarse) this.sharpenLater();
    if (this.refines) this.refresh();
    // A browser that falls behind requests the next frame late.
    requestAnimationFrame(() => {
      this.drawnAt = performance.now();
      if (!coarse) this.late = this.drawnAt - now > SLOW_MS ? this.late + 1 : 0;
    });
  }

  // Draw the next picture in full, even if nothing has changed.
  forget() {
    this.drawn = [];
    this.drawnAt = -Infinity;
  }

  refreshed() {
    try {
      this.redraw();
    } catch (error) {
      refuse(error);
      return;
    }
    this.panels.forEach((panel) => panel());
    this.stage.layOut();
  }

  async start() {
    this.stage = new Stage(this);
    fillHeatScale(this.page);
    this.panels = [
      lightsPanel, opacityPanel, depthPanel, viewingPanel, valuesPanel, errorsPanel, probePanel,
      comparing, labels,
    ].map((panel) => panel(this));
    captioning();
    sharing(this);
    if (camerasOf(this.page) > 1) turning(this);
    if (stepsOf(this.page) > 1) stepping(this);
    inNotebook(this);
    await this.turnTo(this.state.view);
    if (this.page.served) this.camera = new ServedCamera(this);
    const { canvas } = this.relighter;
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    canvas.addEventListener('webglcontextrestored', () => {
      this.relighter.forget();
      [this.recomposer, this.nearby, this.stereo].forEach((each) => each?.forget());
      this.swatches = this.bars = null;
      this.forget();
      this.refresh();
    });
    window.addEventListener('hashchange', ({ newURL }) => {
      // An edit just before may have written its state over the address by now.
      this.state = readFrom(new URL(newURL).hash.slice(1), this.page);
      this.turnTo(this.state.view);
      this.refresh();
      this.rememberLater();
    });
    byId('reset').addEventListener('click', () => {
      this.stage.fit();
      this.put(opened(this.page));
      this.turnTo(0);
    });
    // Only a picture other than the cast's waits for the layers.
    const loaded = this.page.opacity && this.loadOpacity();
    const { sides, turn = [], stereo = 'off' } = this.state;
    if (!sides.every(isAsCast) || turn.some(Boolean) || stereo !== 'off') await loaded;
    this.refreshed();
    document.documentElement.classList.add('ready');
  }
}

// A long caption has three lines until it is expanded; then it may scroll.
function captioning() {
  const caption = byId('caption'), more = byId('more');
  const put = (whole) => {
    caption.className = whole ? 'whole' : 'cut';
    if (whole) caption.tabIndex = 0; else caption.removeAttribute('tabindex');
    more.textContent = whole ? 'Less' : 'More';
    more.setAttribute('aria-expanded', whole);
  };
  more.addEventListener('click', () => put(caption.className === 'cut'));
  new ResizeObserver(() => {
    if (caption.className !== 'cut') return;
    more.hidden = caption.scrollHeight <= caption.clientHeight + 1;
  }).observe(caption);
  put(false);
}

function comparing(app) {
  // The second side begins like the first, and is the one that is edited.
  byId('compare').addEventListener('change', ({ target: { checked } }) => {
    const [first, second] = app.state.sides;
    const sides = [first, checked ? first : second];
    app.put({ compare: checked, sides, edited: checked ? 1 : 0 });
  });
  byId('divide').addEventListener('input', ({ target }) => (
    app.put({ divide: target.valueAsNumber })));
  byId('errors').addEventListener('change', ({ target }) => app.put({ errors: target.checked }));
  const sides = [byId('side-a'), byId('side-b')];
  sides.forEach((input, i) => input.addEventListener('change', () => app.put({ edited: i })));
  return () => {
    const { compare, edited, divide } = app.state;
    byId('compare').checked = compare;
    byId('compare-rows').hidden = !compare;
    sides.forEach((input, i) => { input.checked = i === edited; });
    byId('divide').value = divide;
    byId('divide').setAttribute('aria-valuetext', `${Math.round(100 * divide)} % A`);
    byId('edits').textContent = compare ? `Editing ${'AB'[edited]}` : '';
  };
}

// Labels of the sides, on the picture and for screen readers.
function labels(app) {
  const describe = (look) => {
    const model = look.model === 'none' ? 'no adaptation' : look.model;
    const { deficiency, severity } = look;
    const vision = deficiency !== 'none' && severity > 0 ? ` \u00b7 ${deficiency}`
      + (severity < 1 ? ` ${severity.toFixed(2)}` : '') : '';
    const more = [scaledInWords(app.page, look), depthInWords(look)].filter(Boolean);
    return [`${namesOf(app.page, look)} \u00b7 ${model}${vision}`, ...more].join(' \u00b7 ');
  };
  return () => {
    const { compare, sides } = app.state;
    byId('label-a').textContent = (compare ? 'A: ' : '') + describe(sides[0])
      + (app.camera?.coarse ? ' \u00b7 coarse' : '');
    byId('label-b').textContent = compare ? `B: ${describe(sides[1])}` : '';
    byId('label-b').hidden = !compare;
    const whole = `${isolated(app.page.title)} under ${describe(sides[0])}`
      + (compare ? `, beside ${describe(sides[1])}` : '');
    byId('picture').setAttribute('aria-label', whole);
    // The port's contents are not read out: it handles its own keys.
    byId('port').setAttribute('aria-label', `${whole}: zoom and probe`);
  };
}

function turning(app) {
  const input = byId('view'), output = byId('view-read');
  byId('view-row').hidden = false;
  const cameras = camerasOf(app.page);
  input.max = cameras - 1;
  input.addEventListener('input', () => {
    const { view } = app.state;
    app.turnTo(view - view % cameras + input.valueAsNumber);
  });
  app.panels.push(() => {
    input.value = app.state.view % cameras;
    output.textContent = `${Math.round(app.page.views[app.state.view].azimuth_deg)}\u00b0`;
    input.setAttribute('aria-valuetext', output.textContent);
  });
}

function stepping(app) {
  const input = byId('step'), output = byId('step-read'), button = byId('play');
  const cameras = camerasOf(app.page), steps = stepsOf(app.page);
  byId('step-row').hidden = false;
  input.max = steps - 1;
  input.addEventListener('input', () => {
    app.play(false);
    app.turnTo(input.valueAsNumber * cameras + app.state.view % cameras);
  });
  button.addEventListener('click', () => app.play(!app.playing));
  app.panels.push(() => {
    const step = Math.floor(app.state.view / cameras);
    input.value = step;
    output.textContent = `${step + 1} / ${steps}`;
    input.setAttribute('aria-valuetext', `${step + 1} of ${steps}`);
    button.textContent = app.playing ? 'Pause' : 'Play';
    button.setAttribute('aria-pressed', app.playing);
  });
}

function notify(words) {
  byId('notice').textContent = words;
  byId('notice').hidden = false;
}

// Keep the still picture, and show the reason.
function refuse(error) {
  const reason = error instanceof Refused
    ? error.message : `The picture cannot be relit: ${error.message}.`;
  notify(`${reason} You see a still picture.`);
  byId('controls').disabled = true;
  for (const name of [...Object.keys(HEARS_KEYS), 'aria-label']) byId('port').removeAttribute(name);
  document.documentElement.classList.remove('ready');
  document.documentElement.classList.add('still');
}

async function open() {
  const page = JSON.parse(byId('numbers').textContent);
  try {
    if (!('DecompressionStream' in window)) {
      throw new Refused('This browser is too old to unpack the picture.');
    }
    await new App(page).start();
  } catch (error) {
    refuse(error);
    if (!(error instanceof Refused)) throw error;
  }
}

open();
