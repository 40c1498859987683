# SPDX-License-Identifier: Apache-2.0
"""Screens from documents: PDF pages by pdftoppm, web pages and drawings by headless Chromium."""
import html
import os
import re
import shutil
import subprocess
import tempfile

from PIL import Image

from common import HEIGHT, THEMES, WIDTH, Item, canvas, font, rng
from pictures import found, wrap

# ---- PDF ----


def pdf_pages(path):
    out = subprocess.run(['pdfinfo', path], capture_output=True, text=True, check=True).stdout
    return int(re.search(r'Pages:\s+(\d+)', out)[1])


def page_image(path, number, width):
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(['pdftoppm', '-f', str(number), '-l', str(number), '-png', '-scale-to-x', str(width),
                        '-scale-to-y', '-1', '-singlefile', path, folder + '/p'], check=True, capture_output=True)
        return Image.open(folder + '/p.png').convert('RGB')


def viewer(path, pages, key):
    """Pages side by side in a document viewer; every fifth with inverted colours, as night readers have it."""
    r = rng(key)
    theme = THEMES[r.randrange(len(THEMES))]
    image, draw = canvas(theme[3])
    width = [1260, 860][len(pages) - 1]
    scroll = r.uniform(0, 0.35)
    night = r.random() < 0.2
    for i, number in enumerate(pages):
        page = page_image(path, number, width)
        if night:
            page = page.point(lambda v: 235 - v * 200 // 255)
        x = (WIDTH - len(pages) * (width + 40)) // 2 + 20 + i * (width + 40)
        image.paste(page, (x, 60 - int(scroll * page.height)))
    draw.rectangle([0, 0, WIDTH, 44], fill=theme[1])
    draw.text((20, 9), '%s   %d / %d' % (os.path.basename(path), pages[0], pages[0] + 400),
              font=font('sans', 20), fill=theme[2])
    return image


def papers(root):
    plan = [('usr/share/doc/gnuplot/gnuplot.pdf', 70), ('usr/share/R/doc/manual/fullrefman.pdf', 150),
            ('usr/share/R/doc/manual/R-intro.pdf', 30), ('usr/share/R/doc/manual/R-exts.pdf', 40),
            ('usr/share/R/doc/manual/R-ints.pdf', 20), ('usr/share/R/doc/manual/R-admin.pdf', 20)]
    for name, count in plan:
        path = os.path.join(root, name)
        if not os.path.exists(path):
            continue
        total = pdf_pages(path)
        step = max(3, (total - 8) // count)
        for n, page in enumerate(range(6, total - 2, step)):
            key = '%s %d' % (name, page)
            if n % 2:
                yield Item('doc2', key, lambda p=path, g=page, k=key: viewer(p, [g, g + 1], k))
            else:
                yield Item('doc', key, lambda p=path, g=page, k=key: viewer(p, [g], k))


# ---- Chromium ----

def browser():
    for name in ('chromium', 'chromium-browser', 'google-chrome'):
        if shutil.which(name):
            return name
    raise SystemExit('screens: chromium is missing')


def screenshot(url, height=HEIGHT):
    with tempfile.TemporaryDirectory() as folder:
        command = [browser(), '--headless', '--no-sandbox', '--disable-gpu', '--hide-scrollbars', '--disable-extensions',
                   '--no-first-run', '--disable-dev-shm-usage', '--force-color-profile=srgb',
                   '--disable-background-networking', '--user-data-dir=' + folder + '/profile',
                   '--host-resolver-rules=MAP * ~NOTFOUND', '--allow-file-access-from-files',
                   '--window-size=%d,%d' % (WIDTH, height), '--screenshot=' + folder + '/s.png', url]
        try:
            subprocess.run(command, capture_output=True, timeout=90)
        except subprocess.TimeoutExpired:
            return None
        if not os.path.exists(folder + '/s.png'):
            return None
        return Image.open(folder + '/s.png').convert('RGB')


class Tall:
    """A tall screenshot, cut into screens: made once, kept for its neighbours."""

    def __init__(self, work, key, url, parts):
        self.work, self.key, self.url, self.parts = work, key, url, parts
        name = re.sub(r'[^A-Za-z0-9]+', '_', key)[-100:]
        self.path = os.path.join(work, 'tall', name + '.png')

    def part(self, i):
        if not os.path.exists(self.path):
            os.makedirs(os.path.dirname(self.path), exist_ok=True)
            image = screenshot(self.url() if callable(self.url) else self.url, HEIGHT * self.parts)
            if image is None:
                image = Image.new('RGB', (WIDTH, HEIGHT * self.parts))
            temporary = '%s.%d' % (self.path, os.getpid())
            image.save(temporary, 'PNG', compress_level=1)
            os.replace(temporary, self.path)
        image = Image.open(self.path)
        out = image.crop((0, HEIGHT * i, WIDTH, HEIGHT * (i + 1)))
        # The foot of a page shorter than the window is empty: half a screen of content is wanted.
        lower = out.crop((0, HEIGHT * 3 // 5, WIDTH, HEIGHT)).convert('L')
        low, high = lower.getextrema()
        return out if high - low > 40 else None


def tall_items(work, category, key, url, parts, lossy=False):
    tall = Tall(work, key, url, parts)
    for i in range(parts):
        yield Item(category, '%s part %d' % (key, i), lambda i=i: tall.part(i), lossy)


def wide_style(work, path, css):
    """The page with another style sheet, beside the original so that its pictures are found."""
    def make():
        with open(path, encoding='utf-8', errors='replace') as f:
            text = f.read()
        base = '<base href="file://%s/">' % os.path.dirname(path)
        out = os.path.join(work, 'html', re.sub(r'[^A-Za-z0-9]+', '_', path)[-120:] + '.html')
        os.makedirs(os.path.dirname(out), exist_ok=True)
        head = base + '<meta charset="utf-8"><style>' + css + '</style>'
        text = re.sub(r'<head[^>]*>', lambda m: m[0] + head, text, count=1)
        with open(out + '.%d' % os.getpid(), 'w', encoding='utf-8') as f:
            f.write(text)
        os.replace(out + '.%d' % os.getpid(), out)
        return 'file://' + out
    return make


STYLES = [
    '',
    'body{max-width:1100px;margin:40px auto !important;font:20px/1.6 "Liberation Serif",serif !important}',
    'body{background:#1e1e1e !important;color:#ddd !important;font-size:19px}a{color:#6ab0ff !important}'
    'pre,code,div{background:transparent !important;color:inherit}',
    'body{columns:2;column-gap:60px;margin:40px !important;font:18px/1.5 "Liberation Sans",sans-serif !important}',
    'body{background:#fdf6e3 !important;color:#444;font-size:23px;margin:30px 200px !important}',
]

HANDBOOK = ['en-US', 'de-DE', 'fr-FR', 'ja-JP', 'zh-CN', 'zh-TW', 'ko-KR', 'ru-RU', 'el-GR', 'ar-MA', 'fa-IR', 'vi-VN',
            'pl-PL', 'es-ES', 'tr-TR']


def web(root, work):
    """HTML of manuals. Of each chapter one language only, so that no two screens say the same."""
    base = os.path.join(root, 'usr/share/doc/debian-handbook/html')
    pages = [os.path.basename(p) for p in found(base, 'en-US/*.html')]
    for n, page in enumerate(pages):
        language = HANDBOOK[n % len(HANDBOOK)]
        path = os.path.join(base, language, page)
        if os.path.exists(path) and os.path.getsize(path) > 6000:
            make = wide_style(work, path, STYLES[n % len(STYLES)])
            yield from tall_items(work, 'web', 'handbook %s %s' % (language, page), make, 3)
    pages = [p for p in found(root, 'usr/share/gimp/2.0/help/en/*.html') if os.path.getsize(p) > 9000]
    for n, path in enumerate(pages[::3]):
        yield from tall_items(work, 'web', 'gimp ' + os.path.basename(path),
                              wide_style(work, path, STYLES[n % len(STYLES)]), 2)


def mallard(path):
    """The words of a GNOME help page as HTML, as far as its screens need it."""
    with open(path, encoding='utf-8') as f:
        text = f.read()
    text = re.sub(r'<info>.*?</info>|<!--.*?-->|<\?.*?\?>', '', text, flags=re.S)
    text = re.sub(r'<(/?)title[^>]*>', r'<\1h2>', text)
    text = re.sub(r'<(/?)(steps|list)[^>]*>', r'<\1ol>', text)
    text = re.sub(r'<(/?)item[^>]*>', r'<\1li>', text)
    text = re.sub(r'<(/?)(gui|key|app|em|cmd|input|file)\b[^>]*>', r'<\1b>', text)
    text = re.sub(r'<(/?)note[^>]*>', r'<\1blockquote>', text)
    return re.sub(r'<(?!/?(h2|ol|li|b|p|blockquote)\b)[^>]*>', '', text)


def generated(root, work, count=90):
    """Pages that never were: news, shops, forums, mail and chat, with the words of the GNOME help."""
    languages = ['C', 'de', 'ja', 'zh_CN', 'fr', 'ru', 'ko', 'es', 'el', 'sv', 'zh_TW', 'C']
    for n in range(count):
        language = languages[n % len(languages)]
        sources = found(root, 'usr/share/help/%s/gnome-help/*.page' % language)
        if len(sources) < 20:
            continue

        def url(n=n, sources=sources, language=language):
            r = rng('generated %d' % n)
            # Each page has a stretch of the help to itself: no two share their words.
            turn = (n // 12) * 18
            texts = [mallard(p) for p in (sources * 2)[turn % len(sources):][:18]]
            back, panel, ink, faint, accents = THEMES[r.randrange(len(THEMES))]

            def rgb(c):
                return 'rgb(%d,%d,%d)' % c

            def art():
                a, b = r.sample(accents, 2)
                return 'background:%s-gradient(%s%s,%s %d%%,%s)' % (
                    r.choice(['linear', 'radial', 'repeating-linear', 'conic']), '', rgb(a), rgb(b), r.randint(20, 80),
                    rgb(panel)) if r.random() < .7 else 'background:' + rgb(a)
            kind = n % 5
            body = ['<header style="background:%s;padding:16px 40px;font-size:26px">%s' % (rgb(accents[0]), ''.join(
                '<b style="margin-right:40px">%s</b>' % html.escape(os.path.basename(p)[:-5]) for p in sources[:7])),
                '</header><main>']
            for i, text in enumerate(texts):
                picture = '<div style="height:%dpx;%s"></div>' % (r.randint(60, 260), art())
                if kind == 4:
                    side = 'margin-left:%s' % r.choice(['0', '45%'])
                    text = '<div style="%s;width:50%%;border-radius:20px;padding:10px 24px;background:%s">%s</div>' % (
                        side, rgb(panel), text[:700])
                    picture = ''
                body.append('<article>%s%s</article>' % (picture if r.random() < .6 else '', text))
            columns = ['grid-template-columns:2fr 1fr 1fr', 'grid-template-columns:repeat(4,1fr)',
                       'grid-template-columns:1fr 3fr', 'grid-template-columns:repeat(3,1fr)',
                       'grid-template-columns:1fr'][kind]
            css = ('body{margin:0;background:%s;color:%s;font:%dpx/1.45 %s}main{display:grid;gap:26px;padding:26px;%s}'
                   'article{background:%s;padding:18px;overflow:hidden;border-radius:%dpx}b{color:%s}'
                   'blockquote{border-left:6px solid %s;margin:8px;padding-left:14px}') % (
                rgb(back), rgb(ink), r.choice([14, 16, 18, 21]),
                r.choice(['"Liberation Sans"', '"DejaVu Sans"', '"Liberation Serif"']) + ',sans-serif', columns,
                rgb(panel) if kind != 4 else 'transparent', r.choice([0, 4, 16]), rgb(accents[1]), rgb(accents[2]))
            out = os.path.join(work, 'html', 'generated_%d.html' % n)
            os.makedirs(os.path.dirname(out), exist_ok=True)
            with open(out, 'w', encoding='utf-8') as f:
                f.write('<!doctype html><html lang="%s"><meta charset="utf-8"><style>%s</style>%s</main>' % (
                    language.replace('_', '-'), css, ''.join(body)))
            return 'file://' + out
        yield from tall_items(work, 'web2', 'generated %d' % n, url, 3)


def vector_art(work, paths, category):
    """SVG drawings, six to one start of the browser."""
    for n in range(0, len(paths), 6):
        some = paths[n:n + 6]

        def url(some=some, n=n):
            out = os.path.join(work, 'html', '%s_%d.html' % (category, n))
            os.makedirs(os.path.dirname(out), exist_ok=True)
            with open(out, 'w', encoding='utf-8') as f:
                f.write('<!doctype html><style>body{margin:0}img{display:block;width:%dpx;height:%dpx;object-fit:cover}'
                        '</style>' % (WIDTH, HEIGHT))
                f.write(''.join('<img src="file://%s">' % html.escape(p) for p in some))
            return 'file://' + out
        tall = Tall(work, 'vector %s %d' % (category, n), url, len(some))
        for i, path in enumerate(some):
            yield Item(category, 'svg ' + os.path.basename(path), lambda i=i, t=tall: t.part(i))


def drawings(root, work, folder):
    backgrounds = []
    for path in found(folder, '*.svg'):
        with open(path, encoding='utf-8', errors='replace') as f:
            head = f.read(4000)
        w = re.search(r'<svg[^>]*\bwidth="([\d.]+)', head)
        h = re.search(r'<svg[^>]*\bheight="([\d.]+)', head)
        if os.path.getsize(path) > 12000 and w and h and float(w[1]) >= 600 and 1.1 < float(w[1]) / float(h[1]) < 2.4:
            backgrounds.append(path)
    yield from vector_art(work, backgrounds, 'art')
    light = [p for p in found(root, 'usr/share/backgrounds/gnome/*.svg') if not p.endswith('-d.svg')]
    yield from vector_art(work, light, 'static')
