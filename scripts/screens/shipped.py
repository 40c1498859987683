# SPDX-License-Identifier: Apache-2.0
"""Makes the screens of data/screens that are not charts, patterns, sheets or code: shipped.py ROOT OUT

Everything here is drawn, from our own words and random numbers, so that what ships
is under BRACE's own licence. The one photograph, of gcompris-qt-data, is in the
public domain. ROOT is `root` in the work folder of scripts/screens.sh.
"""
import html
import os
import re
import sys
import tempfile

import numpy as np
from PIL import Image

import documents
import draw
import pictures
from common import HEIGHT, THEMES, WIDTH, canvas, cover, font, rng

SMALL = (768, 432)

CHINESE = [
    '显示器的亮度常常靠快速的开关来调节，人眼看不出来，相机却看得见。',
    '卷帘快门一行一行地曝光，每一行在不同的时刻收集光线，于是画面上出现了条纹。',
    '曝光时间越短，条纹的对比度就越高；曝光时间是周期的整数倍时，条纹完全消失。',
    '发光二极管大屏的红、绿、蓝三色各自计数，所以条纹还会带上颜色。',
    '模块之间的相位并不一致，条纹在接缝处错开，看上去像锯齿。',
    '较暗的灰度只点亮一部分子周期，因此条纹的间距随亮度而变化。',
    '我们用同一感光度拍摄五张照片，曝光时间依次相差四倍，再把它们合并成一张。',
    '长曝光的照片几乎没有条纹，但亮的地方会过曝；短曝光的照片保留了高光的细节。',
    '合并之前要对齐画面，因为手持拍摄时相机总会有轻微的抖动。',
    '噪声由光子和电路两部分组成，方差与信号成正比，再加上一个常数。',
    '请把相机设为手动模式，关闭自动白平衡，并保存原始数据文件。',
    '测试图案包括彩条、灰阶、棋盘格、同心圆和不同方向的细线。',
]
JAPANESE = [
    'ディスプレイの明るさは、速い点滅の長さで調整されることが多い。',
    'ローリングシャッターは一行ずつ順番に露光するため、画面に縞が写る。',
    '露光時間が点滅の周期の整数倍であれば、縞はまったく現れない。',
    '有機ELのパネルでは、行が上から下へ順に駆動される。',
    '五枚の写真を同じ感度で撮り、露光時間を四倍ずつ変える。',
    '暗い階調では一部の期間だけが点灯するので、縞の間隔が広くなる。',
    '撮影した画像は位置を合わせてから、一枚の写真にまとめられる。',
    '雑音の分散は信号に比例する部分と、一定の部分からなる。',
]


def paragraphs(sentences, count):
    r = rng('paragraphs ' + sentences[0])
    return [''.join(r.choice(sentences) for _ in range(r.randint(2, 6))) for _ in range(count)]


