#!/usr/bin/env python3
"""Makes the models that the corpus is sliced from.

    python3 models.py [FOLDER]      writes demo.stl, comb.stl, bench.stl and lamp.stl there

Takes nothing, gives binary STL in millimetres, always the same bytes. Knows no
slicer. Standard library only.

Every solid is built from loops (closed lists of points, seen from above) in
two ways: a wall joins a loop at one height to a loop of as many points at
another, and a cap fills an outer loop less its holes at one height. The pieces
share their points exactly, so `check` can insist on a closed surface: each
edge is used once in each direction.
"""
import math
import struct
import sys
from pathlib import Path


# ---------------------------------------------------------------- loops (mm)

def circle(x, y, radius, points=12):
    """A circle, counter-clockwise."""
    step = 2 * math.pi / points
    return [(x + radius * math.cos(i * step), y + radius * math.sin(i * step)) for i in range(points)]


def hull(length, width, points=20):
    """A boat seen from above, counter-clockwise: a superellipse of exponent 3,
    fuller than an ellipse and without straight sides."""
    def bend(v):
        return math.copysign(abs(v) ** (2 / 3), v)
    step = 2 * math.pi / points
    return [(length / 2 * bend(math.cos(i * step)), width / 2 * bend(math.sin(i * step))) for i in range(points)]


def slot(x, y, length, width, points=5):
    """A rounded slot along x, counter-clockwise."""
    r, dx = width / 2, (length - width) / 2
    ends = []
    for side, start in ((1, -math.pi / 2), (-1, math.pi / 2)):
        for i in range(points + 1):
            a = start + math.pi * i / points
            ends.append((x + side * dx + r * math.cos(a), y + r * math.sin(a)))
    return ends


def box(x0, y0, x1, y1):
    """A rectangle, counter-clockwise."""
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


# -------------------------------------------------------------- the triangles

