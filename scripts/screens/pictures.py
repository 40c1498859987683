# SPDX-License-Identifier: Apache-2.0
"""Screens from pictures in packages: wallpapers, games, illustrations, dialogs."""
import glob
import io
import os
import re

from PIL import Image, ImageDraw

import rcc
from common import HEIGHT, THEMES, WIDTH, Item, canvas, cover, flat, font, rng


def found(root, pattern):
    return sorted(glob.glob(os.path.join(root, pattern), recursive=True))


def opened(path):
    return Image.open(path)


# ---- wallpapers ----

def wallpapers(root):
    chosen = {}
    for path in found(root, 'usr/share/wallpapers/*/contents/images*/*'):
        m = re.search(r'wallpapers/([^/]+)/.*?(\d+)x(\d+)\.(jpg|png)$', path)
        if m and int(m[2]) > int(m[3]):
            size, old = int(m[2]) * int(m[3]), chosen.get(m[1], (0, ''))
            chosen[m[1]] = max(old, (size, path))
    paths = [p for _, p in chosen.values()]
    for path in found(root, 'usr/share/backgrounds/**/*'):
        # One of the light and the dark version only: they show the same.
        if path.endswith(('.jpg', '.png', '.webp')) and not path.endswith('-d.webp'):
            paths.append(path)
    for path in sorted(paths):
        yield Item('static', os.path.relpath(path, root), lambda p=path: cover(opened(p)), lossy=True)


# ---- Wesnoth: story pictures, portraits, maps ----

def wesnoth_root(root):
    return os.path.join(root, 'usr/share/games/wesnoth/1.16')


def illustrations(root):
    for path in found(wesnoth_root(root), '**/*'):
        if not path.endswith(('.jpg', '.webp', '.png')) or '/units/' in path or '/terrain/' in path:
            continue
        try:
            with Image.open(path) as image:
                w, h = image.size
        except OSError:
            continue
        key = os.path.relpath(path, root)
        if w >= 1000 and h >= 600 and '/portraits/' not in path and not mostly_clear(path):
            yield Item('art', key, lambda p=path: cover(opened(p)), lossy=True)


def mostly_clear(path):
    """A layer of labels that the game puts over another picture."""
    with Image.open(path) as image:
        if image.mode not in ('RGBA', 'LA', 'PA') and 'transparency' not in image.info:
            return False
        alpha = image.convert('RGBA').getchannel('A').resize((64, 36), Image.BOX)
    return sum(alpha.getdata()) < 0.5 * 255 * 64 * 36


def portraits(root):
    paths = [p for p in found(wesnoth_root(root), '**/portraits/**/*')
             if p.endswith(('.webp', '.png')) and min(Image.open(p).size) >= 300]
    for n in range(0, len(paths) - 1, 2):
        def make(pair=paths[n:n + 2], n=n):
            r = rng('portrait %d' % n)
            theme = THEMES[r.randrange(len(THEMES))]
            image, draw = canvas(theme[0])
            for y in range(0, HEIGHT, 4):
                c = theme[4][n % 6]
                draw.rectangle([0, y, WIDTH, y + 3], fill=tuple(int(v * (0.15 + 0.5 * y / HEIGHT)) for v in c))
            for i, path in enumerate(pair):
                p = opened(path).convert('RGBA')
                s = 900 / max(p.size)
                p = p.resize((round(p.width * s), round(p.height * s)), Image.LANCZOS)
                image.paste(p, (60 if i == 0 else WIDTH - 60 - p.width, HEIGHT - 140 - p.height), p)
            draw.rectangle([0, HEIGHT - 180, WIDTH, HEIGHT], fill=theme[1])
            words = os.path.basename(pair[0]).split('.')[0] + ': ' + ' '.join(
                r.choice(WORDS) for _ in range(26))
            wrap(draw, words, (80, HEIGHT - 160), WIDTH - 160, font('serif', 34), theme[2])
            return image
        yield Item('art', 'portraits %d' % n, make, lossy=True)


WORDS = ('the kingdom lies beyond the river and our enemies wait in winter hills while old roads lead north to '
         'castles of stone where ships of men and elves may find gold again before night falls on that forest').split()


