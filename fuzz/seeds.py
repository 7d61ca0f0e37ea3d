#!/usr/bin/env python3
"""Writes the fuzzer's first inputs below target/seeds.

    python3 seeds.py

gcode_line: from each file of gcode/corpus, one line of every shape (a shape is
the line with its digits taken out), five lines a seed, and the cases below,
which no slicer of the corpus writes. reply: replies.txt, a reply a seed, and
all of it at once. bgcode: the binary files of gcode/corpus, as blocks by
themselves, with each compression and encoding, and text to be packed. stl: a
block as binary, as text and as corners on the target's grid, whole and damaged.
archive: small SL1 and NanoDLP jobs of our own, as zips and as the entries that
archive.rs makes zips of. goo: what stands behind the previews of small files of our
own, whole and as the layers that goo.rs frames. journal: payloads as journal.rs frames them, and a
whole small file. Standard library only.
"""
import io
import re
import shutil
import struct
import zipfile
import zlib
from pathlib import Path

HERE = Path(__file__).resolve().parent
LINES_A_SEED = 5  # short inputs are mutated best
SHAPES_A_FILE = 200  # Cura's and PrusaSlicer's headers would fill the folder otherwise

ODD = [
    b'N12 G1 X10.5 Y-3*47\n', b'N-1 M110 N-1*125\n', b'n3 g1 x1e5\n', b'  G1 X1\t Y2 \r\n', b'G1X10Y10E5\n',
    b'M117 N5 hello ; there *3\n', b'M118 E1 "a;b"\n', b"EXCLUDE_OBJECT_START NAME='a b'\n", b'G1 (a comment) X1 (another\n',
    b'M862.3 P "MK3S" ; printer\n', b'Tx\n', b'T?\n', b'T0\n', b'G28 X Y\n', b'G1 X+.5 Y-.5 Z5. E--1\n', b';\xff\xfe\x00\n',
    b'G1 X1 Y2 Z3 A4 B5 C6 U7 V8 W9 E10 F11 S12 I13 J14 K15\n', b'G99999999999 X1\n', b'G1 X' + b'9' * 400 + b'\n', b'*\n', b'N1*1*1\n',
    b'\r\r\n', b'%\n', b'G2 X1 Y1 I.5 J-.5 R2\n', b'M486 Apart one*12\n', b'G1 X1/G1 X2\n', b'\n',
]


def write(folder, seeds):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for i, seed in enumerate(seeds):
        (folder / f'{i:04}').write_bytes(seed)
    print(f'{folder}: {len(seeds)} seeds')


def gcode_line():
    seeds, seen = list(ODD), set()
    for path in sorted((HERE / '../gcode/corpus').glob('*.gcode')):
        chosen = []
        for line in path.read_bytes().splitlines(keepends=True):
            shape = re.sub(rb'[0-9.]+', b'0', line)
            if shape not in seen and len(chosen) < SHAPES_A_FILE and len(line) < 300:
                seen.add(shape)
                chosen.append(line)
        seeds += [b''.join(chosen[i:i + LINES_A_SEED]) for i in range(0, len(chosen), LINES_A_SEED)]
    return seeds


def reply():
    whole = (HERE / 'replies.txt').read_bytes()
    return whole.splitlines(keepends=True) + [whole, whole.replace(b'\n', b'\r\n')]


def bgcode():
    packed = b'\xff\xff\xfb\xff\xff\xf7\x1d\xae\xf5Y\xb2\xc0\x8fM\xc4\xff\xff\xfa;TYPE:A\n\xff\xff\xfb\x1d\xcc\xff\xff\xf9'
    gcode = lambda compression, data, size, encoding: struct.pack(
        '<HHI', 1, compression, size) + (struct.pack('<I', len(data)) if compression else b'') + bytes([encoding, 0]) + data
    blocks = [gcode(0, packed, len(packed), 2), gcode(0, b'G1 X1 ; a\n', 10, 0), gcode(1, zlib.compress(packed), len(packed), 1),
              gcode(2, b'\xa3\x80\x01\x80', 5, 0), gcode(3, b'\xa3\x80\x00\xc0', 5, 0),
              struct.pack('<HHI', 0, 0, 11) + b'\0\0Producer=A\n', struct.pack('<HHI', 5, 0, 4) + b'\0\0\x10\0\x10\0\x89PNG']
    files = [path.read_bytes() for path in sorted((HERE / '../gcode/corpus').glob('*.bgcode'))]
    text = b'G1 X1.5 Y2 E.5 F300 ; a\n;TYPE:Perimeter\n\nM104 S200\nGET_POSITION\n'
    return blocks + [b''.join(blocks)] + [file[:4096] for file in files] + [bytes([how]) + text for how in range(32)]
