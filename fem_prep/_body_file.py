"""The file of a condensed body.

It is an archive, see `write_archive`, in which every array of `ReducedBody` is a member under its
own name, little-endian float64 or int64; an array that is None is left out. Its text has `name`,
`seats`, `interior`, `probes` and `facts`. Of a body of equal sectors a matrix is in two parts, of
which it is made again to the last digit: `NAME.sector`, what the first sector of the rim says to
those ahead, and `NAME.others`, the rows of the seats and interior shapes. Its interior shapes are
there on two sectors, `interior_shapes.sector`, with their numbers of waves around,
`interior_shapes.waves`.
"""

import os
from typing import Any, NamedTuple

import numpy as np

from ._archive import archive_text, content_digest, read_archive, write_archive
from ._artefact import ReducedBody
from ._body_checks import AGAIN, OPTIONAL, check_body
from ._checks import require
from ._equal_sectors import MATRICES, EqualSectors, equal_sectors, signs
from ._sector_shapes import SectorShapes, sector_shapes

_FLOATS = ("stiffness", "mass", "centrifugal_load", "rim_nodes", "seat_points", "probe_points")
_FLOATS += ("probe_rows", "nodes", "interior_shapes")
_INTEGERS = ("rim_faces", "bricks")
_KINDS: dict[str, str] = {name: "<f8" for name in _FLOATS + OPTIONAL}
_KINDS |= {name: "<i8" for name in _INTEGERS}
# Parts of a matrix of equal sectors.
_SECTOR, _OTHERS = ".sector", ".others"
_SHAPES, _WAVES = "interior_shapes", "interior_shapes.waves"


def write_body(path: str | os.PathLike, body: ReducedBody) -> str:
    """Write a body to a file, whole or not at all.

    **Arguments:**

    - `path`: of the file; one that is there is replaced.
    - `body`: what to write.

    **Returns:**

    Its content hash.

    **Raises:**

    - `BodyError` if the body is not sound, see `check_body`, or its facts cannot be written.
    - `OSError` if the file cannot be written.
    """
    check_body(body)
    return write_archive(path, *_packed(body))


def read_body(path: str | os.PathLike) -> ReducedBody:
    """Read a body from a file.

    **Arguments:**

    - `path`: of a file that `write_body` wrote.

    **Returns:**

    The body, the same to the last digit.

    **Raises:**

    - `BodyError` if there is no such file; if it is no body's, truncated or altered; if its
        format or its units are others; or if the body is not sound, see `check_body`.
    """
    packed, about = read_archive(path)
    arrays = _whole(packed, about, path)
    missing = [name for name in (*_FLOATS, *_INTEGERS) if name not in arrays]
    keys = ("name", "seats", "interior", "probes", "facts")
    missing += [key for key in keys if key not in about]
    require(
        not missing,
        "The file {path} must hold all parts of a body, got none named {names}. " + AGAIN,
        path=path,
        names=", ".join(missing),
    )
    strange = sorted(name for name in arrays if _KINDS.get(name) != arrays[name].dtype.str)
    require(
        not strange,
        "Arrays of the file {path} must be known and hold float64, or int64 for elements, got "
        "{strange}. " + AGAIN,
        path=path,
        strange=", ".join(f"{name} of {arrays[name].dtype}" for name in strange),
    )
    body = ReducedBody(
        **arrays,
        name=about["name"],
        seats=tuple(about["seats"]),
        interior=about["interior"],
        probes=tuple(about["probes"]),
        facts=about["facts"],
    )
    check_body(body)
    return body


def content_hash(body: ReducedBody) -> str:
    """SHA-256 of everything that the file of a body holds, versions of the libraries too."""
    return content_digest(*_packed(body))