def wrap(draw, text, at, width, face, fill, gap=1.25, bottom=HEIGHT):
    x, y = at
    line = ''
    height = int(face.size * gap)
    for word in text.split(' '):
        longer = line + (' ' if line else '') + word
        if line and draw.textlength(longer, font=face) > width:
            draw.text((x, y), line, font=face, fill=fill)
            y += height
            line = word
            if y + height > bottom:
                return y
        else:
            line = longer
    draw.text((x, y), line, font=face, fill=fill)
    return y + height


def maps(root, count=150):
    """Game boards: hexagons of terrain with units, and the game's panel beside it."""
    base = os.path.join(wesnoth_root(root), 'data/core/images')
    kinds = {}
    for path in found(base, 'terrain/*/**/*.png'):
        kind = path[len(base) + 1:].split('/')[1]
        with Image.open(path) as image:
            if image.size == (72, 72) and not re.search(r'-(n|s|ne|nw|se|sw)[-.]', os.path.basename(path)):
                kinds.setdefault(kind, []).append(path)
    grounds = [k for k in ('grass', 'sand', 'water', 'frozen', 'flat', 'cave', 'swamp', 'hills') if kinds.get(k)]
    tops = [k for k in ('forest', 'mountains', 'village', 'castle', 'embellishments', 'hills') if kinds.get(k)]
    units = [p for p in found(base, 'units/*/*.png') if re.search(r'/[a-z]+\.png$', p)]
    if not grounds or not units:
        return
    for n in range(count):
        def make(n=n):
            r = rng('map %d' % n)
            image = Image.new('RGBA', (WIDTH, HEIGHT), (0, 0, 0, 255))
            scale = r.choice([72, 72, 96, 54])
            cache = {}

            def tile(path):
                if path not in cache:
                    cache[path] = opened(path).convert('RGBA').resize((scale, scale), Image.LANCZOS)
                return cache[path]
            chosen = [[r.choice(kinds[k]) for _ in range(4)] for k in r.sample(grounds, min(4, len(grounds)))]
            over = [[r.choice(kinds[k]) for _ in range(3)] for k in r.sample(tops, min(3, len(tops)))]
            seeds = [(r.uniform(0, 40), r.uniform(0, 25), r.randrange(len(chosen))) for _ in range(14)]
            army = r.sample(units, min(18, len(units)))
            step = scale * 3 // 4
            things = []
            for cx in range(-1, WIDTH // step + 2):
                for cy in range(-1, HEIGHT // scale + 2):
                    x, y = cx * step, cy * scale + (scale // 2 if cx % 2 else 0)
                    ground = min(seeds, key=lambda s: (s[0] - cx) ** 2 + (s[1] - cy) ** 2)[2]
                    t = tile(r.choice(chosen[ground]))
                    image.alpha_composite(t, (max(x, 0), max(y, 0)), (max(-x, 0), max(-y, 0)))
                    dice = r.random()
                    if dice < 0.28:
                        things.append((x, y, r.choice(over[ground % len(over)])))
                    elif dice < 0.36:
                        things.append((x, y, r.choice(army)))
            for x, y, path in things:
                if -scale < x < WIDTH and -scale < y < HEIGHT:
                    image.alpha_composite(tile(path), (max(x, 0), max(y, 0)), (max(-x, 0), max(-y, 0)))
            draw = ImageDraw.Draw(image)
            panel = r.choice([260, 320, 0])
            if panel:
                draw.rectangle([WIDTH - panel, 0, WIDTH, HEIGHT], fill=(38, 34, 28, 255))
                for i in range(12):
                    draw.text((WIDTH - panel + 20, 30 + 60 * i),
                              '%s  %d/%d' % (r.choice(WORDS), r.randrange(60), 60 + r.randrange(9)),
                              font=font('sans', 22), fill=(220, 210, 180, 255))
            return image.convert('RGB')
        yield Item('game', 'map %d' % n, make, lossy=True)


def libraries(root):
    """Pages of a game shop: screenshots of games, nine to a page."""
    paths = found(root, 'usr/share/games/thumbnails/*.png')
    for n in range(0, len(paths) - 8, 9):
        def make(some=paths[n:n + 9], n=n):
            r = rng('library %d' % n)
            theme = THEMES[r.randrange(len(THEMES))]
            image, draw = canvas(theme[0])
            draw.rectangle([0, 0, WIDTH, 56], fill=theme[1])
            for i, path in enumerate(some):
                picture = cover(opened(path), 560, 270)
                x, y = 60 + (i % 3) * 620, 84 + (i // 3) * 330
                image.paste(picture, (x, y))
                draw.text((x, y + 276), os.path.basename(path)[:-4], font=font('bold', 22), fill=theme[2])
                draw.text((x + 420, y + 276), '%.1f / 5' % r.uniform(2, 5), font=font('sans', 20),
                          fill=theme[4][i % 6])
            return image
        yield Item('game', 'library %d' % n, make, lossy=True)


# ---- GCompris: bitmaps here, drawings through the browser ----

def unpack(root, work):
    """Pictures of GCompris into work/gcompris; the names that are there."""
    out = os.path.join(work, 'gcompris')
    done = os.path.join(out, 'done')
    if not os.path.exists(done):
        os.makedirs(out, exist_ok=True)
        for path in found(root, 'usr/share/gcompris-qt/rcc/*.rcc'):
            for name, content in rcc.files(path):
                if name.endswith(('.webp', '.svg', '.svgz', '.png')) and len(content) > 6000:
                    flat_name = name.strip('/').replace('gcompris/src/', '').replace('/', '_')
                    with open(os.path.join(out, flat_name), 'wb') as f:
                        f.write(content)
        open(done, 'w').close()
    return out


def gcompris_bitmaps(folder):
    for path in found(folder, '*.webp') + found(folder, '*.png'):
        with open(path, 'rb') as f:
            w, h = Image.open(io.BytesIO(f.read())).size
        if w >= 640 and h >= 400:
            yield Item('art', 'gcompris ' + os.path.basename(path), lambda p=path: cover(opened(p)), lossy=True)


# ---- interfaces: dialogs of the manuals' screenshots as windows on a desktop ----

def desktops(root):
    paths = []
    for path in found(root, 'usr/share/gimp/2.0/help/en/images/**/*.png') + \
            found(root, 'usr/share/help/C/gnome-help/figures/*.png'):
        with Image.open(path) as image:
            if image.width >= 180 and image.height >= 120 and image.width * image.height >= 50000:
                paths.append(path)
    rng('desktops').shuffle(paths)
    n = at = 0
    while at < len(paths):
        some = paths[at:at + 2 + n % 4]
        at += len(some)

        def make(some=some, n=n):
            r = rng('desktop %d' % n)
            theme = THEMES[r.randrange(len(THEMES))]
            image, draw = canvas(theme[0])
            a, b = theme[4][n % 6], theme[4][(n + 1) % 6]
            for x in range(0, WIDTH, 3):
                t = x / WIDTH
                draw.rectangle([x, 0, x + 2, HEIGHT], fill=tuple(int((u * (1 - t) + v * t) * 0.6) for u, v in zip(a, b)))
            bar = r.choice([0, HEIGHT - 44])
            draw.rectangle([0, bar, WIDTH, bar + 44], fill=theme[1])
            for i in range(r.randint(4, 9)):
                draw.rounded_rectangle([12 + 52 * i, bar + 6, 46 + 52 * i, bar + 38], 6, fill=r.choice(theme[4]))
            draw.text((WIDTH - 230, bar + 10), '%02d:%02d  2031-0%d-%02d' % (
                r.randrange(24), r.randrange(60), r.randint(1, 9), r.randint(1, 28)), font=font('sans', 20), fill=theme[2])
            cells = len(some)
            for i, path in enumerate(some):
                window = flat(opened(path))
                room_w, room_h = (WIDTH - 40) // (2 if cells > 1 else 1), 940 // (2 if cells > 2 else 1)
                s = min(room_w / window.width, (room_h - 40) / window.height, 2.0)
                if s != 1:
                    window = window.resize((max(1, round(window.width * s)), max(1, round(window.height * s))),
                                           Image.LANCZOS)
                x = 20 + (i % 2) * room_w + r.randint(0, max(0, room_w - window.width - 10))
                y = 60 + (i // 2 % 2) * room_h + r.randint(0, max(0, room_h - window.height - 50))
                draw.rectangle([x, y, x + window.width, y + 32], fill=theme[1])
                draw.text((x + 10, y + 4), os.path.basename(path)[:-4], font=font('bold', 18), fill=theme[2])
                for k in range(3):
                    draw.ellipse([x + window.width - 26 - 26 * k, y + 8, x + window.width - 10 - 26 * k, y + 24],
                                 fill=theme[4][k])
                image.paste(window, (x, y + 32))
            return image
        yield Item('UI', 'desktop %d' % n, make)
        n += 1
