# SPDX-License-Identifier: Apache-2.0
"""Files inside a Qt resource collection (.rcc), as GCompris stores its pictures.

The layout is that of Qt's qresource.cpp: a header (magic, version, offsets of
tree, data and names), a tree of 14- or 22-byte nodes, lengths before data and names.
"""
import struct
import zlib


def files(path):
    """(name, bytes) of every file that is stored plain or deflated, in the order of the tree."""
    with open(path, 'rb') as f:
        blob = f.read()
    magic, version, tree, data, names = struct.unpack_from('>4sIIII', blob)
    if magic != b'qres':
        raise ValueError(path + ': no Qt resource file')
    size = 22 if version >= 2 else 14

    def walk(index, prefix):
        node = tree + index * size
        name_at, flags = struct.unpack_from('>IH', blob, node)
        if index > 0:
            length, = struct.unpack_from('>H', blob, names + name_at)
            start = names + name_at + 6
            prefix += '/' + blob[start:start + 2 * length].decode('utf-16-be')
        if flags & 2:
            count, first = struct.unpack_from('>II', blob, node + 6)
            for child in range(first, first + count):
                yield from walk(child, prefix)
            return
        at, = struct.unpack_from('>I', blob, node + 10)
        length, = struct.unpack_from('>I', blob, data + at)
        content = blob[data + at + 4:data + at + 4 + length]
        if flags & 1:
            content = zlib.decompress(content[4:])
        if not flags & 4:  # 4: zstd, which GCompris does not use
            yield prefix, content

    yield from walk(0, '')