def cjk():
    left, right = draw.dense(3, paragraphs(CHINESE, 400), 'cjk'), draw.dense(3, paragraphs(JAPANESE, 400), 'cjk')
    left.paste(right.crop((0, 0, WIDTH // 2, HEIGHT)), (WIDTH // 2, 0))
    return left


def noise(r, octaves, first=3, fall=0.55):
    """Smooth noise of several scales, 0 to 1."""
    out, weight = np.zeros((HEIGHT, WIDTH), np.float32), 1.0
    for i in range(octaves):
        n = first * 2 ** i
        values = np.float32([[r.random() for _ in range(n * 2)] for _ in range(n + 1)])
        out += weight * np.asarray(Image.fromarray(values).resize((WIDTH, HEIGHT), Image.BICUBIC))
        weight *= fall
    out -= out.min()
    return out / out.max()


def landscape():
    """Ridges in haze above a lake, at dusk."""
    r = rng('landscape')
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    shore = 760
    sky = np.clip(y / shore, 0, 1)[..., None]
    out = np.float32([38, 58, 110]) * (1 - sky) + np.float32([250, 170, 105]) * sky
    glow = np.exp(-((x - 1300) ** 2 + (y - 560) ** 2) / (2 * 170 ** 2))[..., None]
    out = out + glow * np.float32([60, 70, 60])
    clouds = np.clip(noise(r, 6) * 2.2 - 1.1, 0, 1)[..., None] * (1 - sky * 0.6)
    out = out * (1 - 0.45 * clouds) + np.float32([255, 205, 180]) * 0.45 * clouds
    for k in range(6):
        height, line = 330 - 45 * k, np.zeros(WIDTH, np.float32)
        for i in range(9):
            n = 3 * 2 ** i
            knots = np.float32([r.uniform(-1, 1) for _ in range(n)])
            line += np.interp(np.linspace(0, n - 1, WIDTH), np.arange(n), knots).astype(np.float32) * 0.5 ** i
        top = shore - height * 0.5 - line * height * 0.28
        rock = np.float32([58, 62, 92]) * (1 - k / 6) * 1.4 + np.float32([16, 24, 22]) * (k / 6)
        grain = (noise(r, 8, 6, 0.75)[..., None] - 0.5) * (14 + 6 * k)
        fog = np.clip((y - top[None]) / 260, 0, 1)[..., None] * (0.55 - 0.08 * k)
        layer = (rock + grain) * (1 - fog) + np.float32([225, 170, 140]) * fog
        out = np.where((y >= top[None])[..., None], layer, out)
    mirror = out[np.clip(2 * shore - np.arange(shore, HEIGHT), 0, shore - 1)]
    shift = (np.sin(np.arange(HEIGHT - shore) ** 1.2 * 0.7) * np.linspace(1, 9, HEIGHT - shore)).astype(int)
    out[shore:] = np.stack([np.roll(row, s, axis=0) for row, s in zip(mirror, shift)]) * 0.72 + np.float32([4, 10, 22])
    return Image.fromarray(np.uint8(np.clip(out, 0, 255)))


def game():
    """A board of hexagons: land, sea and woods, villages and two armies, and the player's panel."""
    r = rng('board')
    image, d = canvas((18, 22, 30))
    land = {'sea': (36, 84, 140), 'shore': (70, 130, 170), 'sand': (206, 184, 124), 'grass': (94, 142, 62),
            'wood': (52, 96, 48), 'hill': (136, 118, 76), 'rock': (120, 116, 112), 'snow': (226, 232, 238)}
    order = list(land)
    height, s = noise(r, 5, 4), 44
    for cx in range(-1, 24):
        for cy in range(-1, 16):
            x, y = cx * 1.5 * s + s, cy * 1.732 * s + (0.866 * s if cx % 2 else 0)
            h = height[int(min(max(y, 0), HEIGHT - 1)), int(min(max(x, 0), WIDTH - 1))]
            kind = order[min(len(order) - 1, max(0, int((h - 0.18) * 11)))]
            tone = r.uniform(0.9, 1.08)
            points = [(x + s * a, y + s * b) for a, b in ((1, 0), (.5, .866), (-.5, .866), (-1, 0), (-.5, -.866), (.5, -.866))]
            d.polygon(points, fill=tuple(int(min(255, c * tone)) for c in land[kind]), outline=(30, 36, 30))
            for _ in range(26):  # grains, waves, blades
                a, b = x + r.uniform(-.6, .6) * s, y + r.uniform(-.6, .6) * s
                dark = tuple(int(c * r.choice([0.8, 1.15]) if c * 1.15 < 255 else c) for c in land[kind])
                d.line([a, b, a + r.uniform(2, 8), b + r.uniform(-3, 3)], fill=dark, width=2)
            if kind == 'wood':
                for _ in range(7):
                    a, b, t = x + r.uniform(-.6, .5) * s, y + r.uniform(-.4, .6) * s, r.uniform(12, 22)
                    d.polygon([(a, b - t), (a - t / 2, b + 4), (a + t / 2, b + 4)], fill=(24, r.randint(60, 96), 34))
            elif kind in ('hill', 'rock', 'snow'):
                d.polygon([(x - 30, y + 24), (x - 4, y - 26), (x + 10, y - 6), (x + 32, y + 24)], fill=(96, 90, 84))
                d.polygon([(x - 4, y - 26), (x - 13, y - 8), (x + 5, y - 8)], fill=(236, 240, 244))
            elif kind in ('grass', 'sand') and r.random() < 0.14:
                d.rectangle([x - 16, y - 4, x + 16, y + 20], fill=(220, 204, 170))
                d.polygon([(x - 22, y - 4), (x, y - 24), (x + 22, y - 4)], fill=(170, 60, 46))
                d.rectangle([x - 5, y + 6, x + 5, y + 20], fill=(80, 54, 34))
            elif kind in ('grass', 'sand') and r.random() < 0.24:
                side = r.choice([(210, 50, 50), (60, 90, 220)])
                d.ellipse([x - 24, y + 14, x + 24, y + 32], fill=(0, 0, 0))
                d.polygon([(x - 18, y - 20), (x + 18, y - 20), (x + 14, y + 12), (x, y + 24), (x - 14, y + 12)], fill=side,
                          outline=(250, 240, 200))
                d.line([x - 10, y - 10, x + 10, y + 10], fill=(250, 240, 200), width=4)
                d.line([x + 10, y - 10, x - 10, y + 10], fill=(250, 240, 200), width=4)
                d.rectangle([x - 30, y - 20, x - 25, y + 20], fill=(0, 0, 0))
                d.rectangle([x - 30, y + 20 - r.randint(8, 40), x - 25, y + 20], fill=(70, 220, 70))
    d.rectangle([1560, 0, WIDTH, HEIGHT], fill=(40, 34, 28))
    mini = image.crop((0, 0, 1560, HEIGHT)).resize((320, 222), Image.BOX)
    image.paste(mini, (1580, 24))
    for i, (name, value) in enumerate((('Turn', '14 / 30'), ('Gold', '187'), ('Villages', '9'), ('Upkeep', '12 (4)'),
                                       ('Income', '+16'), ('Time', '07:42'), ('Pikeman', 'level 2'), ('Health', '41 / 55'),
                                       ('Moves', '3 / 5'), ('Defence', '60 %'), ('Pike', '10 × 3'), ('Crossbow', '8 × 2'))):
        d.text((1590, 280 + 46 * i), name, font=font('sans', 26), fill=(170, 158, 130))
        d.text((1750, 280 + 46 * i), value, font=font('bold', 26), fill=(240, 226, 180))
    d.rounded_rectangle([1590, 960, 1890, 1040], 12, fill=(120, 40, 30), outline=(220, 190, 120), width=3)
    d.text((1660, 980), 'End turn', font=font('bold', 32), fill=(250, 236, 200))
    return image


def interface():
    """A program for pictures, with a dialog open."""
    r = rng('interface')
    back, panel, ink, faint, accents = THEMES[1]
    image, d = canvas(panel)
    small, bold = font('sans', 19), font('bold', 19)

    def slider(x, y, name, value, width=300):
        d.text((x, y), name, font=small, fill=ink)
        d.text((x + width - 46, y), '%d' % (value * 100), font=small, fill=faint)
        d.line([x, y + 36, x + width, y + 36], fill=faint, width=4)
        d.line([x, y + 36, x + width * value, y + 36], fill=accents[0], width=4)
        d.ellipse([x + width * value - 9, y + 27, x + width * value + 9, y + 45], fill=(240, 240, 240))
    d.rectangle([0, 0, WIDTH, 40], fill=back)
    for i, name in enumerate('File Edit View Image Layer Colours Tools Filters Windows Help'.split()):
        d.text((20 + 104 * i, 9), name, font=small, fill=ink)
    d.rectangle([0, 40, 96, HEIGHT], fill=back)
    for i in range(22):
        x, y = 8 + 44 * (i % 2), 60 + 48 * (i // 2)
        d.rounded_rectangle([x, y, x + 38, y + 38], 6, fill=accents[0] if i == 5 else panel)
        shape = [d.ellipse, d.rectangle, d.arc, d.line][i % 4]
        shape([x + 10, y + 10, x + 28, y + 28], *((0, 270) if i % 4 == 2 else ()), fill=ink)
    picture = landscape().resize((1280, 720), Image.LANCZOS)
    d.rectangle([96, 40, 1520, HEIGHT - 36], fill=(24, 24, 24))
    image.paste(picture, (168, 150))
    for i in range(0, 1424, 10):
        d.line([96 + i, 40, 96 + i, 62 if i % 100 == 0 else 50], fill=faint)
    d.rectangle([1520, 40, WIDTH, HEIGHT], fill=back)
    d.text((1550, 60), 'Histogram', font=bold, fill=ink)
    d.rectangle([1550, 92, 1890, 252], fill=(16, 16, 16))
    for c, color in enumerate(((230, 70, 70), (70, 210, 90), (80, 120, 240))):
        counts = np.asarray(picture.split()[c].histogram(), float)
        counts = np.convolve(counts, np.ones(5) / 5, 'same')
        d.line([(1550 + 340 * i / 255, 251 - 150 * min(1, v / counts[8:248].max())) for i, v in enumerate(counts)],
               fill=color, width=3)
    for i, (name, value) in enumerate((('Exposure', .62), ('Contrast', .48), ('Highlights', .22), ('Shadows', .71),
                                       ('Temperature', .55), ('Saturation', .4), ('Clarity', .3))):
        slider(1550, 280 + 62 * i, name, value, 340)
    d.text((1550, 730), 'Layers', font=bold, fill=ink)
    for i, name in enumerate(('Sharpening', 'Curves 2', 'Gradient', 'Lake copy', 'Background')):
        d.rectangle([1550, 764 + 58 * i, 1890, 816 + 58 * i], fill=accents[0] if i == 1 else panel)
        image.paste(picture.crop((140 * i, 260, 140 * i + 640, 620)).resize((78, 44)), (1558, 768 + 58 * i))
        d.text((1650, 778 + 58 * i), name, font=small, fill=ink)
    d.rectangle([420, 330, 1060, 800], fill=(235, 235, 238), outline=(60, 60, 60))
    d.rectangle([420, 330, 1060, 374], fill=(210, 210, 216))
    d.text((440, 341), 'Export picture', font=bold, fill=(20, 20, 20))
    for i, (name, value) in enumerate((('Name', 'lake-at-dusk.tif'), ('Folder', '/home/anna/Pictures'), ('Format', 'TIFF, 16 bits'),
                                       ('Colour space', 'sRGB'), ('Size', '3840 × 2160'))):
        y = 400 + 58 * i
        d.text((446, y + 6), name, font=small, fill=(40, 40, 40))
        d.rectangle([620, y, 1030, y + 40], fill=(255, 255, 255), outline=(150, 150, 150))
        d.text((632, y + 8), value, font=small, fill=(20, 20, 20))
    for i in range(2):
        d.rectangle([620 + 200 * i, 694, 644 + 200 * i, 718], fill=(255, 255, 255), outline=(90, 90, 90))
        d.text((654 + 200 * i, 694), ('Metadata', 'Preview')[i], font=small, fill=(40, 40, 40))
    d.line([624, 706, 631, 714, 642, 697], fill=(0, 110, 220), width=4)
    for i, name in enumerate(('Cancel', 'Export')):
        d.rounded_rectangle([760 + 140 * i, 740, 885 + 140 * i, 782], 8, fill=((200, 200, 205), (0, 110, 220))[i])
        d.text((785 + 140 * i, 749), name, font=bold, fill=((30, 30, 30), (255, 255, 255))[i])
    d.rectangle([0, HEIGHT - 36, WIDTH, HEIGHT], fill=(0, 100, 190))
    d.text((20, HEIGHT - 30), '3840 × 2160 px   33.3 %%   RGB float   %d MB   Ready' % r.randint(200, 900), font=small,
           fill=(255, 255, 255))
    return image


def web(readme):
    """BRACE's README as a page, in Chromium."""
    with open(readme, encoding='utf-8') as f:
        blocks = re.split(r'\n\s*\n', re.sub(r'```.*?```', lambda m: m.group().replace('\n\n', '\n'), f.read(), flags=re.S))
    body = []
    for block in blocks:
        text = re.sub(r'`([^`]*)`', r'<code>\1</code>', re.sub(r'\[([^\]]*)\]\([^)]*\)', r'<a>\1</a>', html.escape(block)))
        if block.startswith('#'):
            body.append('<h2>%s</h2>' % text.lstrip('# '))
        elif block.startswith(('```', '    ')):
            body.append('<pre>%s</pre>' % re.sub(r'^```\w*\n|```$', '', html.escape(block)))
        elif block.startswith('|'):
            rows = [line.strip('|').split('|') for line in text.split('\n') if not re.match(r'^[|\s:-]+$', line)]
            body.append('<table>%s</table>' % ''.join('<tr>%s</tr>' % ''.join('<td>%s</td>' % c for c in row) for row in rows))
        elif not block.startswith('!'):
            body.append('<p>%s</p>' % text.replace('*', ''))
    style = ('body{margin:0;font:19px/1.5 "Liberation Sans",sans-serif;color:#1f2937;background:#f6f7f9}'
             'header{background:linear-gradient(90deg,#1d4ed8,#9333ea,#db2777);color:#fff;padding:18px 60px;font-size:30px}'
             'header b{margin-right:48px;font-size:20px}main{columns:2;column-gap:60px;padding:20px 60px}a{color:#1d4ed8}'
             'h2{color:#7c3aed}pre{background:#111827;color:#d1fae5;padding:12px;font-size:15px;overflow:hidden}'
             'td{border:1px solid #cbd5e1;padding:2px 10px}code{background:#e5e7eb}')
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, 'page.html')
        with open(path, 'w', encoding='utf-8') as f:
            f.write('<!doctype html><meta charset="utf-8"><style>%s</style><header>BRACE &nbsp; <b>Download</b><b>Manual</b>'
                    '<b>Displays</b><b>Benchmarks</b><b>Source</b></header><main>%s</main>' % (style, ''.join(body)))
        return documents.screenshot('file://' + path)


def photograph(root):
    """Ryan Hagerty, U.S. Fish and Wildlife Service: a male moose; in the public domain."""
    folder = pictures.unpack(root, os.path.dirname(os.path.abspath(root)))
    return cover(pictures.opened(os.path.join(folder, 'activities_explore_world_animals_resource_animals_moose.webp')))


def main():
    root, out = sys.argv[1], sys.argv[2]
    readme = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../README.md')
    for name, image, lossy in (('000002_cjk', cjk(), False), ('000004_game', game(), True),
                               ('000009_static', photograph(root), True), ('000010_static', landscape(), True),
                               ('000012_web', web(readme), False), ('000013_UI', interface(), False)):
        small = image.convert('RGB').resize(SMALL, Image.LANCZOS)
        small.save(os.path.join(out, name + '.webp'), **({'quality': 92} if lossy else {'lossless': True}), method=6)


if __name__ == '__main__':
    main()