def _packed(body: ReducedBody) -> tuple[dict[str, np.ndarray], str]:
    """Arrays as they go into the file, and the text about them."""
    arrays = {
        name: np.ascontiguousarray(getattr(body, name), dtype=kind)
        for name, kind in _KINDS.items()
        if getattr(body, name) is not None
    }
    sectors = equal_sectors(body.rim_nodes, body.facts)
    if sectors is not None:
        for name in MATRICES:
            if name in arrays and (parts := _parts(arrays[name], sectors, signs(name))):
                del arrays[name]
                arrays |= {name + _SECTOR: parts.sector, name + _OTHERS: parts.others}
    grid = equal_sectors(body.nodes, body.facts) if body.interior_shapes.size else None
    if grid is not None:
        waves, two = found = sector_shapes(arrays[_SHAPES], grid)
        if np.array_equal(found.whole(grid), arrays[_SHAPES]):
            del arrays[_SHAPES]
            arrays |= {_SHAPES + _SECTOR: two, _WAVES: waves.astype("<i8")}
    about = {
        "name": body.name,
        "seats": list(body.seats),
        "interior": body.interior,
        "probes": list(body.probes),
        "facts": body.facts,
    }
    return arrays, archive_text(about)


class _Parts(NamedTuple):
    """What of a matrix is kept: the rim's rows of one sector, and all others."""

    sector: np.ndarray
    others: np.ndarray

    def joined(self, sectors: EqualSectors, sign: int) -> np.ndarray:
        """The whole matrix."""
        rim = 3 * sectors.nodes.size
        matrix = sectors.block(self.sector, sign, more=len(self.others))
        matrix[rim:] = self.others
        matrix[:rim, rim:] = sign * self.others[:, :rim].T
        return matrix


def _parts(matrix: np.ndarray, sectors: EqualSectors, sign: int) -> _Parts | None:
    """The parts of which a matrix is made again to the last digit; none if it would not be so."""
    rim = 3 * sectors.nodes.size
    parts = _Parts(sectors.rows(matrix[:rim, :rim], sign), np.ascontiguousarray(matrix[rim:]))
    return parts if np.array_equal(parts.joined(sectors, sign), matrix) else None


def _whole(
    packed: dict[str, np.ndarray], about: dict[str, Any], path: object
) -> dict[str, np.ndarray]:
    """The arrays of a file, its matrices whole again."""
    parts = _SECTOR, _OTHERS, _WAVES
    arrays = {name: x for name, x in packed.items() if not name.endswith(parts)}
    if _SHAPES + _SECTOR in packed and _WAVES in packed:
        arrays[_SHAPES] = _whole_shapes(packed, about, path)
    named = [name for name in MATRICES if name + _SECTOR in packed and name + _OTHERS in packed]
    if not named:
        return arrays
    sectors = equal_sectors(packed.get("rim_nodes", np.zeros((0, 3))), about.get("facts", {}))
    require(
        sectors is not None,
        "The rim nodes of the file {path} must repeat from sector to sector as its matrices do. "
        + AGAIN,
        path=path,
    )
    assert sectors is not None
    for name in named:
        rows, others = packed[name + _SECTOR], packed[name + _OTHERS]
        each = 3 * sectors.nodes.shape[1]
        require(
            rows.shape == (sectors.ahead, each, each)
            and others.ndim == 2
            and others.shape[1] == 3 * sectors.nodes.size + len(others),
            "The parts of {name} in the file {path} must fit its rim nodes and each other, got "
            "the shapes {rows} and {others}. " + AGAIN,
            name=name,
            path=path,
            rows=list(rows.shape),
            others=list(others.shape),
        )
        arrays[name] = _Parts(rows, others).joined(sectors, signs(name))
    return arrays


def _whole_shapes(packed: dict[str, np.ndarray], about: dict[str, Any], path: object) -> np.ndarray:
    """The interior shapes of a file on all of its nodes."""
    waves, two = packed[_WAVES], packed[_SHAPES + _SECTOR]
    grid = equal_sectors(packed.get("nodes", np.zeros((0, 3))), about.get("facts", {}))
    require(
        grid is not None
        and two.shape == (len(waves), 2, grid.nodes.shape[1], 3)
        and bool(np.all((waves >= 0) & (2 * waves <= len(grid.nodes)))),
        "The interior shapes of the file {path} must be waves around its nodes, which repeat from "
        "sector to sector, got the shapes {two} and {waves}. " + AGAIN,
        path=path,
        two=list(two.shape),
        waves=list(waves.shape),
    )
    assert grid is not None
    return SectorShapes(waves, two).whole(grid)
