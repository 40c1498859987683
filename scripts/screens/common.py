# SPDX-License-Identifier: Apache-2.0
"""What all makers of screens share: the size, the random numbers, and items.

An item is a category, a key that never changes, and a function that makes its
picture. Everything random in a picture comes from its key, so that an item is
the same whenever and in whichever order it is made.
"""
import hashlib
import os
import random

import numpy as np
from PIL import Image, ImageDraw, ImageFont

WIDTH, HEIGHT = 1920, 1080

Image.MAX_IMAGE_PIXELS = 200_000_000


class Item:
    """`lossy` is for photographs and paintings; letters and lines are kept exactly."""

    def __init__(self, category, key, make, lossy=False):
        self.category, self.key, self.make, self.lossy = category, key, make, lossy

    def path(self, work):
        name = hashlib.sha256(self.key.encode()).hexdigest()[:16]
        return os.path.join(work, 'items', self.category, name + '.webp')

    def save(self, work):
        """Makes the picture unless it is there; False if there is nothing to see in it."""
        path = self.path(work)
        if os.path.exists(path):
            return True
        if os.path.exists(path + '.none'):
            return False
        os.makedirs(os.path.dirname(path), exist_ok=True)
        image = self.make()
        if image is None or dull(image):
            open(path + '.none', 'w').close()
            return False
        if self.lossy:
            image.save(path + '.tmp', 'WEBP', quality=95, method=3)
        else:
            image.save(path + '.tmp', 'WEBP', lossless=True, quality=30, method=2)
        os.replace(path + '.tmp', path)
        return True


def rng(key):
    return random.Random(int.from_bytes(hashlib.sha256(key.encode()).digest()[:8], 'big'))


def dull(image):
    """Nearly one colour: an empty page, a failed rendering."""
    small = np.asarray(image.convert('L').resize((96, 54), Image.BOX), dtype=np.float32)
    return small.std() < 2.5


def cover(image, width=WIDTH, height=HEIGHT):
    """Scaled so that it fills the screen, centred."""
    image = flat(image)
    scale = max(width / image.width, height / image.height)
    w, h = max(width, round(image.width * scale)), max(height, round(image.height * scale))
    if (w, h) != image.size:
        image = image.resize((w, h), Image.LANCZOS)
    x, y = (w - width) // 2, (h - height) // 2
    return image.crop((x, y, x + width, y + height))


def flat(image, background=(255, 255, 255)):
    """RGB, transparency over a colour."""
    if image.mode in ('RGBA', 'LA', 'PA') or 'transparency' in image.info:
        image = image.convert('RGBA')
        under = Image.new('RGBA', image.size, background + (255,))
        return Image.alpha_composite(under, image).convert('RGB')
    return image.convert('RGB')


FONTS = {
    'sans': ['/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf',
             '/usr/share/fonts/truetype/liberation/LiberationSans-Regular.ttf'],
    'bold': ['/usr/share/fonts/truetype/dejavu/DejaVuSans-Bold.ttf',
             '/usr/share/fonts/truetype/liberation/LiberationSans-Bold.ttf'],
    'serif': ['/usr/share/fonts/truetype/liberation/LiberationSerif-Regular.ttf',
              '/usr/share/fonts/truetype/dejavu/DejaVuSerif.ttf'],
    'mono': ['/usr/share/fonts/truetype/dejavu/DejaVuSansMono.ttf',
             '/usr/share/fonts/truetype/liberation/LiberationMono-Regular.ttf'],
    'cjk': ['/usr/share/fonts/truetype/wqy/wqy-zenhei.ttc',
            '/usr/share/fonts/opentype/ipafont-gothic/ipag.ttf'],
}


def font(kind, size, choice=0):
    names = [n for n in FONTS[kind] if os.path.exists(n)]
    if not names:
        raise SystemExit('screens: no font of kind ' + kind + ' is installed')
    return ImageFont.truetype(names[choice % len(names)], size)


def canvas(color):
    image = Image.new('RGB', (WIDTH, HEIGHT), color)
    return image, ImageDraw.Draw(image)


THEMES = [  # background, panel, text, faint, accents
    ((255, 255, 255), (243, 244, 246), (17, 24, 39), (156, 163, 175),
     [(37, 99, 235), (220, 38, 38), (5, 150, 105), (217, 119, 6), (124, 58, 237), (219, 39, 119)]),
    ((30, 30, 30), (45, 45, 48), (212, 212, 212), (110, 110, 110),
     [(86, 156, 214), (206, 145, 120), (106, 153, 85), (220, 220, 170), (197, 134, 192), (78, 201, 176)]),
    ((0, 43, 54), (7, 54, 66), (147, 161, 161), (88, 110, 117),
     [(38, 139, 210), (220, 50, 47), (133, 153, 0), (181, 137, 0), (211, 54, 130), (42, 161, 152)]),
    ((253, 246, 227), (238, 232, 213), (88, 110, 117), (147, 161, 161),
     [(38, 139, 210), (220, 50, 47), (133, 153, 0), (181, 137, 0), (108, 113, 196), (203, 75, 22)]),
    ((0, 0, 0), (20, 20, 20), (230, 230, 230), (90, 90, 90),
     [(0, 200, 255), (255, 80, 80), (80, 255, 120), (255, 210, 0), (255, 90, 255), (255, 140, 0)]),
    ((40, 42, 54), (68, 71, 90), (248, 248, 242), (98, 114, 164),
     [(139, 233, 253), (255, 121, 198), (80, 250, 123), (241, 250, 140), (189, 147, 249), (255, 184, 108)]),
    ((236, 239, 244), (216, 222, 233), (46, 52, 64), (129, 161, 193),
     [(94, 129, 172), (191, 97, 106), (163, 190, 140), (208, 135, 112), (180, 142, 173), (136, 192, 208)]),
]