def stl():
    sides = [((0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)), ((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
             ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)), ((1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)),
             ((1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1)), ((0, 1, 0), (0, 0, 0), (0, 0, 1), (0, 1, 1))]
    block = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
    scaled = [[[4 * k for k in corner] for corner in t] for t in block]
    inner = [[[k + 1 for k in corner] for corner in reversed(t)] for t in block]
    soups = [block, block[1:], block[2:], block + block, block[:3] + [t[::-1] for t in block[3:]], scaled + inner, block * 3]
    soups.append([[[k % 16 for k in corner] for corner in t] for n in range(8) for t in [[(n, 5, 0), (0, n, 6), (7, n, n)]]])
    seeds = []
    for soup in soups:
        # Two bytes a corner, as the target takes them after an odd first byte.
        seeds.append(b'\1' + b''.join(bytes((x | y << 4, z)) for t in soup for x, y, z in t))
        triangles = b''.join(struct.pack('<12fH', 0, 0, 0, *(k for corner in t for k in corner), 0) for t in soup)
        seeds.append(b'solid'.ljust(80) + struct.pack('<I', len(soup)) + triangles)
        facets = ''.join('facet normal 0 0 0\nouter loop\n' + ''.join('vertex %g %g %.1e\n' % tuple(v) for v in t)
                         + 'endloop\nendfacet\n' for t in soup[:20])
        seeds.append(f'solid a\n{facets}endsolid a\n'.encode())
    return seeds


def png(width, height, rows, depth=8, colour=0):
    def chunk(kind, data):
        return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
    header = struct.pack('>IIBBBBB', width, height, depth, colour, 0, 0, 0)
    data = zlib.compress(b''.join(b'\0' + row for row in rows))
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + chunk(b'IDAT', data) + chunk(b'IEND', b'')


def archive():
    art = ['#.#.####', '.#..#..#', '#.#.#.##', '....####', '####.#.#', '#..#.###']
    rows = [bytes(255 if c == '#' else i * 20 for c in row) for i, row in enumerate(art)]
    config = b'jobDir = j\nlayerHeight = 0.05\nexpTime = 5\nexpTimeFirst = 20\nnumFade = 1\nnumFast = 2\nnumSlow = 0\n'
    panel = (b'display_width = 0.4\ndisplay_height = 0.3\ndisplay_pixels_x = 8\ndisplay_pixels_y = 6\n'
             b'display_orientation = landscape\ndisplay_mirror_x = 1\n')
    options = b'{"PWidth":8,"PHeight":6,"XPixelSize":0.019,"YPixelSize":0.024,"Thickness":50,"ImageMirror":1}'
    profile = b'{"Depth":50,"CureTime":2,"SupportCureTime":20,"SupportLayerNumber":1,"TransitionalLayer":1}'
    grey = png(8, 6, rows)
    rgb = png(3, 6, [row + b'\0' for row in rows], colour=2)
    bits = png(8, 6, [bytes([i * 37]) for i in range(6)], depth=1)
    sl1 = [('config.ini', config), ('prusaslicer.ini', panel), ('j00000.png', grey), ('j00001.png', bits)]
    nano = [('plate.json', b'{"LayersCount":2}'), ('options.json', options), ('profile.json', profile), ('1.png', grey)]
    # The order of NAMES in src/archive.rs.
    names = ['config.ini', 'prusaslicer.ini', 'j00000.png', 'j00001.png', 'plate.json', 'options.json', 'slicer.json',
             'profile.json', 'override.json', '0.png', '1.png', '2.png']
    seeds = []
    for job in [sl1, nano + [('2.png', grey)], nano + [('2.png', bits)], nano[:3] + [('0.png', rgb), ('1.png', rgb)]]:
        for packed in [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED]:
            out = io.BytesIO()
            with zipfile.ZipFile(out, 'w', packed) as z:
                for name, data in job:
                    z.writestr(zipfile.ZipInfo(name), data, packed)
            seeds.append(out.getvalue())
        seeds.append(b''.join(struct.pack('<BH', names.index(name), len(data)) + data for name, data in job))
    return seeds


