/* SPDX-License-Identifier: Apache-2.0 */
/*
 * report.js: reports as a person meets them in a browser.
 *   node report.js CHROMIUM RESTORE.html METRICS.html [FOLDER for screenshots]
 */
'use strict';
const path = require('path');
const Browser = require('./chromium.js');

let checks = 0, failures = 0;
function check(what, good, seen) {
  checks++;
  if (good) return;
  failures++;
  console.log(`FAILED: ${what}${seen === undefined ? '' : ': ' + JSON.stringify(seen)}`);
}
const apart = (a, b) => Math.hypot(...a.map((v, i) => v - b[i]));

/* Where left and right picture differ the most (a cell of a 32 x 24 grid, away from the rim), and both colours there. */
const spot = `(() => {
  const cells = [...document.querySelectorAll('.stage img')].map(image => {
    const c = document.createElement('canvas');
    c.width = 32; c.height = 24;
    const t = c.getContext('2d');
    t.imageSmoothingQuality = 'high';
    t.drawImage(image, 0, 0, 32, 24);
    return t.getImageData(0, 0, 32, 24).data;
  });
  let best = { d: -1 };
  for (let y = 3; y < 21; y++) for (let x = 4; x < 14; x++) {
    const [a, b] = cells.map(c => [...c.slice(4 * (32 * y + x), 4 * (32 * y + x) + 3)]);
    const d = Math.hypot(...a.map((v, i) => v - b[i]));
    if (d > best.d) best = { d, x: (x + 0.5) / 32, y: (y + 0.5) / 24, a, b };
  }
  return best;
})()`;
const state = `(() => {
  const box = document.querySelector('.stage').getBoundingClientRect();
  const images = [...document.querySelectorAll('.stage img')];
  return { x: box.x, y: box.y, w: box.width, h: box.height, moved: images.map(i => i.style.transform),
    zoom: +/scale\\(([^)]*)\\)/.exec(images[0].style.transform)[1], split: +document.querySelector('.split').value,
    clip: document.querySelector('.right-layer').style.clipPath, labels: [...document.querySelectorAll('.tag')].map(t => t.textContent),
    wide: document.documentElement.scrollWidth, title: document.querySelector('#pair-name')?.textContent,
    dark: getComputedStyle(document.body).backgroundColor };
})()`;

async function opened(browser, file, name) {
  browser.problems = [];
  browser.requests = [];
  await browser.open(file);
  await browser.run(`document.querySelector('.stage').scrollIntoView({ block: 'start' })`);
  await browser.settle();
  check(`${name}: errors on the console`, browser.problems.length === 0, browser.problems);
  const outside = browser.requests.filter(url => !url.startsWith('data:') && !url.startsWith('file:'));
  check(`${name}: requests to elsewhere`, outside.length === 0, outside);
  const files = browser.requests.filter(url => url.startsWith('file:') && !url.endsWith(path.basename(file)));
  check(`${name}: requests for other files`, files.length === 0, files);
  check(`${name}: names did not become code`, await browser.run('window.hacked === undefined'));
  check(`${name}: pictures are there`, await browser.run('[...document.images].every(i => i.complete && i.naturalWidth > 0)'));
}

/* Everything that can be used, and every picture, has a name that a screen reader says. */
async function named(browser, name) {
  await browser.send('Accessibility.enable');
  const { nodes } = await browser.send('Accessibility.getFullAXTree');
  const roles = ['button', 'slider', 'combobox', 'image', 'img', 'columnheader', 'rowheader', 'region'];
  const of = nodes.filter(n => !n.ignored && roles.includes(n.role?.value));
  check(`${name}: things to name`, of.length > 10, of.length);
  const nameless = of.filter(n => !n.name?.value?.trim()).map(n => n.role.value);
  check(`${name}: nameless`, nameless.length === 0, nameless);
  await browser.send('Accessibility.disable');
}

const slide = value => `(() => { const s = document.querySelector('.split'); s.value = ${value};
  s.dispatchEvent(new Event('input', { bubbles: true })); })()`;

