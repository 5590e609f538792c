"""What the nodes of matrices from elsewhere are: a table that goes with the files.

The files of Abaqus, CalculiX and Nastran say nothing of places. The table is a CSV file with the
columns `node,x,y,z,role` and perhaps `components`; lines that begin with `#` are comments. Roles:

- `rim`: a node on the toothed face; it has the components 1, 2, 3;
- `seat:NAME`: either the one node of a seat, with six components, or one of three or more nodes
  with the components 1, 2, 3, which are then tied to a point on the axis as a rigid ring;
- `interior`: any other node; it will be condensed;
- `mode`: amplitudes of shapes that leave the boundary at rest; its place stays empty.

Components are 1 to 3 along x, y, z, and 4 to 6 about them; 0 is an amplitude. Where matrices do not
name their rows (OP4, plain arrays), these follow the table, node by node and component by
component. Otherwise its order is that of the rim nodes only, and it may list more nodes.
"""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ._checks import BodyError, require

# Nodes that a message lists.
_LISTED = 8


@dataclass(frozen=True)
class Companion:
    """What the nodes of matrices from elsewhere are.

    **Fields:**

    - `nodes`: their numbers.
    - `points`: their places, shape `[node, 3]` [m, or the files' unit]; NaN for amplitudes.
    - `roles`: `rim`, `seat:NAME`, `interior` or `mode`.
    - `components`: of every node, as digits; empty: those of its role.
    """

    nodes: tuple[int, ...]
    points: np.ndarray
    roles: tuple[str, ...]
    components: tuple[str, ...]

    def __post_init__(self):
        for node, role, point in zip(self.nodes, self.roles, self.points, strict=True):
            require(
                role in ("rim", "interior", "mode") or (role.startswith("seat:") and role[5:]),
                "The role of node {node} must be rim, seat:NAME, interior or mode, got {role!r}.",
                node=node,
                role=role,
            )
            require(
                role == "mode" or np.isfinite(point).all(),
                "Node {node} must have a place, three numbers. Only a `mode` has none.",
                node=node,
            )
        require(
            set().union(*self.components) <= set("0123456"),
            "Components must be digits from 1 to 6, or 0 for a mode, got {digits}.",
            digits=", ".join(sorted(set(self.components))),
        )
        numbers, times = np.unique(self.nodes, return_counts=True)
        require(
            np.all(times == 1),
            "A node must be on one line of the table, as it has one role, got twice: {twice}.",
            twice=some(numbers[times > 1]),
        )
        require("rim" in self.roles, "The table must have nodes with the role `rim`, got none.")

    def those(self, role: str) -> np.ndarray:
        """Lines of the nodes of a role."""
        return np.array([at for at, each in enumerate(self.roles) if each == role], dtype=int)

    @property
    def seats(self) -> tuple[str, ...]:
        """Names of the seats, in order of appearance."""
        names = (role.partition(":")[2] for role in self.roles if role.startswith("seat:"))
        return tuple(dict.fromkeys(names))

    def usual(self, at: int) -> str:
        """Components that a node must have by its role; any will do for others."""
        role = self.roles[at]
        if role.startswith("seat:") and self.roles.count(role) == 1:
            return "123456"
        return {"mode": "0"}.get(role, "123")


def rows_of(table: Companion, labels: np.ndarray | None, size: int) -> np.ndarray:
    """Line of the table and component of every row of the matrices.

    **Arguments:**

    - `table`: what the nodes are.
    - `labels`: node and component of every row, `[row, 2]`; None: as the table says.
    - `size`: number of rows.

    **Returns:**

    Shape `[row, 2]`; components are 1 to 6, and 0 for amplitudes.

    **Raises:**

    - `BodyError` if rows have no line, or a node has not the rows of its role.
    """
    if labels is None:
        digits = [each or table.usual(at) for at, each in enumerate(table.components)]
        pairs = [(at, int(digit)) for at, each in enumerate(digits) for digit in each]
        require(
            len(pairs) == size,
            "The matrices must have one row for each component in the table, {want}, got {size}. "
            "List every node that was kept, in the order of the rows, and state components that "
            "are not usual in a column `components`.",
            want=len(pairs),
            size=size,
        )
        rows = np.array(pairs)
    else:
        unknown = np.setdiff1d(labels[:, 0], table.nodes)
        require(
            not unknown.size,
            "Every node of the matrices must be in the table, got none for {unknown}. Add them, as "
            "`interior` if they are neither rim nor seat.",
            unknown=some(unknown),
        )
        number = {node: at for at, node in enumerate(table.nodes)}
        rows = np.array([(number[node], component) for node, component in labels])
    rows[np.isin(rows[:, 0], table.those("mode")), 1] = 0
    _check_rows(table, rows)
    return rows


