/* SPDX-License-Identifier: Apache-2.0 */
/* What moves in a report: the comparison of two pictures (divider, zoom, pan) and tables that sort. */
'use strict';

(() => {
  const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

  /* ---- comparing ---- */

  /* Both pictures lie on each other; the right one is cut off at the divider. `x` and `y` are where the picture's
   * corner lies, in shares of the stage, so that they outlast a change of the window's size. */
  class Viewer {
    constructor(figure) {
      this.figure = figure;
      this.zoom = 1;
      this.x = this.y = 0;
      this.split = 50;
      this.pointers = new Map();
      this.build();
      this.show([...figure.querySelectorAll(':scope > img')]);
      this.listen();
    }

    build() {
      const element = (name, parent) => {
        const e = document.createElement('div');
        e.className = name;
        if (parent) parent.append(e);
        return e;
      };
      this.stage = element('stage');
      this.stage.tabIndex = 0;
      this.stage.setAttribute('role', 'group');
      this.under = element('layer left-layer', this.stage);
      this.over = element('layer right-layer', this.stage);
      this.leftTag = element('tag left', this.stage);
      this.rightTag = element('tag right', this.stage);
      this.divider = element('divider', this.stage);
      this.divider.setAttribute('aria-hidden', 'true');
      this.figure.append(this.stage, document.getElementById('viewer-tools').content.cloneNode(true));
      for (const name of ['in', 'out', 'fit', 'real', 'full', 'difference', 'scale', 'split', 'pick', 'left', 'right'])
        this[name + 'Tool'] = this.figure.querySelector('.tools .' + name);
      if (!this.stage.requestFullscreen) this.fullTool.hidden = true;
      this.figure.classList.add('on');
    }

    /* Takes pictures (img elements with data-label): the first against the second, others to choose. */
    show(images) {
      this.images = images;
      const [w, h] = ['width', 'height'].map(a => +images[0].getAttribute(a));
      this.width = w;
      this.figure.style.setProperty('--ratio', w / h);
      images.forEach(i => i.remove());
      for (const [tool, chosen] of [[this.leftTool, 0], [this.rightTool, 1]]) {
        tool.replaceChildren(...images.map((image, i) => new Option(image.dataset.label, i)));
        tool.value = chosen;
      }
      this.pickTool.hidden = images.length < 3;
      this.choose();
      this.fit();
    }

    choose() {
      const [left, right] = [this.leftTool, this.rightTool].map(tool => this.images[+tool.value]);
      this.under.replaceChildren(left);
      /* One picture on both sides needs two elements. */
      this.over.replaceChildren(left === right ? right.cloneNode() : right);
      this.leftTag.textContent = left.dataset.label;
      this.rightTag.textContent = right.dataset.label;
      this.stage.setAttribute('aria-label', `${left.dataset.label} on the left of the divider, ${right.dataset.label} ` +
        'on the right. Plus and minus zoom, arrow keys move.');
      this.draw();
    }

    get box() { return this.stage.getBoundingClientRect(); }
    get most() { return Math.max(8, 8 * this.width / (this.box.width || 1)); }

    draw() {
      const image = this.stage.querySelectorAll('img');
      this.x = clamp(this.x, 1 - this.zoom, 0);
      this.y = clamp(this.y, 1 - this.zoom, 0);
      for (const i of image) i.style.transform = `translate(${this.x * 100}%, ${this.y * 100}%) scale(${this.zoom})`;
      this.over.style.clipPath = `inset(0 0 0 ${this.split}%)`;
      this.divider.style.left = this.split + '%';
      this.splitTool.value = this.split;
      this.splitTool.setAttribute('aria-valuetext', `${Math.round(this.split)} percent ${this.leftTag.textContent}`);
      const scale = this.zoom * this.box.width / this.width;
      this.scaleTool.textContent = scale ? Math.round(scale * 100) + ' %' : '';
      this.outTool.disabled = this.fitTool.disabled = this.zoom <= 1;
      this.inTool.disabled = this.zoom >= this.most;
      this.stage.classList.toggle('zoomed', this.zoom > 1);
      this.stage.classList.toggle('crisp', scale >= 2);
    }

    /* Zooms so that the point (px, py) of the stage, in shares of it, stays where it is. */
    scaleTo(zoom, px = 0.5, py = 0.5) {
      zoom = clamp(zoom, 1, this.most);
      this.x = px - (px - this.x) * zoom / this.zoom;
      this.y = py - (py - this.y) * zoom / this.zoom;
      this.zoom = zoom;
      this.draw();
    }

    fit() { this.zoom = 1; this.x = this.y = 0; this.draw(); }
    real() { this.scaleTo(this.width / this.box.width / (window.devicePixelRatio || 1)); }

    difference() {
      const on = this.stage.classList.toggle('difference');
      this.differenceTool.setAttribute('aria-pressed', on);
      this.splitTool.disabled = on;
    }

    full() {
      if (document.fullscreenElement) document.exitFullscreen();
      else if (this.figure.requestFullscreen) this.figure.requestFullscreen().catch(() => {});
    }

    key(event) {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const step = event.shiftKey ? 0.25 : 0.05;
      const move = (dx, dy) => { this.x -= dx * step; this.y -= dy * step; this.draw(); };
      const slide = d => { this.split = clamp(this.split + d * step * 40, 0, 100); this.draw(); };
      const zoomed = this.zoom > 1;
      const keys = {
        '+': () => this.scaleTo(this.zoom * 1.25), '=': () => this.scaleTo(this.zoom * 1.25),
        '-': () => this.scaleTo(this.zoom / 1.25), '0': () => this.fit(), '1': () => this.real(),
        'd': () => this.difference(), 'f': () => this.full(),
        'ArrowLeft': () => zoomed ? move(-1, 0) : slide(-1), 'ArrowRight': () => zoomed ? move(1, 0) : slide(1),
        'Home': () => slide(-1e3), 'End': () => slide(1e3),
      };
      if (zoomed) Object.assign(keys, { 'ArrowUp': () => move(0, -1), 'ArrowDown': () => move(0, 1) });
      const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (act) { act(); event.preventDefault(); }
    }

    /* Of the pointers that are down: their middle in shares of the stage, and how far they are apart. */
    touch() {
      const box = this.box, all = [...this.pointers.values()];
      const middle = axis => all.reduce((sum, p) => sum + p[axis], 0) / all.length;
      return { x: (middle('x') - box.left) / box.width, y: (middle('y') - box.top) / box.height,
        apart: all.length > 1 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0 };
    }

    down(event) {
      if (event.button > 0) return;
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      this.stage.setPointerCapture(event.pointerId);
      this.sliding = this.pointers.size === 1 && (event.target === this.divider || this.zoom <= 1);
      this.last = this.touch();
      if (this.sliding && event.target !== this.divider && event.pointerType === 'mouse') this.slideTo(this.last.x);
      this.stage.classList.add('moving');
    }

    slideTo(x) { this.split = clamp(x * 100, 0, 100); this.draw(); }

    move(event) {
      if (!this.pointers.has(event.pointerId)) return;
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      const now = this.touch();
      if (this.sliding) {
        this.slideTo(now.x);
      } else {
        this.x += now.x - this.last.x;
        this.y += now.y - this.last.y;
        this.scaleTo(this.last.apart && now.apart ? this.zoom * now.apart / this.last.apart : this.zoom, now.x, now.y);
      }
      this.last = now;
    }

    up(event) {
      this.pointers.delete(event.pointerId);
      if (this.pointers.size) this.last = this.touch();
      else { this.sliding = false; this.stage.classList.remove('moving'); }
    }

    wheel(event) {
      /* At the smallest scale the wheel scrolls the page on. */
      if (event.deltaY > 0 && this.zoom <= 1) return;
      event.preventDefault();
      const box = this.box, lines = event.deltaMode === 1 ? 33 : 1;
      this.scaleTo(this.zoom * Math.exp(-clamp(event.deltaY * lines, -240, 240) / 400),
        (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    }

    listen() {
      const s = this.stage;
      s.addEventListener('pointerdown', e => this.down(e));
      s.addEventListener('pointermove', e => this.move(e));
      for (const name of ['pointerup', 'pointercancel']) s.addEventListener(name, e => this.up(e));
      s.addEventListener('wheel', e => this.wheel(e), { passive: false });
      s.addEventListener('dblclick', e => {
        const box = this.box;
        if (this.zoom > 1) this.fit();
        else this.scaleTo(3, (e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height);
      });
      s.addEventListener('dragstart', e => e.preventDefault());
      s.addEventListener('keydown', e => this.key(e));
      this.splitTool.addEventListener('input', () => { this.split = +this.splitTool.value; this.draw(); });
      this.inTool.addEventListener('click', () => this.scaleTo(this.zoom * 1.5));
      this.outTool.addEventListener('click', () => this.scaleTo(this.zoom / 1.5));
      this.fitTool.addEventListener('click', () => this.fit());
      this.realTool.addEventListener('click', () => this.real());
      this.fullTool.addEventListener('click', () => this.full());
      this.differenceTool.addEventListener('click', () => this.difference());
      this.leftTool.addEventListener('change', () => this.choose());
      this.rightTool.addEventListener('change', () => this.choose());
      new ResizeObserver(() => this.draw()).observe(s);
    }
  }

  const viewers = [...document.querySelectorAll('figure.viewer')].map(figure => new Viewer(figure));

  /* ---- tables ---- */

  /* A row's pictures wait in a template: the browser decodes them when they are first shown. */
  function showPair(row) {
    const pair = document.getElementById('pair-' + row.dataset.pair), title = document.getElementById('pair-name');
    viewers[0].show([...pair.content.cloneNode(true).querySelectorAll('img')]);
    if (title) title.textContent = row.querySelector('th').textContent.trim();
    for (const other of row.parentNode.rows) {
      other.classList.toggle('shown', other === row);
      const button = other.querySelector('button');
      if (button) button.setAttribute('aria-pressed', other === row);
    }
  }

  for (const row of document.querySelectorAll('tr[data-pair]')) {
    row.classList.add('pick');
    row.addEventListener('click', event => {
      showPair(row);
      if (event.target.closest('button')) {
        const calm = matchMedia('(prefers-reduced-motion: reduce)').matches;
        viewers[0].stage.scrollIntoView({ behavior: calm ? 'auto' : 'smooth', block: 'nearest' });
      }
    });
  }

  /* Numbers by value, names by letters and by the numbers in them; what was not measured comes last. */
  function sort(table, column, way) {
    const key = row => row.cells[column].dataset.v ?? row.cells[column].textContent.trim();
    const number = table.tHead.rows[0].cells[column].hasAttribute('data-number');
    const order = (a, b) => {
      const p = key(a), q = key(b);
      if (!number) return way * p.localeCompare(q, undefined, { numeric: true });
      if (p === '' || q === '') return (p === '') - (q === '');
      return +p === +q ? 0 : way * (+p < +q ? -1 : 1);
    };
    table.tBodies[0].append(...[...table.tBodies[0].rows].sort(order));
    [...table.tHead.rows[0].cells].forEach((cell, i) => {
      if (i === column) cell.setAttribute('aria-sort', way > 0 ? 'ascending' : 'descending');
      else cell.removeAttribute('aria-sort');
    });
  }

  for (const table of document.querySelectorAll('table.sortable')) {
    [...table.tHead.rows[0].cells].forEach((cell, column) => {
      const button = document.createElement('button');
      button.type = 'button';
      button.append(...cell.childNodes);
      cell.append(button);
      button.addEventListener('click', () => sort(table, column, cell.getAttribute('aria-sort') === 'ascending' ? -1 : 1));
    });
  }
})();