async function divider(browser) {
  const at = await browser.run(spot);
  check('the two pictures differ', at.d > 20, at.d);
  let s = await browser.run(state);
  const px = s.x + at.x * s.w, py = s.y + at.y * s.h;
  check('starts in the middle', s.split === 50, s.split);
  const before = await browser.pixel(px, py);
  check('left of the divider is the left picture', apart(before, at.a) < apart(before, at.b), { before, at });
  await browser.run(slide(2));
  await browser.settle();
  const after = await browser.pixel(px, py);
  check('right of the divider is the right picture', apart(after, at.b) < apart(after, at.a), { after, at });
  check('the pixel changed', apart(before, after) > 10, { before, after });
  s = await browser.run(state);
  check('the clip follows', s.clip.replace(/0px/g, '0') === 'inset(0 0 0 2%)', s.clip);

  /* By dragging. */
  await browser.drag(s.x + 0.02 * s.w, s.y + s.h / 2, s.x + 0.75 * s.w, s.y + s.h / 2);
  s = await browser.run(state);
  check('dragged to three quarters', Math.abs(s.split - 75) < 1, s.split);
  check('the left picture again', apart(await browser.pixel(px, py), before) < 6);

  /* By keys. */
  await browser.run(`document.querySelector('.stage').focus({ preventScroll: true })`);
  await browser.key('ArrowLeft');
  const keyed = await browser.run(state);
  check('an arrow key moves it', keyed.split < s.split && keyed.split > s.split - 10, keyed.split);
  await browser.key('Home');
  check('Home', (await browser.run(state)).split === 0);
  await browser.key('End');
  check('End', (await browser.run(state)).split === 100);
  await browser.run(slide(50));
}

async function zoom(browser) {
  const at = await browser.run(spot);
  let s = await browser.run(state);
  const px = s.x + at.x * s.w, py = s.y + at.y * s.h;
  await browser.wheel(px, py, -240);
  await browser.wheel(px, py, -240);
  await browser.settle();
  s = await browser.run(state);
  check('the wheel zooms', s.zoom > 2, s.zoom);
  check('both in step', s.moved[0] === s.moved[1], s.moved);
  const seen = await browser.pixel(px, py);
  check('what is under the pointer stays', apart(seen, at.a) < apart(seen, at.b) || apart(seen, at.a) < 60, { seen, at });
  const old = s.moved[0];
  await browser.drag(px, py, px + 60, py + 40);
  s = await browser.run(state);
  check('dragging moves the picture', s.moved[0] !== old && s.moved[0] === s.moved[1], s.moved);
  check('and not the divider', s.split === 50, s.split);
  await browser.run(`document.querySelector('.stage').focus({ preventScroll: true })`);
  await browser.key('0');
  check('0 shows all', (await browser.run(state)).zoom === 1);
  await browser.key('+');
  check('+ zooms', (await browser.run(state)).zoom > 1);
  await browser.key('-');
  check('- zooms out', (await browser.run(state)).zoom === 1);
  await browser.run(`document.querySelector('.tools .in').click()`);
  check('a button zooms', (await browser.run(state)).zoom === 1.5);
  for (let i = 0; i < 30; i++) await browser.run(`document.querySelector('.tools .in').click()`);
  check('there is an end to it', await browser.run(`document.querySelector('.tools .in').disabled`));
  await browser.run(`document.querySelector('.tools .fit').click()`);
  check('Fit', (await browser.run(state)).zoom === 1);
  await browser.key('d');
  check('difference', await browser.run(`document.querySelector('.difference[aria-pressed="true"]') !== null`));
  await browser.key('d');
  check('and back', await browser.run(`document.querySelector('.stage.difference') === null`));
}

async function phone(browser, file, name, shots) {
  await browser.size(360, 740, { touch: true, scale: 2 });
  await opened(browser, file, name + ' on a phone');
  let s = await browser.run(state);
  check(`${name}: nothing sticks out at phone width`, s.wide <= 360, s.wide);
  const small = await browser.run(`[...document.querySelectorAll('.tools button')].filter(b => b.getBoundingClientRect().height < 34).length`);
  check(`${name}: buttons are large enough to touch`, small === 0, small);
  const x = s.x + s.w / 2, y = s.y + s.h / 2;
  await browser.touch('touchStart', [[x - 20, y], [x + 20, y]]);
  for (let d = 30; d <= 80; d += 10) await browser.touch('touchMove', [[x - d, y], [x + d, y]]);
  await browser.touch('touchEnd', []);
  await browser.settle();
  s = await browser.run(state);
  check(`${name}: two fingers zoom`, s.zoom > 2, s.zoom);
  await browser.run(`document.querySelector('.tools .fit').click()`);
  await browser.touch('touchStart', [[x, y]]);
  for (let d = 0; d <= 80; d += 10) await browser.touch('touchMove', [[x + d, y]]);
  await browser.touch('touchEnd', []);
  await browser.settle();
  s = await browser.run(state);
  check(`${name}: one finger moves the divider`, Math.abs(s.split - (50 + 8000 / s.w)) < 2, s.split);
  if (shots) await browser.picture(path.join(shots, name + '-phone.png'));
}

