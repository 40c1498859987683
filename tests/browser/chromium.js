/* SPDX-License-Identifier: Apache-2.0 */
/*
 * chromium.js: a headless Chromium driven over its DevTools protocol, through a pipe (messages of JSON, each ended by a
 * NUL), so that nothing but node and the browser is needed. Network access is cut off: a page that asks for anything
 * outside its own file is noticed.
 */
'use strict';
const { spawn } = require('child_process');
const { pathToFileURL } = require('url');
const fs = require('fs');
const os = require('os');
const path = require('path');

class Browser {
  static async start(program) {
    const browser = new Browser();
    browser.profile = fs.mkdtempSync(path.join(os.tmpdir(), 'brace-browser-'));
    browser.child = spawn(program, ['--headless=new', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage', '--no-first-run',
      '--hide-scrollbars', '--force-color-profile=srgb', `--user-data-dir=${browser.profile}`, '--remote-debugging-pipe',
      'about:blank'], { stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe'] });
    browser.waiting = new Map();
    browser.last = 0;
    browser.problems = [];
    browser.requests = [];
    browser.waiters = [];
    let text = '';
    browser.child.stdio[4].setEncoding('utf8');
    browser.child.stdio[4].on('data', data => {
      text += data;
      for (let end; (end = text.indexOf('\0')) >= 0; text = text.slice(end + 1)) browser.take(JSON.parse(text.slice(0, end)));
    });
    const { targetInfos } = await browser.send('Target.getTargets');
    const page = targetInfos.find(t => t.type === 'page');
    browser.session = (await browser.send('Target.attachToTarget', { targetId: page.targetId, flatten: true })).sessionId;
    for (const domain of ['Page', 'Runtime', 'Log', 'Network']) await browser.send(domain + '.enable');
    await browser.send('Network.emulateNetworkConditions', { offline: true, latency: 0, downloadThroughput: 0, uploadThroughput: 0 });
    return browser;
  }

  take(message) {
    if (message.id) {
      const { resolve, reject } = this.waiting.get(message.id);
      this.waiting.delete(message.id);
      if (message.error) reject(new Error(message.error.message)); else resolve(message.result);
      return;
    }
    const p = message.params;
    if (message.method === 'Runtime.exceptionThrown') this.problems.push(p.exceptionDetails.exception?.description ?? p.exceptionDetails.text);
    if (message.method === 'Runtime.consoleAPICalled' && ['error', 'warning', 'assert'].includes(p.type))
      this.problems.push(p.args.map(a => a.value ?? a.description).join(' '));
    if (message.method === 'Log.entryAdded' && ['error', 'warning'].includes(p.entry.level)) this.problems.push(p.entry.text);
    if (message.method === 'Network.requestWillBeSent') this.requests.push(p.request.url);
    this.waiters = this.waiters.filter(w => w.method !== message.method || (w.resolve(p), false));
  }

  send(method, params = {}) {
    const id = ++this.last;
    this.child.stdio[3].write(JSON.stringify({ id, method, params, sessionId: this.session }) + '\0');
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  event(method) { return new Promise(resolve => this.waiters.push({ method, resolve })); }

  /* What the expression gives in the page; promises are waited for. */
  async run(expression) {
    const r = await this.send('Runtime.evaluate', { expression, awaitPromise: true, returnByValue: true, userGesture: true });
    if (r.exceptionDetails) throw new Error(r.exceptionDetails.exception?.description ?? r.exceptionDetails.text);
    return r.result.value;
  }

  async size(width, height, look = {}) {
    this.width = width;
    this.look = look;
    const { dark = false, touch = false } = look;
    await this.metrics(height);
    await this.send('Emulation.setTouchEmulationEnabled', { enabled: touch });
    await this.send('Emulation.setEmulatedMedia', { features: [{ name: 'prefers-color-scheme', value: dark ? 'dark' : 'light' }] });
  }
  metrics(height) {
    return this.send('Emulation.setDeviceMetricsOverride',
      { width: this.width, height, deviceScaleFactor: this.look.scale ?? 1, mobile: this.look.touch ?? false });
  }

  async open(file) {
    const loaded = this.event('Page.loadEventFired');
    await this.send('Page.navigate', { url: pathToFileURL(path.resolve(file)).href });
    await loaded;
    await this.settle();
  }

  /* Pictures decoded, two frames drawn. */
  settle() {
    return this.run(`Promise.all([...document.images].map(i => { i.loading = 'eager'; return i.decode().catch(() => {}); }))
      .then(() => new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))).then(() => 0)`);
  }

  async mouse(type, x, y, more = {}) {
    await this.send('Input.dispatchMouseEvent', { type, x, y, button: 'left', buttons: type === 'mouseReleased' ? 0 : 1, clickCount: 1, ...more });
  }
  async drag(x0, y0, x1, y1) {
    await this.mouse('mousePressed', x0, y0);
    for (let i = 1; i <= 4; i++) await this.mouse('mouseMoved', x0 + (x1 - x0) * i / 4, y0 + (y1 - y0) * i / 4);
    await this.mouse('mouseReleased', x1, y1);
    await this.settle();
  }
  async key(key) {
    await this.send('Input.dispatchKeyEvent', { type: 'keyDown', key, text: key.length === 1 ? key : undefined });
    await this.send('Input.dispatchKeyEvent', { type: 'keyUp', key });
    await this.settle();
  }
  wheel(x, y, deltaY) { return this.send('Input.dispatchMouseEvent', { type: 'mouseWheel', x, y, deltaX: 0, deltaY }); }
  touch(type, points) { return this.send('Input.dispatchTouchEvent', { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) }); }

  /* PNG, of the window or a part of the page. */
  async shot(clip) {
    const { data } = await this.send('Page.captureScreenshot', { format: 'png', ...(clip && { clip: { ...clip, scale: 1 } }) });
    return data;
  }
  /* The whole page into a file: the window is made as high as the page. */
  async picture(file) {
    await this.metrics(await this.run('document.documentElement.scrollHeight'));
    await this.settle();
    fs.writeFileSync(file, Buffer.from(await this.shot(), 'base64'));
  }

  /* The colour of a pixel of the window as it is shown. The page itself decodes the screenshot: it has a canvas. */
  async pixel(x, y) {
    const top = await this.run('[scrollX, scrollY]'); /* clips are counted from the page's corner */
    const data = await this.shot({ x: Math.round(x + top[0]), y: Math.round(y + top[1]), width: 1, height: 1 });
    return this.run(`new Promise(r => { const i = new Image(); i.onload = () => { const c = document.createElement('canvas');
      c.width = c.height = 1; const t = c.getContext('2d'); t.drawImage(i, 0, 0); r([...t.getImageData(0, 0, 1, 1).data.slice(0, 3)]); };
      i.src = 'data:image/png;base64,${data}'; })`);
  }

  async stop() {
    this.child.kill('SIGKILL');
    await new Promise(resolve => this.child.exitCode !== null || this.child.signalCode !== null ? resolve() : this.child.once('exit', resolve));
    fs.rmSync(this.profile, { recursive: true, force: true, maxRetries: 5 });
  }
}

module.exports = Browser;
