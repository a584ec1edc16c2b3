// The picture on the screen: zoom and pan, turning to other views, probe, and dividing line.
//
// One finger or button turns (or pans if there is one view, without layers), two fingers pinch, the
// wheel zooms.

const MAX_ZOOM = 40, NEAR_DIVIDE = 16, MOVED = 5, MARGIN = 24;
// Least displayed length of a picture's side, in screen pixels.
const MIN_SIDE = 6;
// A drag across the picture turns a camera nearby by so much.
const LEAN_DEG = 30;
// Attributes that make the port a control while the picture can be relit.
const HEARS_KEYS = { tabindex: 0, role: 'application', 'aria-describedby': 'keys' };

class Stage {
  constructor(app) {
    this.app = app;
    this.port = byId('port');
    this.frame = byId('frame');
    this.place = { zoom: 1, x: 0, y: 0 };
    this.pointers = new Map();
    this.listen();
  }

  // Screen pixels per picture pixel, across and down, and the position of the picture's corner. The
  // two scales differ only for pictures too thin to see.
  get box() {
    const { width, height } = this.app.page.channels, { clientWidth, clientHeight } = this.port;
    const scale = Math.min(clientWidth / width, clientHeight / height) * this.place.zoom;
    const across = Math.max(scale, MIN_SIDE / width), down = Math.max(scale, MIN_SIDE / height);
    return {
      across, down, left: (clientWidth - width * across) / 2 + this.place.x,
      top: (clientHeight - height * down) / 2 + this.place.y,
    };
  }

  layOut() {
    const { across, down, left, top } = this.box, { app } = this, { width } = app.page.channels;
    this.frame.style.transform = `translate(${left}px, ${top}px) scale(${across}, ${down})`;
    this.frame.classList.toggle('coarse', Math.max(across, down) >= 3);
    // While the whole picture is visible, a finger may scroll the page vertically.
    const drags = this.place.zoom > 1 || app.camera;
    this.port.style.touchAction = drags ? 'none' : 'pan-y';
    const divide = byId('divide-line'), at = left + app.state.divide * width * across;
    divide.hidden = !app.state.compare;
    divide.style.transform = `translateX(${clamped(at, 0, this.port.clientWidth)}px)`;
    const cross = byId('cross'), { probe } = app;
    cross.hidden = !probe;
    if (probe) {
      const [x, y] = this.placeOf(probe);
      cross.style.transform = `translate(${x}px, ${y}px)`;
    }
    // Not `disabled`, which would take away the focus of a pressed button.
    for (const id of ['zoom-out', 'zoom-fit']) {
      byId(id).setAttribute('aria-disabled', this.place.zoom <= 1);
    }
  }

  // Position of a pixel's centre on the port.
  placeOf([i, j]) {
    const { across, down, left, top } = this.box;
    return [left + (i + 0.5) * across, top + (j + 0.5) * down];
  }

  // Centre of zoom for buttons and keys: the pinned pixel, else the middle.
  get focus() {
    const { app: { state: { probe } }, port } = this;
    return probe ? this.placeOf(probe) : [port.clientWidth / 2, port.clientHeight / 2];
  }

  zoomed(factor, [x, y] = this.focus) {
    const before = this.box, zoom = clamped(this.place.zoom * factor, 1, MAX_ZOOM);
    this.place.zoom = zoom;
    const after = this.box;
    // The point under the fingers stays in place.
    this.moved(
      x - after.across / before.across * (x - before.left) - after.left,
      y - after.down / before.down * (y - before.top) - after.top);
  }

  moved(dx, dy) {
    const { place, port, app: { page: { channels } } } = this, { across, down } = this.box;
    const beyond = (size, shown) => Math.max((size - shown) / 2, 0);
    const right = beyond(channels.width * across, port.clientWidth);
    const bottom = beyond(channels.height * down, port.clientHeight);
    place.x = clamped(place.x + dx, -right, right);
    place.y = clamped(place.y + dy, -bottom, bottom);
    this.app.refresh();
  }

  // Pan until a pixel is visible; with the keyboard, moving the probe pans.
  reveal(pixel) {
    const { clientWidth, clientHeight } = this.port, [x, y] = this.placeOf(pixel);
    const into = (at, size) => clamped(at, MARGIN, size - MARGIN) - at;
    this.moved(into(x, clientWidth), into(y, clientHeight));
  }

  fit() {
    this.place = { zoom: 1, x: 0, y: 0 };
    this.app.refresh();
  }

  // Pixel at a point of the port; null outside the picture.
  pixelAt(x, y) {
    const { across, down, left, top } = this.box, { width, height } = this.app.page.channels;
    const [i, j] = [Math.floor((x - left) / across), Math.floor((y - top) / down)];
    return i >= 0 && j >= 0 && i < width && j < height ? [i, j] : null;
  }

