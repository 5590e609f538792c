"""What the parts of a condensed body must be to fit each other."""

from collections.abc import Iterator

import numpy as np

from ._artefact import ReducedBody
from ._checks import require

OPTIONAL = ("coriolis", "spin_softening", "stress_stiffening")
AGAIN = "Condense the body again, or copy the file again from where it came."

# Relative to the largest entry: condensation makes its matrices symmetric, so this is rounding.
_SYMMETRIC = 1e-9

# Rows compared with columns at a time, so that both stay in the caches.
_ROWS = 256


def check_body(body: ReducedBody) -> None:
    """Refuse a body whose parts do not fit each other.

    **Arguments:**

    - `body`: what to check.

    **Raises:**

    - `BodyError` if an array has the wrong shape or is not finite, if a matrix is not symmetric
        (Coriolis: skew), if an element names a node that is not there, or if a name stands twice.
    """
    _check_names(body)
    for name, shape in _shapes(body):
        array = getattr(body, name)
        if array is None:
            continue
        require(
            len(array.shape) == len(shape)
            and all(want in (-1, got) for want, got in zip(shape, array.shape, strict=True)),
            "`ReducedBody.{name}` must have the shape {want}, got {got}: the body has {rim} rim "
            "nodes, {seats} seats and {interior} interior shapes. " + AGAIN,
            name=name,
            want=list(shape),
            got=list(array.shape),
            rim=len(body.rim_nodes),
            seats=len(body.seats),
            interior=body.interior,
        )
        # One number that is not finite makes the sum so too; no copy is made.
        with np.errstate(invalid="ignore"):
            total = np.sum(array)
        require(
            np.isfinite(total),
            "`ReducedBody.{name}` must be finite, got NaN or infinity. Check the grid for "
            "inverted elements and the material for zeros, and condense the body again.",
            name=name,
        )
    for name in ("stiffness", "mass", *OPTIONAL):
        _check_symmetry(name, getattr(body, name))
    for name, count in (("rim_faces", len(body.rim_nodes)), ("bricks", len(body.nodes))):
        array = getattr(body, name)
        require(
            not array.size or (array.min() >= 0 and array.max() < count),
            "`ReducedBody.{name}` must name nodes 0 to {last}, got {low} to {high}. " + AGAIN,
            name=name,
            last=count - 1,
            low=array.min() if array.size else 0,
            high=array.max() if array.size else 0,
        )


def _check_names(body: ReducedBody) -> None:
    for kind, names, points in (
        ("seats", body.seats, body.seat_points),
        ("probes", body.probes, body.probe_points),
    ):
        require(
            len(set(names)) == len(names) == len(points),
            "`ReducedBody.{kind}` must be names of their own, one for each of {count} points, got "
            "{names}. Rename them, or condense the body again.",
            kind=kind,
            count=len(points),
            names=", ".join(names) or "none",
        )


def _shapes(body: ReducedBody) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Shape that each array must have; -1 stands for any number."""
    dof = body.boundary_dofs + body.interior
    yield "rim_nodes", (-1, 3)
    yield "seat_points", (len(body.seats), 3)
    yield "stiffness", (dof, dof)
    yield "mass", (dof, dof)
    yield "centrifugal_load", (dof,)
    yield "rim_faces", (-1, 8)
    yield "probe_points", (len(body.probes), 3)
    yield "probe_rows", (len(body.probes), 3, dof if body.probes else -1)
    yield "nodes", (-1, 3)
    yield "bricks", (-1, 20)
    seen = (body.interior, len(body.nodes)) if body.interior_shapes.size else (-1, -1)
    yield "interior_shapes", (*seen, 3)
    for name in OPTIONAL:
        yield name, (dof, dof)


def _check_symmetry(name: str, matrix: np.ndarray | None) -> None:
    """Compare a matrix with its transpose; Coriolis forces do no work, so theirs is skew."""
    if matrix is None or not matrix.size:
        return
    sign = -1 if name == "coriolis" else 1
    largest = max(matrix.max(), -matrix.min(), np.finfo(float).tiny)
    for start in range(0, len(matrix), _ROWS):
        rows = matrix[start : start + _ROWS, start:]
        off = np.abs(rows - sign * matrix[start:, start : start + _ROWS].T).max()
        require(
            off <= _SYMMETRIC * largest,
            "`ReducedBody.{name}` must be {kind}, got entries that differ by {off:.3g} of the "
            "largest from row {start} on. " + AGAIN,
            name=name,
            kind="symmetric" if sign > 0 else "skew",
            off=off / largest,
            start=start,
        )
