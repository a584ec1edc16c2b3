// Sharing the picture: its address, a frame for other pages, a PNG.

const ENTITIES = { '&': '&amp;', '"': '&quot;', '<': '&lt;', '>': '&gt;' };

const attribute = (text) => text.replace(/[&"<>]/g, (mark) => ENTITIES[mark]);

// Address of the page: complete on a server; for a local file only its name, for privacy.
function addressOf() {
  const { protocol, href, pathname, hash } = location;
  return protocol.startsWith('http') ? href : (pathname.split('/').pop() || 'page.html') + hash;
}

const snippetOf = (page) => (
  `<iframe src="${attribute(addressOf())}" title="${attribute(page.title)}" `
  + 'width="100%" height="720" style="border:0" loading="lazy"></iframe>');

function sharing(app) {
  const dialog = byId('share-dialog'), link = byId('share-link'), snippet = byId('share-snippet');
  byId('share').addEventListener('click', () => {
    app.remember();
    link.value = addressOf();
    snippet.value = snippetOf(app.page);
    dialog.showModal();
  });
  for (const [button, field] of [['copy-link', link], ['copy-snippet', snippet]]) {
    byId(button).addEventListener('click', () => copy(field));
  }
  for (const button of document.querySelectorAll('.download')) {
    button.addEventListener('click', () => download(app));
  }
}

async function copy(field) {
  field.select();
  const status = byId('copy-status');
  try {
    await navigator.clipboard.writeText(field.value);
    status.textContent = 'Copied.';
  } catch {
    status.textContent = 'Selected: copy it with Ctrl+C.';
  }
}

// The picture as drawn, at its own size.
function download(app) {
  do app.draw(1, true); while (app.refines);
  app.relighter.canvas.toBlob((blob) => {
    const address = URL.createObjectURL(blob);
    const words = app.page.title.match(/[A-Za-z0-9]+/g) ?? ['picture'];
    el('a', { href: address, download: `${words.join('-')}.png` }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }, 'image/png');
}
