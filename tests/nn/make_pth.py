#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the PyTorch files in data/: small tensors of every type in both formats of torch.save.

Element i of the k-th tensor holds i + k (modulo 2 for bool), so that test_pth.c knows what to expect.
Run in this folder: python3 make_pth.py
"""
import collections
import struct
import zipfile

import torch


def count(n, k, dtype):
    values = torch.arange(n) + k
    return values % 2 == 1 if dtype == torch.bool else values.to(dtype)


shared = count(24, 8, torch.float32)
state = collections.OrderedDict()
state["f32"] = count(6, 0, torch.float32).view(2, 3)
state["f64"] = count(2, 1, torch.float64)
state["f16"] = count(5, 2, torch.float16)
state["bf16"] = count(5, 3, torch.bfloat16)
state["i64"] = count(3, 4, torch.int64)
state["i32"] = count(3, 5, torch.int32)
state["u8"] = count(7, 6, torch.uint8)
state["bool"] = count(4, 7, torch.bool)
state["shared.all"] = shared.view(2, 3, 4)
state["shared.turned"] = shared.view(2, 3, 4).permute(2, 0, 1)  # not in one piece
state["shared.part"] = shared[5:9]
state["shared.column"] = shared.view(6, 4)[:, 1]
state["scalar"] = torch.tensor(9.0)
state["empty"] = torch.zeros(0, 3)
state["parameter"] = torch.nn.Parameter(count(3, 10, torch.float32))
whole = {"epoch": 7, "loss": 0.5, "done": None, "best": True, "big": 2 ** 40, "names": ["a", "b"], "size": torch.Size([1, 2]),
         "state_dict": state, "list": [count(2, 11, torch.float32), (count(2, 12, torch.float32), "x")], 3: count(1, 13, torch.float32)}

torch.save(whole, "data/zip.pth")
torch.save(whole, "data/legacy.pth", _use_new_zipfile_serialization=False)
torch.save(count(4, 14, torch.float32), "data/bare.pth")

# The zip file again, deflated.
with zipfile.ZipFile("data/zip.pth") as old, zipfile.ZipFile("data/deflated.pth", "w", zipfile.ZIP_DEFLATED) as new:
    for name in old.namelist():
        new.writestr(zipfile.ZipInfo(name), old.read(name), zipfile.ZIP_DEFLATED)


# What Python 2 and PyTorch 0.3 wrote: byte strings, an OrderedDict made from a list, _rebuild_tensor, views of storages.
def short(text):
    return b"U" + bytes([len(text)]) + text.encode()


def integer(n):
    return b"K" + bytes([n])


def storage(key, n, view):
    return b"(" + short("storage") + b"ctorch\nFloatStorage\n" + short(key) + short("cpu") + integer(n) + view + b"tQ"


def tensor(stored, offset, shape, stride):
    return (b"ctorch._utils\n_rebuild_tensor\n(" + stored + integer(offset) + b"(" + b"".join(map(integer, shape)) + b"t(" +
            b"".join(map(integer, stride)) + b"ttR")


view = b"(" + short("v") + integer(2) + integer(3) + b"t"
pickle = (b"\x80\x02ccollections\nOrderedDict\n(](" +
          b"](" + short("a") + tensor(storage("0", 6, b"N"), 0, (2, 3), (3, 1)) + b"e" +
          b"](" + short("b") + tensor(storage("0", 6, view), 1, (2,), (1,)) + b"e" + b"etR.")
start = (b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19." + b"\x80\x02M\xe9\x03." + b"\x80\x02}" +
         short("little_endian") + b"\x88s.")
with open("data/python2.pth", "wb") as f:
    f.write(start + pickle + b"\x80\x02]" + short("0") + b"a." + struct.pack("<q6f", 6, *range(6)))