  listen() {
    const { port, app } = this;
    filled(port, HEARS_KEYS, []);
    port.addEventListener('pointerdown', (event) => this.pressed(event));
    port.addEventListener('pointermove', (event) => this.dragged(event));
    for (const end of ['pointerup', 'pointercancel']) {
      port.addEventListener(end, (event) => this.released(event));
    }
    port.addEventListener('pointerleave', (event) => {
      if (event.pointerType === 'mouse' && !this.pointers.size) app.hover(null);
    });
    port.addEventListener('wheel', (event) => {
      // In a frame, the wheel scrolls the outer page unless Ctrl is held.
      if (window.parent !== window && !event.ctrlKey) return;
      event.preventDefault();
      const factor = Math.exp(clamped(event.deltaY, -120, 120) / 300);
      if (app.camera && (event.ctrlKey || event.altKey)) app.camera.dolly(factor);
      else this.zoomed(1 / factor, this.within(event));
    }, { passive: false });
    port.addEventListener('keydown', (event) => this.key(event));
    new ResizeObserver(() => app.refresh()).observe(port);
    byId('zoom-in').addEventListener('click', () => this.zoomed(1.5));
    byId('zoom-out').addEventListener('click', () => this.zoomed(1 / 1.5));
    byId('zoom-fit').addEventListener('click', () => this.fit());
  }

  within(event) {
    const { left, top } = this.port.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  pressed(event) {
    if (event.button === 2) return;
    this.port.setPointerCapture(event.pointerId);
    const at = this.within(event), { state, page } = this.app, { across, left } = this.box;
    const line = left + state.divide * page.channels.width * across;
    const views = camerasOf(page) > 1 || page.served || this.app.nearby;
    const turns = views && event.button === 0 && !event.shiftKey;
    const divides = state.compare && Math.abs(at[0] - line) < NEAR_DIVIDE;
    const task = divides ? 'divide' : turns ? 'turn' : 'pan';
    this.pointers.set(event.pointerId, { at, from: at, task, turned: 0 });
  }

  dragged(event) {
    const at = this.within(event), held = this.pointers.get(event.pointerId), { app } = this;
    if (!held) {
      if (event.pointerType === 'mouse') this.hovered(at);
      return;
    }
    const [dx, dy] = [at[0] - held.at[0], at[1] - held.at[1]];
    if (this.pointers.size === 2) {
      this.pinched(event.pointerId, at);
    } else if (held.task === 'divide') {
      const { across, left } = this.box;
      app.put({ divide: clamped((at[0] - left) / (app.page.channels.width * across), 0, 1) });
    } else if (held.task === 'turn' && app.camera) {
      const rate = DRAG_DEG / this.port.clientHeight;
      app.hovered = null;
      app.camera.turn(-rate * dx, rate * dy);
    } else if (held.task === 'turn' && app.nearby) {
      const rate = LEAN_DEG / this.port.clientWidth;
      app.hovered = null;
      app.lean(rate * dx, rate * dy);
    } else if (held.task === 'turn') {
      const turned = (held.from[0] - at[0]) / this.port.clientWidth * camerasOf(app.page);
      app.turnTo(viewAfter(app.page, app.state.view, Math.round(turned) - held.turned, 0));
      held.turned = Math.round(turned);
    } else if (this.place.zoom > 1) {
      this.moved(dx, dy);
    }
    held.at = at;
  }

  pinched(id, at) {
    const held = this.pointers.get(id);
    const [other] = [...this.pointers].filter(([key]) => key !== id).map(([, pointer]) => pointer);
    const apart = (p) => Math.hypot(p[0] - other.at[0], p[1] - other.at[1]);
    const middle = [(at[0] + other.at[0]) / 2, (at[1] + other.at[1]) / 2];
    this.zoomed(apart(at) / Math.max(apart(held.at), 1), middle);
    this.moved((at[0] - held.at[0]) / 2, (at[1] - held.at[1]) / 2);
    other.task = held.task = 'pinch';
  }

  released(event) {
    const held = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (!held || held.task === 'pinch' || event.type === 'pointercancel') return;
    const still = Math.hypot(held.at[0] - held.from[0], held.at[1] - held.from[1]) < MOVED;
    // A tap or click pins the pixel; outside the picture it removes the pin.
    if (still && held.task !== 'divide') this.app.put({ probe: this.pixelAt(...held.at) });
  }

  hovered(at) {
    this.app.spoken = false;
    this.app.hover(this.pixelAt(...at));
  }

  key(event) {
    const { app } = this, { width, height } = app.page.channels;
    const go = (turns, steps) => app.turnTo(viewAfter(app.page, app.state.view, turns, steps));
    const page = (way) => {
      if (app.nearby) app.lean(...(event.shiftKey ? [0, -way] : [-way, 0]));
      else if (!app.camera) go(way, 0);
      else app.camera.turn(...(event.shiftKey ? [0, -KEY_DEG * way] : [KEY_DEG * way, 0]));
    };
    const step = event.shiftKey ? 10 : 1;
    const way = ARROWS[event.key];
    const calls = {
      '+': () => this.zoomed(1.25),
      '=': () => this.zoomed(1.25),
      '-': () => this.zoomed(0.8),
      0: () => this.fit(),
      PageUp: () => page(-1),
      PageDown: () => page(1),
      ',': () => go(0, -1),
      '.': () => go(0, 1),
      ' ': () => app.play(!app.playing),
      Escape: () => { app.hovered = null; app.put({ probe: null }); },
    };
    if (event.ctrlKey || event.metaKey || event.altKey || !(way || calls[event.key])) return;
    event.preventDefault();
    if (!way) return void calls[event.key]();
    const [x, y] = app.probe ?? [Math.floor(width / 2) - way[0], Math.floor(height / 2) - way[1]];
    app.spoken = true;
    app.hovered = null;
    const moved = [x + step * way[0], y + step * way[1]];
    const probe = [clamped(moved[0], 0, width - 1), clamped(moved[1], 0, height - 1)];
    app.put({ probe });
    this.reveal(probe);
  }
}