def goo():
    head = lambda layers, by_layer, z=0.05: struct.pack(
        '>IHHBBffff f Bf 6f fI 16f HHBIfff8sIBH', layers, 8, 6, 1, 0, 0.4, 0.3, 165, z, 3, 1, 0, *[0, 0, 0.5] * 2,
        30, 1, *[5, 60, 5, 60, 5, 150, 5, 150] + [0] * 8, 255, 255, by_layer, 60, 9, 9, 1, b'$', 195477, 1, 1)
    pictures = [b'\x10\x03', b'\xd0\x03', b'\x41\x07\x81\xa2\x92\x05\x0f\xcf\x0a', b'\x20\x00\x03', b'\x70\x80\x00\x00\x03']
    definition = lambda n: struct.pack('>H15fH', n == 1, 165, 0.05 * (n + 1), 30 if n == 0 else 3, 0, 0, 0, 0.5,
                                       5, 60, 0, 0, 5, 150, 0, 0, 255) + b'\r\n'
    def whole(n, runs):
        framed = b'\x55' + runs + bytes([~sum(runs) & 255])
        return definition(n) + struct.pack('>I', len(framed)) + framed + b'\r\n'
    seeds = []
    for count in (1, 2, 5):
        some = list(enumerate(pictures[:count]))
        end = b'\0\0\0\7\0\0\0DLP\0'
        seeds.append(b'\0' + head(count, 0) + b''.join(whole(n, runs) for n, runs in some) + end)
        seeds.append(b'\1' + head(count, 1) + b''.join(definition(n) + struct.pack('<H', len(runs)) + runs for n, runs in some))
    return seeds


def journal():
    def text(data):
        return struct.pack('<I', len(data)) + data
    checkpoint = struct.pack('<QQIdffff', 400, 512, 17, 3.4, 209.7, 210, 60, 60)
    accepted = (text(b'/jobs/a.gcode') + bytes(32) + struct.pack('<QQQIII', 4000, 1000, 1500, 65536, 1, 0) + bytes(12)
                + text(b'ender-3') + struct.pack('<QQ', 1795349100, 99))
    numbers = [b'\0' + struct.pack('<Q', 0), b'\1' + struct.pack('<IQIIIII', 17, 0, 2, 20, 3, 40, 1)]
    opened = text(b'usb:1A2B') + struct.pack('<IQ', 250000, 1795349160)
    pictures = [b'\1' + accepted + b'\1\0' + bytes(4) + numbers[0] + checkpoint + b'\0\0\0',
                b'\1' + accepted + b'\3\1' + opened + struct.pack('<I', 2) + numbers[1] + checkpoint
                + b'\1\1' + struct.pack('<d', 13.4) + b'\1' + text(b'the cable') + b'\1']
    batches = [b'\2' + opened + b'\3\2', b'\4' + struct.pack('<IQ', 17, 0) + b'\3\3', b'\7' + checkpoint + b'\5\x40\0\0\0',
               b'\6' + struct.pack('<Q', 400) + b'\3\5', b'\x08\1' + struct.pack('<d', 13.4) + b'\x09' + text(b'why')]
    framed = lambda payloads: b''.join(struct.pack('<H', len(p)) + p for p in payloads)
    seeds = [framed([picture] + some) for picture in pictures for some in ([], batches[:2], batches, batches * 3)]
    head = b'OUTRJOB\x1a' + struct.pack('<HHII', 1, 0, 1, 1)
    head += struct.pack('<I', zlib.crc32(head))
    payload = pictures[1]
    frame = struct.pack('<I', len(payload)) + struct.pack(
        '<I', zlib.crc32(struct.pack('<IIII', 1, 1, len(head), len(payload)) + payload)) + payload
    return seeds + [head + frame, head + frame + bytes(100)]


if __name__ == '__main__':
    write(HERE / 'target/seeds/journal', journal())
    write(HERE / 'target/seeds/archive', archive())
    write(HERE / 'target/seeds/goo', goo())
    write(HERE / 'target/seeds/gcode_line', gcode_line())
    write(HERE / 'target/seeds/reply', reply())
    write(HERE / 'target/seeds/bgcode', bgcode())
    write(HERE / 'target/seeds/stl', stl())
