# SPDX-License-Identifier: Apache-2.0
"""Screens that are drawn: charts, test patterns, spreadsheets, code, dense text."""
import math
import os
import re

import numpy as np
from PIL import Image, ImageDraw

from common import HEIGHT, THEMES, WIDTH, Item, canvas, font, rng
from pictures import WORDS, found

# ---- charts ----


def axes(draw, box, theme, r, title):
    x0, y0, x1, y1 = box
    draw.rectangle(box, fill=theme[1])
    draw.text((x0 + 10, y0 - 34), title, font=font('bold', 22), fill=theme[2])
    for i in range(r.randint(4, 11)):
        y = y0 + (y1 - y0) * i // 10
        draw.line([x0, y, x1, y], fill=theme[3], width=1)
        draw.text((x0 - 56, y - 10), '%.1f' % (10 - i + r.random()), font=font('sans', 16), fill=theme[2])
    for i in range(11):
        x = x0 + (x1 - x0) * i // 10
        draw.text((x - 10, y1 + 8), str(i * r.randint(2, 9)), font=font('sans', 16), fill=theme[2])


def plot(draw, box, theme, r):
    x0, y0, x1, y1 = box
    kind = r.randrange(7)
    w, h = x1 - x0, y1 - y0
    colors = theme[4]
    if kind == 0:
        for k in range(r.randint(1, 5)):
            y, points = r.random(), []
            for i in range(120):
                y = min(0.98, max(0.02, y + r.gauss(0, 0.05)))
                points.append((x0 + w * i / 119, y1 - h * y))
            draw.line(points, fill=colors[k], width=r.randint(1, 4))
    elif kind == 1:
        n, groups = r.randint(4, 14), r.randint(1, 4)
        for i in range(n):
            for g in range(groups):
                left = x0 + w * (i + 0.1 + 0.8 * g / groups) / n
                draw.rectangle([left, y1 - h * r.uniform(0.05, 0.95), left + 0.8 * w / n / groups - 2, y1],
                               fill=colors[g])
    elif kind == 2:
        for k in range(r.randint(1, 4)):
            cx, cy, s = r.random(), r.random(), r.uniform(0.04, 0.2)
            for _ in range(r.randint(60, 400)):
                x, y = x0 + w * min(1, max(0, r.gauss(cx, s))), y1 - h * min(1, max(0, r.gauss(cy, s)))
                draw.ellipse([x - 3, y - 3, x + 3, y + 3], fill=colors[k])
    elif kind == 3:
        side, at = min(w, h) - 20, r.uniform(0, 360)
        left = (x0 + x1 - side) // 2
        for k in range(6):
            end = at + r.uniform(20, 90)
            draw.pieslice([left, y0 + 10, left + side, y0 + 10 + side], at, end, fill=colors[k])
            at = end
    elif kind == 4:
        n, m = r.randint(8, 40), r.randint(6, 24)
        f, p = r.uniform(0.1, 0.8), r.uniform(0, 6)
        for i in range(n):
            for j in range(m):
                t = 0.5 + 0.5 * math.sin(f * i + p) * math.cos(f * j * 1.3 - p)
                c = tuple(int(a * t + b * (1 - t)) for a, b in zip(colors[0], colors[1]))
                draw.rectangle([x0 + w * i // n, y0 + h * j // m, x0 + w * (i + 1) // n, y0 + h * (j + 1) // m], fill=c)
    elif kind == 5:
        low = np.zeros(100)
        for k in range(4):
            top = low + np.abs(np.cumsum([r.gauss(0, 0.02) for _ in range(100)])) * 0.4 + 0.08
            line = [(x0 + w * i / 99, y1 - h * min(1, top[i])) for i in range(100)]
            line += [(x0 + w * i / 99, y1 - h * min(1, low[i])) for i in range(99, -1, -1)]
            draw.polygon(line, fill=colors[k])
            low = top
    else:
        price = 0.5
        for i in range(70):
            new = min(0.95, max(0.05, price + r.gauss(0, 0.04)))
            x = x0 + w * (i + 0.5) / 70
            color = colors[2] if new > price else colors[1]
            draw.line([x, y1 - h * min(1, max(price, new) + 0.03), x, y1 - h * max(0, min(price, new) - 0.03)], fill=color)
            draw.rectangle([x - 4, y1 - h * max(price, new), x + 4, y1 - h * min(price, new)], fill=color)
            price = new


def chart(n):
    r = rng('chart %d' % n)
    theme = THEMES[n % len(THEMES)]
    image, draw = canvas(theme[0])
    columns, rows = r.choice([(1, 1), (2, 1), (2, 2), (3, 2), (1, 2), (3, 3), (4, 2)])
    for i in range(columns):
        for j in range(rows):
            box = (80 + i * (WIDTH - 60) // columns, 60 + j * (HEIGHT - 30) // rows,
                   (i + 1) * (WIDTH - 60) // columns + 20, (j + 1) * (HEIGHT - 30) // rows - 30)
            axes(draw, box, theme, r, ' '.join(r.sample(WORDS, 3)))
            plot(draw, box, theme, r)
    return image


# ---- test patterns ----

def pattern(n):
    r = rng('pattern %d' % n)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    u, v = x / WIDTH, y / HEIGHT
    kind = n % 12

    def two(mask):
        a, b = r.choice([((255,) * 3, (0,) * 3), ((255, 0, 0), (0, 0, 0)), ((128,) * 3, (160,) * 3),
                         ((0, 255, 0), (255, 0, 255)), ((255, 255, 0), (0, 0, 255)),
                         (tuple(r.randrange(256) for _ in range(3)), tuple(r.randrange(256) for _ in range(3)))])
        return np.where(mask[..., None], np.uint8(a), np.uint8(b))
    if kind == 0:  # colour bars
        colors = [tuple(r.choice([0, 64, 128, 191, 255]) for _ in range(3)) for _ in range(r.randint(5, 16))]
        out = np.uint8(colors)[(u * len(colors)).astype(int)]
        cut = int(HEIGHT * r.uniform(0.4, 0.9))
        out[cut:] = np.uint8([[c] * 3 for c in np.linspace(0, 255, 24)])[(u[cut:] * 24).astype(int)]
    elif kind == 1:  # checkerboard
        s = r.choice([1, 2, 4, 8, 16, 40, 90])
        out = two((x // s + y // s) % 2 == 0)
    elif kind == 2:  # stripes of any direction
        a, s = r.uniform(0, math.pi), r.uniform(3, 60)
        out = two(((x * math.cos(a) + y * math.sin(a)) / s) % 1 < r.uniform(0.2, 0.8))
    elif kind == 3:  # zone plate
        cx, cy, k = r.random() * WIDTH, r.random() * HEIGHT, r.uniform(0.0002, 0.0012)
        out = np.repeat(np.uint8(127.5 + 127.5 * np.cos(k * ((x - cx) ** 2 + (y - cy) ** 2)))[..., None], 3, 2)
    elif kind == 4:  # gradients
        a = r.uniform(0, 2 * math.pi)
        t = np.clip(0.5 + (u - 0.5) * math.cos(a) + (v - 0.5) * math.sin(a), 0, 1)[..., None]
        p, q = (np.float32([r.randrange(256) for _ in range(3)]) for _ in range(2))
        out = np.uint8(p * t + q * (1 - t))
    elif kind == 5:  # patches, as calibration charts have them
        rows, columns = r.randint(3, 9), r.randint(4, 14)
        table = np.uint8([[[r.randrange(256) for _ in range(3)] for _ in range(columns)] for _ in range(rows)])
        out = table[(v * rows).astype(int), (u * columns).astype(int)].copy()
        out[((u * columns) % 1 < 0.06) | ((v * rows) % 1 < 0.08)] = r.choice([0, 40, 255])
    elif kind == 6:  # Siemens stars
        out = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
        for _ in range(r.randint(2, 6)):
            cx, cy, rad, k = r.random() * WIDTH, r.random() * HEIGHT, r.uniform(150, 500), r.randint(12, 90)
            d = np.hypot(x - cx, y - cy)
            m = (d < rad) & (np.sin(k * np.arctan2(y - cy, x - cx)) > 0)
            out[d < rad] = 255
            out[m] = [r.randrange(160) for _ in range(3)]
    elif kind == 7:  # grid
        out = np.full((HEIGHT, WIDTH, 3), r.choice([0, 20, 255, 128]), np.uint8)
        s, w = r.choice([20, 32, 60, 120]), r.randint(1, 4)
        out[(x % s < w) | (y % s < w)] = [r.randrange(256) for _ in range(3)]
        out[np.abs(np.hypot(x - WIDTH / 2, y - HEIGHT / 2) - r.randint(200, 520)) < w] = [255, 80, 80]
    elif kind == 8:  # smooth noise
        columns = r.choice([8, 16, 40])
        small = np.uint8([[[r.randrange(256) for _ in range(3)] for _ in range(columns)] for _ in range(9)])
        out = np.asarray(Image.fromarray(small).resize((WIDTH, HEIGHT), Image.BICUBIC))
    elif kind == 9:  # windows of grey levels, from black to white
        k = r.randint(2, 16)
        levels = np.linspace(r.choice([0, 5]), r.choice([60, 128, 255]), k * k).astype(np.uint8).reshape(k, k)
        out = np.repeat(levels[(v * k).astype(int), (u * k).astype(int)][..., None], 3, 2) * \
            np.uint8([1, r.choice([0, 1]), r.choice([0, 1])])
    elif kind == 10:  # sweep
        f = r.uniform(60, 260)
        out = np.repeat(np.uint8(127.5 + 127.5 * np.sin(2 * math.pi * f * u * u) * (1 - v))[..., None], 3, 2)
    else:  # a window on black, as brightness meters use it
        out = np.full((HEIGHT, WIDTH, 3), r.choice([0, 0, 12, 60]), np.uint8)
        for _ in range(r.randint(1, 5)):
            w, h = r.uniform(0.1, 0.5), r.uniform(0.1, 0.5)
            a, b = r.uniform(0, 1 - w), r.uniform(0, 1 - h)
            out[(u >= a) & (u < a + w) & (v >= b) & (v < b + h)] = [r.choice([255, 255, 128, 0]) for _ in range(3)]
    return Image.fromarray(np.ascontiguousarray(out.astype(np.uint8)))


# ---- spreadsheets ----

def sheet(n):
    r = rng('sheet %d' % n)
    theme = THEMES[n % len(THEMES)]
    image, draw = canvas(theme[0])
    size = r.choice([15, 17, 20, 24])
    face, row = font('sans', size, n % 2), size + r.choice([7, 10, 14])
    top = r.choice([60, 130])
    draw.rectangle([0, 0, WIDTH, top], fill=theme[1])
    for i in range(9):
        draw.text((20 + 150 * i, 14), r.choice(WORDS).title(), font=font('sans', 20), fill=theme[2])
        if top > 60:
            draw.rectangle([20 + 60 * i, 60, 60 + 60 * i, 100], fill=r.choice(theme[4]))
    x, columns = 60, []
    while x < WIDTH:
        w = r.choice([70, 90, 120, 160, 240])
        columns.append((x, w, r.randrange(5)))
        x += w
    for j in range(top, HEIGHT - 40, row):
        line = (j - top) // row
        draw.rectangle([0, j, 60, j + row], fill=theme[1])
        draw.text((12, j + 3), str(line + n * 10), font=face, fill=theme[3])
        marked = r.random() < 0.06
        for k, (x, w, kind) in enumerate(columns):
            if line == 0:
                draw.rectangle([x, j, x + w, j + row], fill=theme[1])
                text = chr(65 + k % 26)
            elif r.random() < 0.08:
                text = ''
            else:
                text = ['%.2f' % r.uniform(-999, 9999), r.choice(WORDS) + ' ' + r.choice(WORDS), str(r.randrange(100000)),
                        '%d.%d %%' % (r.randrange(100), r.randrange(10)),
                        '2031-%02d-%02d' % (r.randint(1, 12), r.randint(1, 28))][kind]
                if marked or r.random() < 0.02:
                    draw.rectangle([x, j, x + w, j + row], fill=r.choice(theme[4]))
            while text and draw.textlength(text, font=face) > w - 8:
                text = text[:-1]
            at = x + 5 if kind == 1 else x + w - 5 - draw.textlength(text, font=face)
            draw.text((at, j + 3), text, font=face, fill=theme[2])
            draw.line([x, j, x, j + row], fill=theme[3])
        draw.line([0, j, WIDTH, j], fill=theme[3])
    if r.random() < 0.4:
        box = (1000, 420, 1700, 900)
        draw.rectangle([930, 360, 1760, 960], fill=theme[0], outline=theme[2])
        axes(draw, box, theme, r, r.choice(WORDS))
        plot(draw, box, theme, r)
    return image


# ---- code and terminals ----

KEYWORDS = re.compile(r'(#.*|//.*|"[^"]*"|\'[^\']*\'|\b\d+\b|\b(?:if|else|for|while|return|local|function|def|import|from|'
                      r'class|end|then|do|in|not|and|or|property|signal|true|false|null|var|new)\b|\[/?\w+\])')


def sources(root):
    paths = found(root, 'usr/share/games/wesnoth/1.16/data/**/*.lua') + \
        found(root, 'usr/share/games/wesnoth/1.16/data/**/*.cfg')
    return [p for p in paths if os.path.getsize(p) > 6000]


def code(n, path):
    r = rng('code %d' % n)
    theme = THEMES[r.randrange(len(THEMES))]
    image, draw = canvas(theme[0])
    with open(path, encoding='utf-8', errors='replace') as f:
        lines = f.read().expandtabs(4).split('\n')
    size = r.choice([14, 16, 18, 21, 26])
    face, step = font('mono', size, n % 2), int(size * 1.35)
    side = r.choice([0, 280])
    draw.rectangle([0, 0, side, HEIGHT], fill=theme[1])
    for i in range(34 if side else 0):
        draw.text((24 + 16 * (i % 3), 50 + i * 29), r.choice(WORDS) + r.choice(['.c', '.lua', '.cfg', '']),
                  font=font('sans', 17), fill=theme[2])
    draw.rectangle([side, 0, WIDTH, 36], fill=theme[1])
    draw.text((side + 30, 6), os.path.basename(path), font=font('sans', 18), fill=theme[2])
    panes = r.choice([1, 1, 2])
    for pane in range(panes):
        left = side + pane * (WIDTH - side) // panes
        right = left + (WIDTH - side) // panes
        start = r.randrange(max(1, len(lines) - 90))
        strip = Image.new('RGB', (right - left, HEIGHT - 40), theme[0])
        d = ImageDraw.Draw(strip)
        for i, line in enumerate(lines[start:start + HEIGHT // step]):
            y = 4 + i * step
            d.text((8, y), '%4d' % (start + i + 1), font=face, fill=theme[3])
            x = 8 + 6 * size * 0.6
            for piece in KEYWORDS.split(line[:180]):
                if piece:
                    special = KEYWORDS.fullmatch(piece)
                    kind = 0 if piece[0].isalpha() else 1 if piece[0] in '"\'' else 2 if piece[0] in '#/' else 3
                    d.text((x, y), piece, font=face, fill=theme[4][kind] if special else theme[2])
                    x += d.textlength(piece, font=face)
        image.paste(strip, (left, 38))
    return image


# ---- dense text ----

def words_of(root, language):
    """Plain paragraphs of the Debian handbook in a language."""
    out = []
    for path in found(root, 'usr/share/doc/debian-handbook/html/%s/*.html' % language):
        with open(path, encoding='utf-8', errors='replace') as f:
            text = f.read()
        for p in re.findall(r'<div class="para">(.*?)</div>', text, flags=re.S):
            p = re.sub(r'<[^>]*>', '', p)
            p = re.sub(r'\s+', ' ', p).replace('&nbsp;', ' ').replace('&amp;', '&').replace('&lt;', '<').replace('&gt;', '>')
            if len(p) > 60:
                out.append(p.strip())
    return out


def dense(n, paragraphs, kind):
    r = rng('dense %s %d' % (kind, n))
    theme = THEMES[r.choice([0, 0, 0, 1, 3, 4, 6])]
    image, draw = canvas(theme[0])
    size = r.choice([12, 14, 16, 19, 24])
    face = font('cjk', size, 0) if kind == 'cjk' else font(r.choice(['sans', 'serif', 'mono']), size, n)
    columns = r.choice([1, 2, 3, 4])
    width = (WIDTH - 40) // columns - 30
    step = int(size * r.uniform(1.2, 1.6))
    at = 0
    for c in range(columns):
        x, y = 30 + c * ((WIDTH - 40) // columns), 24
        while y < HEIGHT - step and at < len(paragraphs):
            text, at = paragraphs[at], at + 1
            rest = text
            while rest and y < HEIGHT - step:
                cut = max(4, int(len(rest) * width / max(1, draw.textlength(rest, font=face))))
                cut = min(len(rest), cut)
                while cut > 4 and draw.textlength(rest[:cut], font=face) > width:
                    cut -= 1
                if cut < len(rest) and kind != 'cjk' and ' ' in rest[:cut]:
                    cut = rest[:cut].rindex(' ') + 1
                draw.text((x, y), rest[:cut], font=face, fill=theme[2])
                rest = rest[cut:]
                y += step
            y += step // 2
    return image if at < len(paragraphs) else None


def texts(root, kind, languages, count):
    for language in languages:
        paragraphs = words_of(root, language)
        if kind == 'cjk':  # paragraphs that nobody has translated yet
            paragraphs = [p for p in paragraphs if sum(ord(c) > 0x3000 for c in p) > len(p) // 3]
        share = count // len(languages)
        piece = max(1, len(paragraphs) // max(1, share))
        for n in range(share):
            some = paragraphs[n * piece:] + paragraphs[:n * piece]
            if len(some) > 200:
                yield Item(kind, '%s %s %d' % (kind, language, n), lambda s=some, n=n: dense(n, s, kind))


def everything(root):
    for n in range(120):
        yield Item('chart', 'chart %d' % n, lambda n=n: chart(n))
    for n in range(108):
        yield Item('pattern', 'pattern %d' % n, lambda n=n: pattern(n))
    for n in range(110):
        yield Item('sheet', 'sheet %d' % n, lambda n=n: sheet(n))
    paths = sources(root)
    for n, path in enumerate(paths[::max(1, len(paths) // 120)][:120]):
        yield Item('code', 'code ' + os.path.relpath(path, root), lambda n=n, p=path: code(n, p))
    yield from texts(root, 'text', ['en-US', 'de-DE', 'es-ES', 'pl-PL'], 80)
    yield from texts(root, 'cjk', ['zh-CN', 'ja-JP', 'zh-TW'], 90)
