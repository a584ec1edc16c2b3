// Camera of a served page: it turns here; the server casts its pictures, which replace each other.
//
//     drag, keys, sliders -> state -> [camera] -> view?azimuth=… -> texels
//
// Server: volspec/export/serve/http.py. While the camera moves, one coarse picture after the other
// is asked for, each of the newest camera; when it rests, a whole one.

const STILL_MS = 200, KEY_DEG = 10, DRAG_DEG = 180;

const around = (degrees) => ((degrees + 180) % 360 + 360) % 360 - 180;

// A camera as the server takes it.
const cameraWords = ({ azimuth, elevation, distance }) => (
  new URLSearchParams(Object.entries({ azimuth, elevation, distance })
    .map(([name, value]) => [name, +value.toPrecision(6)])).toString());

class ServedCamera {
  constructor(app) {
    this.app = app;
    [this.client] = crypto.getRandomValues(new Uint32Array(1));
    // Of the last picture: its camera, whether it is coarse, and what it took.
    this.shown = cameraWords(opened(app.page));
    this.coarse = app.page.served.coarse;
    this.took = '';
    // Milliseconds that the last coarse picture's bytes took: on slow networks the next is coarser.
    this.transfer = 0;
    // The camera that was asked for last; it is not asked for again if that failed.
    this.asked = this.shown;
    this.following = false;
    this.failed = false;
    this.whole = new AbortController();
    this.sharpenLater = whenQuiet(() => this.sharpen(), STILL_MS);
    this.sharpenLater();
    this.bind();
    if (app.page.served.notice) notify(app.page.served.notice);
  }

  get wanted() { return cameraWords(this.app.state); }

  turn(across, down) {
    const { azimuth, elevation } = this.app.state;
    this.app.put({
      azimuth: around(azimuth + across), elevation: clamped(elevation + down, -90, 90) });
  }

  dolly(factor) {
    const [near, far] = this.app.page.served.distances;
    this.app.put({ distance: clamped(this.app.state.distance * factor, near, far) });
  }

  // Ask for a picture if the state has another camera.
  update() {
    if (this.wanted === this.asked) return;
    this.asked = this.wanted;
    this.whole.abort();
    this.follow();
  }

  async follow() {
    if (this.following) return;
    this.following = true;
    let arrived = true;
    while (arrived && this.shown !== this.wanted) arrived = await this.load(this.wanted, true);
    this.following = false;
    if (arrived && this.coarse) this.sharpenLater();
  }

  async sharpen() {
    if (this.following || !this.coarse) return;
    this.whole = new AbortController();
    await this.load(this.wanted, false, this.whole.signal);
  }

  // Show a picture of a camera; return false if it did not arrive.
  async load(camera, coarse, signal) {
    const { transfer, client } = this;
    const query = `view?${camera}&coarse=${coarse ? 1 : 0}&transfer=${transfer}&client=${client}`;
    try {
      const answer = await fetch(query, { signal }).catch((error) => {
        throw signal?.aborted ? error : new Error('the server does not answer');
      });
      if (!answer.ok) throw new Error((await answer.text()).trim());
      const started = performance.now(), message = new Uint8Array(await answer.arrayBuffer());
      if (coarse) this.transfer = Math.min(Math.round(performance.now() - started), 60000);
      await this.show(camera, message, signal);
    } catch (error) {
      if (error.name === 'AbortError') return false;
      this.failed = true;
      report(`No picture from there: ${error.message}. You see the last one, and can change its `
        + 'light; move the camera to try again.');
      this.app.refresh();
      return false;
    }
    return true;
  }

  // A message: the length of its numbers, these as JSON, and the channels.
  async show(camera, message, signal) {
    const end = 4 + new DataView(message.buffer).getUint32(0);
    const numbers = JSON.parse(new TextDecoder().decode(message.subarray(4, end)));
    const texels = await texelsOf(message.subarray(end), numbers, this.app.page.channels);
    if (signal?.aborted) return;
    [this.shown, this.coarse, this.failed] = [camera, numbers.coarse, false];
    this.took = `${figures(message.length / 1000)} kB, cast in ${numbers.ms} ms`;
    this.app.replace(texels, numbers.marks.map(markOf));
    report(numbers.notice);
  }

  bind() {
    const { app } = this, { distances } = app.page.served;
    byId('camera').hidden = false;
    byId('keys').append(' Page Up and Page Down turn the camera, with Shift they tilt it.');
    // A frame of another page would have no token.
    byId('share-snippet').closest('label').hidden = byId('copy-snippet').hidden = true;
    const input = byId('distance');
    [input.min, input.max] = distances.map(Math.log2);
    const rows = [
      ['azimuth', (x) => x, (x) => x, (x) => `${Math.round(x)}\u00b0`],
      ['elevation', (x) => x, (x) => x, (x) => `${Math.round(x)}\u00b0`],
      ['distance', SCALES.log2.of, SCALES.log2.from, (x) => `${figures(x)}\u00d7`],
    ];
    const shown = rows.map(([name, of, from, words]) => {
      const slider = byId(name), output = byId(`${name}-read`);
      slider.addEventListener('input', () => app.put({ [name]: of(slider.valueAsNumber) }));
      return () => {
        slider.value = from(app.state[name]);
        output.textContent = words(app.state[name]);
        slider.setAttribute('aria-valuetext', output.textContent);
      };
    });
    app.panels.push(() => {
      this.update();
      shown.forEach((show) => show());
      this.describe();
    });
  }

  // Say what is seen; the same words are not announced again.
  describe() {
    const words = this.failed ? 'The last picture that arrived.'
      : this.coarse ? 'A coarse picture; the whole one follows.'
        : `The whole picture: ${this.took}.`;
    const status = byId('camera-status');
    if (status.textContent !== words) status.textContent = words;
  }
}

// An element of a mark: name, attributes, and text or children.
const markOf = ([name, attributes, inside]) => (
  svg(name, attributes, ...(typeof inside === 'string' ? [inside] : inside.map(markOf))));

// Show a message once, or none.
function report(words) {
  if (!words) byId('notice').hidden = true;
  else if (byId('notice').hidden || byId('notice').textContent !== words) notify(words);
}
