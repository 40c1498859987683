# SPDX-License-Identifier: Apache-2.0
"""Makes all screens and numbers them: collect.py ROOT WORK OUT JOBS LIMIT [CATEGORY ...]

Screens are made into WORK (what is there already stays), then near-duplicates
are dropped, and what remains goes to OUT as NNNNNN_CATEGORY.webp, always in the same order.
"""
import collections
import itertools
import multiprocessing
import os
import shutil
import sys

import numpy as np
from PIL import Image

import documents
import draw
import pictures


def items(root, work):
    folder = pictures.unpack(root, work)
    groups = [pictures.wallpapers(root), pictures.illustrations(root), pictures.portraits(root),
              pictures.gcompris_bitmaps(folder), documents.drawings(root, work, folder),
              pictures.maps(root), pictures.libraries(root), pictures.desktops(root),
              documents.papers(root), documents.web(root, work), documents.generated(root, work),
              draw.everything(root)]
    return sorted(itertools.chain(*groups), key=lambda i: (i.category, i.key))


ALL = []
WORK = ''


def make(index):
    item = ALL[index]
    try:
        there = item.save(WORK)
        if there:
            fingerprint(item.path(WORK))
        return index, there, ''
    except (OSError, ValueError, EOFError, ArithmeticError, SyntaxError) as problem:
        return index, False, '%s: %s' % (item.key, problem)


def fingerprint(path):
    """A coarse picture, freed of mean and contrast; kept beside the picture."""
    kept = path + '.print'
    if os.path.exists(kept):
        return np.fromfile(kept, dtype=np.float32)
    with Image.open(path) as image:
        small = np.asarray(image.convert('RGB').resize((32, 18), Image.BOX), dtype=np.float32).ravel()
    small -= small.mean()
    small /= max(1e-6, float(np.linalg.norm(small)))
    small.tofile(kept + '.tmp')
    os.replace(kept + '.tmp', kept)
    return small


def distinct(paths, prints):
    """Leaves out every picture that looks like one before it, of any category, and copies of the same bytes."""
    kept = []
    for path in paths:
        own = fingerprint(path)
        if max((float(other @ own) for other in prints), default=0) > 0.985:
            continue
        prints.append(own)
        kept.append(path)
    return kept


def main():
    global ALL, WORK
    root, WORK, out, jobs, limit = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]), int(sys.argv[5])
    only = sys.argv[6:]
    ALL = [i for i in items(root, WORK) if not only or i.category in only]
    if limit > 0:  # the first few of each category, to try things out
        count = collections.Counter()
        some = []
        for item in ALL:
            count[item.category] += 1
            if count[item.category] <= limit:
                some.append(item)
        ALL = some
    good = [False] * len(ALL)
    failed = 0
    # Parts of one tall screenshot are neighbours: pieces of 6 keep them in one worker.
    with multiprocessing.Pool(jobs) as pool:
        for n, (index, there, problem) in enumerate(pool.imap_unordered(make, range(len(ALL)), chunksize=6)):
            good[index] = there
            if problem:
                failed += 1
                print('screens: left out ' + problem, file=sys.stderr)
            if n % 100 == 99:
                print('screens: %d of %d' % (n + 1, len(ALL)), flush=True)
    paths, prints = [], []
    for category, some in itertools.groupby((i for i, g in zip(ALL, good) if g), key=lambda i: i.category):
        made = [i.path(WORK) for i in some]
        kept = distinct(made, prints)
        print('screens: %-8s %4d, %d near-duplicates left out' % (category, len(kept), len(made) - len(kept)))
        paths += [(category, p) for p in kept]
    os.makedirs(out, exist_ok=True)
    wanted = set()
    for number, (category, path) in enumerate(paths):
        name = '%06d_%s.webp' % (number, category)
        wanted.add(name)
        target = os.path.join(out, name)
        shutil.copyfile(path, target + '.tmp')
        os.replace(target + '.tmp', target)
    for name in os.listdir(out):  # numbers of an earlier, larger run
        if name.endswith('.webp') and name not in wanted and name[:6].isdigit():
            os.remove(os.path.join(out, name))
    print('screens: %d in %s%s' % (len(paths), out, ', %d left out because of errors' % failed if failed else ''))


if __name__ == '__main__':
    main()