async function look(browser, file, name, shots) {
  for (const dark of [false, true]) {
    await browser.size(1280, 900, { dark });
    await opened(browser, file, `${name}, ${dark ? 'dark' : 'light'}`);
    const ground = (await browser.run(state)).dark.match(/\d+/g).map(Number);
    check(`${name}: the ground is ${dark ? 'dark' : 'light'}`, dark ? ground[0] < 60 : ground[0] > 200, ground);
    if (shots) await browser.picture(path.join(shots, `${name}-${dark ? 'dark' : 'light'}.png`));
  }
}

async function restore(browser, file) {
  await browser.size(1280, 900);
  await opened(browser, file, 'restore');
  await named(browser, 'restore');
  await divider(browser);
  await zoom(browser);
  /* The truth can be chosen for either side. */
  const choose = (side, i) => `(() => { const s = document.querySelector('select.${side}'); s.value = ${i}; s.dispatchEvent(new Event('change')); })()`;
  check('three pictures', await browser.run(`document.querySelectorAll('select.left option').length`) === 3);
  await browser.run(choose('left', 2));
  check('the truth on the left', (await browser.run(state)).labels[0] === 'Truth');
  await browser.run(choose('right', 2));
  check('the same on both sides', await browser.run(`document.querySelectorAll('.stage img').length`) === 2);
  check('no error while used', browser.problems.length === 0, browser.problems);

  /* Without script both pictures are simply there. */
  await browser.send('Emulation.setScriptExecutionDisabled', { value: true });
  const loaded = browser.event('Page.loadEventFired');
  await browser.send('Page.reload');
  await loaded;
  await browser.send('Emulation.setScriptExecutionDisabled', { value: false });
  check('without script', await browser.run(`[...document.querySelectorAll('.viewer > img')].filter(i => i.getBoundingClientRect().width > 100).length`) === 3);
}

async function metrics(browser, file) {
  await browser.size(1280, 900);
  await opened(browser, file, 'metrics');
  await named(browser, 'metrics');
  const names = () => browser.run(`[...document.querySelectorAll('tbody th')].map(c => c.textContent.trim())`);
  const values = column => browser.run(`[...document.querySelectorAll('tbody tr')].map(r => r.cells[${column}].dataset.v)`);
  const head = column => browser.run(`document.querySelectorAll('thead button')[${column}].click()`);
  check('only the shown pair is decoded', await browser.run('document.images.length') === 2);
  const start = await names();
  check('rows', start.length === 4, start);
  await head(1);
  const up = await values(1);
  check('sorted up, not measured last', up[3] === '' && +up[0] <= +up[1] && +up[1] <= +up[2], up);
  check('aria-sort', await browser.run(`document.querySelector('th[aria-sort]').getAttribute('aria-sort')`) === 'ascending');
  await head(1);
  const down = await values(1);
  check('sorted down, infinity first', down[0] === 'Infinity' && down[3] === '', down);
  await head(0);
  check('sorted by name', (await names()).join() === [...start].sort((a, b) => a.localeCompare(b, undefined, { numeric: true })).join());
  check('mean and deviation stay', await browser.run(`document.querySelectorAll('tfoot tr').length`) === 2);

  const source = `document.querySelector('.left-layer img').src.length`;
  const old = await browser.run(source), title = (await browser.run(state)).title;
  await browser.run(`document.querySelector('tbody tr[data-pair]:not(.shown) button').focus()`);
  await browser.run(`document.activeElement.click()`);
  await browser.settle();
  const now = await browser.run(state);
  check('another pair is shown', now.title !== title && await browser.run(source) !== old, now.title);
  check('its row is marked', await browser.run(`document.querySelector('tr.shown th').textContent.trim()`) === now.title);
  check('labels', now.labels.join() === 'Prediction,Truth', now.labels);
  check('no error while used', browser.problems.length === 0, browser.problems);
}

(async () => {
  const [chromium, restored, measured, shots] = process.argv.slice(2);
  const browser = await Browser.start(chromium);
  const limit = setTimeout(() => { console.log('FAILED: the browser hangs'); browser.child.kill('SIGKILL'); process.exit(1); }, 240e3);
  try {
    await restore(browser, restored);
    await metrics(browser, measured);
    for (const [file, name] of [[restored, 'restore'], [measured, 'metrics']]) {
      await look(browser, file, name, shots);
      await phone(browser, file, name, shots);
    }
  } catch (error) {
    failures++;
    console.log('FAILED: ' + error.stack);
  }
  clearTimeout(limit);
  await browser.stop();
  console.log(`${checks} checks, ${failures} failed`);
  process.exit(failures ? 1 : 0);
})();