def area2(loop):
    """Twice the signed area: positive when counter-clockwise."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(loop, loop[1:] + loop[:1]))


def cross(o, a, b):
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def inside(p, a, b, c):
    return cross(a, b, p) >= 0 and cross(b, c, p) >= 0 and cross(c, a, p) >= 0


def crosses(p, q, loop):
    """Whether the open segment p q meets an edge of the loop that ends at neither."""
    for a, b in zip(loop, loop[1:] + loop[:1]):
        if p in (a, b) or q in (a, b):
            continue
        if cross(p, q, a) * cross(p, q, b) <= 0 and cross(a, b, p) * cross(a, b, q) <= 0:
            return True
    return False


def bridge(outer, holes):
    """One loop out of an outer loop (counter-clockwise) and holes (clockwise):
    each hole is tied in by its shortest bridge that crosses nothing."""
    loop, left = list(outer), [list(h) for h in holes]
    while left:
        ties = sorted((math.dist(p, q), k, i, j)
                      for k, hole in enumerate(left)
                      for i, p in enumerate(loop) for j, q in enumerate(hole))
        k, i, j = next((k, i, j) for _, k, i, j in ties
                       if not any(crosses(loop[i], left[k][j], l) for l in [loop] + left))
        hole = left.pop(k)
        loop[i + 1:i + 1] = hole[j:] + hole[:j + 1] + [loop[i]]
    return loop


def fill(outer, holes):
    """Triangles (counter-clockwise) of an outer loop less its holes, by ear clipping."""
    loop = bridge(outer if area2(outer) > 0 else outer[::-1],
                  [h if area2(h) < 0 else h[::-1] for h in holes])
    triangles = []
    while len(loop) > 3:
        for i in range(len(loop)):
            a, b, c = loop[i - 1], loop[i], loop[(i + 1) % len(loop)]
            if cross(a, b, c) > 1e-12 and not any(inside(p, a, b, c) for p in loop if p not in (a, b, c)):
                triangles.append((a, b, c))
                del loop[i]
                break
        else:
            raise ValueError('a loop crosses itself')
    return triangles + [tuple(loop)]


class Solid:
    def __init__(self):
        self.triangles = []

    def cap(self, z, outer, holes=(), up=True):
        """Fills `outer` less `holes` at height z, facing up or down."""
        for a, b, c in fill(outer, holes):
            t = [(*a, z), (*b, z), (*c, z)]
            self.triangles.append(t if up else t[::-1])

    def wall(self, low, z0, high, z1, hole=False):
        """Joins loop `low` at z0 to `high` at z1, facing outwards (inwards of a hole)."""
        n = len(low)
        for i in range(n):
            j = (i + 1) % n
            a, b, c, d = (*low[i], z0), (*low[j], z0), (*high[j], z1), (*high[i], z1)
            for t in ([a, b, c], [a, c, d]):
                self.triangles.append(t[::-1] if hole else t)

    def check(self):
        """Raises ValueError unless every edge is used once in each direction."""
        edges = {}
        for t in self.triangles:
            for a, b in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0])):
                edges[a, b] = edges.get((a, b), 0) + 1
        bad = sum(n != 1 or edges.get((b, a)) != 1 for (a, b), n in edges.items())
        if bad:
            raise ValueError(f'{bad} edges of the surface are open or doubled')

    def save(self, path):
        self.check()
        out = bytearray(b'made by models.py of the Outrigger project'.ljust(80, b'\0'))
        out += struct.pack('<I', len(self.triangles))
        for t in self.triangles:
            u = [t[1][i] - t[0][i] for i in range(3)]
            v = [t[2][i] - t[0][i] for i in range(3)]
            n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
            size = math.sqrt(sum(c * c for c in n)) or 1.0
            out += struct.pack('<12fH', *(c / size for c in n), *(c for p in t for c in p), 0)
        path.write_bytes(out)
        print(f'{path}: {len(self.triangles)} triangles')


# ----------------------------------------------------------------- the models

def demo():
    """An outrigger float: a hull of 42 x 26 x 7.2 mm with sloping sides, drilled
    through for four lashings and a spar, with two posts on its deck.

    The holes cut the sparse infill into many beads, the slope leaves a narrow
    strip of solid infill in sight at every layer, the posts are two islands."""
    s = Solid()
    base, deck, z_deck, z_top = hull(42, 26), hull(40, 24), 4.5, 7.2
    lashings = [circle(x, y, 1.7) for x in (-9, 9) for y in (-5.5, 5.5)]
    spar = slot(0, 0, 9, 3.2)
    posts = [(circle(x, 0, 4.2, 20), circle(x, 0, 1.6)) for x in (-12.5, 12.5)]
    drilled = lashings + [spar]
    s.cap(0, base, drilled + [h for _, h in posts], up=False)
    s.wall(base, 0, deck, z_deck)
    s.cap(z_deck, deck, drilled + [p for p, _ in posts])
    for h in drilled:
        s.wall(h, 0, h, z_deck, hole=True)
    for post, hole in posts:
        s.wall(post, z_deck, post, z_top)
        s.wall(hole, 0, hole, z_top, hole=True)
        s.cap(z_top, post, [hole])
    return s


def comb():
    """A comb of 26 x 12 x 2 mm whose teeth grow from 0.9 to 2.2 mm in width:
    between a whole number of perimeters there are gaps to be filled."""
    outline, x = [(0.0, 0.0)], 0.0
    top = []
    for i in range(8):
        width = 0.9 + 1.3 * i / 7
        # A tooth also tapers by 0.3 mm, so that the gap in it changes its width.
        top += [(x, 4.0), (x + 0.15, 12.0), (x + width - 0.15, 12.0), (x + width, 4.0)]
        x += width + 1.6
    x -= 1.6
    s = Solid()
    outline = [(0.0, 0.0), (x, 0.0)] + top[::-1]
    s.cap(0, outline, up=False)
    s.wall(outline, 0, outline, 2.0)
    s.cap(2.0, outline)
    return s


def bench():
    """A bench of 24 x 14 x 5 mm: two feet, and a seat that bridges them."""
    s = Solid()
    feet = [box(-11, -6, -6, 6), box(6, -6, 11, 6)]
    seat, hole = box(-12, -7, 12, 7), circle(0, 0, 2.5, 20)
    for foot in feet:
        s.cap(0, foot, up=False)
        s.wall(foot, 0, foot, 2.0)
    s.cap(2.0, seat, feet + [hole], up=False)
    s.wall(seat, 2.0, seat, 5.0)
    s.wall(hole, 2.0, hole, 5.0, hole=True)
    s.cap(5.0, seat, [hole])
    return s


def lamp():
    """A gate of 30 x 12 x 9 mm with a lamp under its beam: the lamp begins in the air, and
    hangs together with the rest only from the beam on."""
    s = Solid()
    feet = [box(-14, -5, -8, 5), box(8, -5, 14, 5)]
    bulb, beam = circle(0, 0, 3.0, 24), box(-15, -6, 15, 6)
    for foot in feet:
        s.cap(0, foot, up=False)
        s.wall(foot, 0, foot, 6.6)
    s.cap(3.0, bulb, up=False)
    s.wall(bulb, 3.0, bulb, 6.6)
    s.cap(6.6, beam, [*feet, bulb], up=False)
    s.wall(beam, 6.6, beam, 9.0)
    s.cap(9.0, beam)
    return s


def main():
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent)
    for model in (demo, comb, bench, lamp):
        model().save(folder / f'{model.__name__}.stl')


if __name__ == '__main__':
    main()
