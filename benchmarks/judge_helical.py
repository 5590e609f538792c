"""A helical gear in CalculiX, beside its teeth of finite elements: flanks and fillets under a load.

    python benchmarks/judge_helical.py [--record tests/data/calculix/helical_teeth.json]

The gear is that of `tests/helical_cases.py`, in 20-node bricks: its section is drawn by
`fem_prep`, turned along the axis here, and everything else is CalculiX's (`ccx`). Loads press along
the normal of the bricks' own faces: one evenly along the middle of the flank, one along a contact
line that crosses the flank. Takes half a minute
of processor time.
"""

import argparse
import dataclasses
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from helical_cases import ACROSS, FINE, GEAR, STEEL, contact_line, even_load

from fem_prep._prism import FaceWaves
from fem_prep._tooth_section import ToothSection, tooth_section

# Nodes of a quad in rows of three, as corners and middles of sides against the clock.
_ROUND = np.array([0, 6, 8, 2, 3, 7, 5, 1])
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


class Bricks:
    """The gear in 20-node bricks.

    Nodes lie on levels along the axis, two for each layer; those of the odd levels are the middles
    of edges, so that only corners of the section have them.
    """

    def __init__(self, section: ToothSection, layers: int):
        half = 0.5 * GEAR.face_width
        # Closer towards both ends.
        part = np.linspace(-1.0, 1.0, 2 * layers + 1)
        ends = half * (0.6 * part[::2] + 0.4 * np.sin(0.5 * np.pi * part[::2]))
        self.levels = np.interp(part, part[::2], ends)
        self.section = section
        plane = section.nodes
        angle = GEAR.twist * self.levels[:, None]
        x = plane[:, 0] * np.cos(angle) - plane[:, 1] * np.sin(angle)
        y = plane[:, 0] * np.sin(angle) + plane[:, 1] * np.cos(angle)
        z = np.broadcast_to(self.levels[:, None], x.shape)
        self.places = np.stack([x, y, z], axis=-1)
        quads = section.quads[:, _ROUND]
        low, count = 2 * np.arange(layers)[:, None, None] * len(plane), len(plane)
        corners, sides = quads[:, :4], quads[:, 4:]
        self.bricks = np.concatenate(
            [
                corners + low,
                corners + low + 2 * count,
                sides + low,
                sides + low + 2 * count,
                corners + low + count,
            ],
            axis=2,
        ).reshape(-1, 20)

    def on_flank(self, tooth: int, row: int, half: int, layer: int) -> np.ndarray:
        """Nodes of one face on a flank: four corners, then middles, against the clock in (s, z)."""
        line = self.section.flank[tooth, row, 2 * half : 2 * half + 3]
        low, mid, high = (2 * layer + k for k in range(3))
        count = len(self.section.nodes)
        at = [(0, low), (2, low), (2, high), (0, high), (1, low), (2, mid), (1, high), (0, mid)]
        return np.array([line[i] + level * count for i, level in at])