def _check_rows(table: Companion, rows: np.ndarray) -> None:
    found: dict[int, str] = {}
    for at, component in sorted(map(tuple, rows.tolist())):
        found[at] = found.get(at, "") + str(component)
    for at, (node, role) in enumerate(zip(table.nodes, table.roles, strict=True)):
        got = found.get(at, "")
        fits = got == table.usual(at) or role == "interior" or (role == "mode" and got)
        require(
            fits,
            "Node {node} ({role}) must have rows for the components {want} in the matrices, got "
            "{got}. Keep them all when condensing, free of supports; a seat has one node with six "
            "components, or three nodes or more with three.",
            node=node,
            role=role,
            want=table.usual(at),
            got=got or "none",
        )


def read_table(path: Path) -> Companion:
    """Read a table, see above.

    **Raises:**

    - `BodyError` if a column is missing, or a line cannot be understood.
    """
    rows = csv.DictReader(_lines(path), skipinitialspace=True)
    columns = {name.strip().lower(): name for name in rows.fieldnames or ()}
    missing = {"node", "x", "y", "z", "role"} - set(columns)
    require(
        not missing,
        "The table {path} must begin with the line `node,x,y,z,role`, and perhaps `,components`, "
        "got no column {missing}.",
        path=path,
        missing=", ".join(sorted(missing)),
    )
    nodes, points, others = [], [], []
    for row in rows:
        values = {key: (row[column] or "").strip() for key, column in columns.items()}
        try:
            nodes.append(int(values["node"]))
            points.append([float(values[axis] or "nan") for axis in "xyz"])
        except ValueError as error:
            raise BodyError(
                f"Lines of the table {path} must be `node,x,y,z,role`, got "
                f"`{','.join(values.values())}`: {error}."
            ) from error
        others.append((values["role"], values.get("components", "")))
    roles, components = zip(*others, strict=True) if others else ((), ())
    return Companion(tuple(nodes), np.array(points).reshape(-1, 3), roles, components)


def read_faces(path: Path, table: Companion) -> np.ndarray:
    """Read elements of the rim: eight node numbers on a line.

    **Returns:**

    The same, counted among the rim nodes, shape `[face, 8]`.

    **Raises:**

    - `BodyError` if a line is something else, or names a node that is none of the rim's.
    """
    number = {table.nodes[at]: place for place, at in enumerate(table.those("rim"))}
    try:
        faces = [[number[int(word)] for word in line.split(",")] for line in _lines(path)]
        return np.array(faces, dtype=np.int64).reshape(-1, 8)
    except (KeyError, ValueError) as error:
        raise BodyError(
            f"Lines of {path} must be the numbers of eight rim nodes, got {error}. Four corners "
            "come first, counter-clockwise seen from outside, then the middles that follow them."
        ) from error


def described(size: int, arrays: dict[str, np.ndarray]) -> Companion:
    """What rows of plain arrays are: the rim, seats, and amplitudes for all others.

    **Arguments:**

    - `size`: number of rows.
    - `arrays`: `rim_nodes`, and perhaps `seats` and `seat_points`.

    **Raises:**

    - `BodyError` if they do not fit.
    """
    require(
        "rim_nodes" in arrays,
        "Arrays without a table must hold `rim_nodes`, and `seats` with `seat_points` if there are "
        "any, got {names}.",
        names=", ".join(arrays) or "none",
    )
    rim = arrays["rim_nodes"].reshape(-1, 3)
    points = arrays.get("seat_points", np.zeros((0, 3))).reshape(-1, 3)
    seats = arrays.get("seats", np.arange(len(points))).astype(str).tolist()
    free = size - 3 * len(rim) - 6 * len(points)
    require(
        free >= 0 and len(seats) == len(points),
        "A body with {rim} rim nodes, {points} seats and {seats} names of seats must have {want} "
        "rows or more, got {got}.",
        rim=len(rim),
        points=len(points),
        seats=len(seats),
        want=3 * len(rim) + 6 * len(points),
        got=size,
    )
    roles = ["rim"] * len(rim) + [f"seat:{name}" for name in seats] + ["mode"] * free
    places = np.concatenate([rim, points, np.full((free, 3), np.nan)])
    return Companion(tuple(range(1, len(roles) + 1)), places, tuple(roles), ("",) * len(roles))


def _lines(path: Path) -> Sequence[str]:
    """Lines of a text that are no comments."""
    require(path.is_file(), "There is no file {path}. Correct the path.", path=path)
    lines = path.read_text("utf-8-sig").splitlines()
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def some(numbers: Iterable[object]) -> str:
    """The first of some numbers, and how many they are."""
    each = [str(number) for number in numbers]
    more = f" and {len(each) - _LISTED} more" if len(each) > _LISTED else ""
    return ", ".join(each[:_LISTED]) + more