def _face_functions(s: float, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of a face of eight nodes at (s, t) in (-1, 1), and their slopes `[8, 2]`."""
    a = np.array([-1.0, 1.0, 1.0, -1.0, 0.0, 1.0, 0.0, -1.0])
    b = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, 0.0, 1.0, 0.0])
    corner = 0.25 * (1 + a * s) * (1 + b * t) * (a * s + b * t - 1)
    corner_s = 0.25 * a * (1 + b * t) * (2 * a * s + b * t)
    corner_t = 0.25 * b * (1 + a * s) * (a * s + 2 * b * t)
    along, up = 0.5 * (1 - s * s) * (1 + b * t), 0.5 * (1 + a * s) * (1 - t * t)
    values = np.where(np.arange(8) < 4, corner, np.where(a == 0.0, along, up))
    by_s = np.where(a == 0.0, -s * (1 + b * t), 0.5 * a * (1 - t * t))
    by_t = np.where(a == 0.0, 0.5 * b * (1 - s * s), -t * (1 + a * s))
    slopes = np.stack(
        [np.where(np.arange(8) < 4, corner_s, by_s), np.where(np.arange(8) < 4, corner_t, by_t)],
        axis=1,
    )
    return values, slopes


def normal_rows(bricks: Bricks, tooth: int, row: int, z: np.ndarray | None):
    """Points on a row of a flank: nodes, their weights along the inward normal, the axial place.

    With `z` given, means across the row at these places; else points of integration, whose weights
    are lengths along the axis.
    """
    layers = len(bricks.levels) // 2
    flat = bricks.places.reshape(-1, 3)
    ends = bricks.levels[::2]
    spots = []
    if z is None:
        for layer in range(layers):
            size = 0.5 * (ends[layer + 1] - ends[layer])
            spots += [(layer, t, w * size) for t, w in zip(_GAUSS, _WEIGHTS, strict=True)]
    else:
        for place in z:
            layer = int(np.clip(np.searchsorted(ends, place) - 1, 0, layers - 1))
            t = 2.0 * (place - ends[layer]) / (ends[layer + 1] - ends[layer]) - 1.0
            spots.append((layer, t, 1.0))
    for number, (layer, t, size) in enumerate(spots):
        for half in (0, 1):
            nodes = bricks.on_flank(tooth, row, half, layer)
            for s, weight in zip(_GAUSS, _WEIGHTS, strict=True):
                values, slopes = _face_functions(s, t)
                up, along = slopes.T @ flat[nodes]
                normal = np.cross(up, along)
                normal /= np.linalg.norm(normal)
                place = 0.5 * (ends[layer] + ends[layer + 1] + t * (ends[layer + 1] - ends[layer]))
                yield number, place, nodes, 0.25 * weight * size * values[:, None] * normal


def forces(bricks: Bricks, load: np.ndarray) -> np.ndarray:
    """Nodal forces of a load on tooth 0 by rows and waves, shape `[node, 3]` [N]."""
    waves = FaceWaves(GEAR.face_width, load.shape[1])
    total = np.zeros((bricks.places.size // 3, 3))
    # Each row of the load is two of the bricks'.
    for row in range(2 * load.shape[0]):
        for _, place, nodes, weights in normal_rows(bricks, 0, row, None):
            own = 0.5 * waves.at(np.array([place]))[0] @ load[row // 2]
            np.add.at(total, nodes, weights * own)
    return total


def deck(bricks: Bricks, loads: list[np.ndarray]) -> str:
    """The input of CalculiX, a step for each load."""
    flat, used = bricks.places.reshape(-1, 3), np.unique(bricks.bricks)
    lines = ["*NODE, NSET=ALL"]
    lines += ["{}, {:.12e}, {:.12e}, {:.12e}".format(i + 1, *flat[i]) for i in used]
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=BODY")
    for i, brick in enumerate((bricks.bricks + 1).tolist(), 1):
        lines += [f"{i}, {', '.join(map(str, brick[:15]))},", ", ".join(map(str, brick[15:]))]
    held = (
        bricks.section.bore[None]
        + len(bricks.section.nodes) * np.arange(len(bricks.levels))[:, None]
    )
    lines += ["*NSET, NSET=BORE", *(f"{node + 1}," for node in np.intersect1d(held, used))]
    lines += ["*MATERIAL, NAME=STEEL", "*ELASTIC", f"{STEEL.young}, {STEEL.poisson}"]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL", "*BOUNDARY", "BORE, 1, 3"]
    for load in loads:
        lines += ["*STEP", "*STATIC", "*CLOAD, OP=NEW"]
        for node in np.flatnonzero(np.abs(load).max(axis=1)):
            lines += [f"{node + 1}, {k + 1}, {load[node, k]:.12e}" for k in range(3)]
        lines += ["*NODE FILE", "U", "*EL FILE", "S", "*END STEP"]
    return "\n".join([*lines, ""])


def results(path: Path, name: str, count: int, nodes: int) -> list[np.ndarray]:
    """Values at the nodes for each step, from a text file of CalculiX."""
    found, inside = [], False
    for line in path.read_text().splitlines():
        if line.startswith(" -4"):
            inside = name in line
            if inside:
                found.append(np.zeros((nodes, count)))
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            values = [float(line[13 + 12 * k : 25 + 12 * k]) for k in range(count)]
            found[-1][int(line[3:13]) - 1] = values
    return found


def flank_motion(bricks: Bricks, moved: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Means across each row along the inward normal, shape `[tooth, row, place]`."""
    teeth, rows, _ = bricks.section.flank.shape
    result = np.zeros((teeth, rows, len(z)))
    for tooth in range(teeth):
        for row in range(rows):
            for number, _, nodes, weights in normal_rows(bricks, tooth, row, z):
                result[tooth, row, number] += np.sum(weights * moved[nodes])
    return 0.5 * (result[:, ::2] + result[:, 1::2])


def root_stress(bricks: Bricks, stress: np.ndarray) -> list[float]:
    """Largest tension in the gap on the loaded side at mid-face, compression on the other [MPa].

    Along the surface and square to the axis, at nodes.
    """
    count, level = len(bricks.section.nodes), len(bricks.levels) // 2
    found = []
    for side in (0, 1):
        values = []
        for quad, edge in zip(
            bricks.section.root_quads[0, side], bricks.section.root_edges[0, side], strict=True
        ):
            at = quad[[2, 5, 8] if side == 0 else [0, 3, 6]] if edge[0] else quad[[6, 7, 8]]
            first, middle, last = bricks.section.nodes[at]
            # Slopes of the edge, a parabola, at both of its ends.
            slopes = 4.0 * middle - 3.0 * first - last, 3.0 * last - 4.0 * middle + first
            for node, tangent in zip(at[::2], slopes, strict=True):
                sxx, syy, _, sxy, _, _ = stress[level * count + node]
                x, y = tangent / np.linalg.norm(tangent)
                values.append(x * x * sxx + y * y * syy + 2 * x * y * sxy)
        found.append(round(1e-6 * float((max, min)[side](values)), 4))
    return found


def main() -> None:
    """Run CalculiX, print and record what it finds."""
    parser = argparse.ArgumentParser(description="A helical gear in CalculiX.")
    parser.add_argument("--record", type=Path)
    parser.add_argument("--layers", type=int, default=10)
    chosen = parser.parse_args()
    sizing = dataclasses.replace(FINE, flank=2 * FINE.flank, gap=4 * FINE.gap)
    section = tooth_section(GEAR, 2, sizing)
    bricks = Bricks(section, chosen.layers)
    loads = [even_load(), contact_line()]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gear.inp"
        path.write_text(deck(bricks, [forces(bricks, load) for load in loads]))
        subprocess.run(["ccx", "-i", "gear"], cwd=folder, check=True)
        count = bricks.places.size // 3
        moved = results(path.with_suffix(".frd"), "DISP", 3, count)
        stress = results(path.with_suffix(".frd"), "STRESS", 6, count)
    answer = {"bricks": len(bricks.bricks), "z_mm": np.round(1e3 * ACROSS, 6).tolist()}
    for name, u, s in zip(("even", "line"), moved, stress, strict=True):
        answer[name] = {
            "flank_um": np.round(1e6 * flank_motion(bricks, u, ACROSS), 5).tolist(),
            "root_MPa": root_stress(bricks, s),
        }
    text = json.dumps(answer)
    if chosen.record:
        chosen.record.write_text(text + "\n")
    else:
        sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
