"""What matrices from elsewhere must be to be those of a free gear body in the units stated."""

import math

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array

from ._artefact import ReducedBody, rigid_motions
from ._checks import BodyError, require

# What text files of few digits keep, relative to the largest entry.
_DIGITS = 1e-6

# How far the mass may be from that stated, and rim nodes from their cylinder and its middle.
_MASS, _ROUND, _MIDDLE = 0.05, 1e-3, 0.02

# What gears are: radii of their rims [m], and mass over the volume that they turn in [kg/m3].
_RADII, _DENSITIES = (1e-3, 10.0), (5.0, 5e4)


def symmetric(name: str, matrix: np.ndarray | csr_array) -> np.ndarray | csr_array:
    """A matrix made symmetric to the last digit, if it is so to those of a text file.

    **Raises:**

    - `BodyError` if it is not symmetric or not finite.
    """
    numbers = matrix if isinstance(matrix, np.ndarray) else matrix.data
    require(
        np.issubdtype(numbers.dtype, np.floating) and np.isfinite(numbers).all(),
        "The {name} must be finite real numbers, got something else. Check the run that wrote it.",
        name=name,
    )
    off = abs(matrix - matrix.T).max() / max(abs(matrix).max(), np.finfo(float).tiny)
    require(
        off <= _DIGITS,
        "The {name} must be symmetric, got entries that differ by {off:.2g} of the largest. Write "
        "it without contact, friction, gyroscopic and follower terms.",
        name=name,
        off=off,
    )
    return (matrix + matrix.T) / 2


def check_motions(
    stiffness: np.ndarray | csr_array, points: np.ndarray, component: np.ndarray, *, named: bool
) -> float:
    """Refuse a stiffness that resists rigid motions.

    **Arguments:**

    - `stiffness`: shape `[row, row]` [SI].
    - `points`: place of the node of every row, shape `[row, 3]` [m].
    - `component`: of every row: 1 to 6, or 0 for an amplitude.
    - `named`: whether the file says which row is which.

    **Returns:**

    Largest force under unit motions, over the largest entry of both.

    **Raises:**

    - `BodyError` if a rigid motion strains the body.
    """
    largest = abs(stiffness).max()

    def residuals(points: np.ndarray, component: np.ndarray) -> np.ndarray:
        motions = _motions(points, component)
        return abs(stiffness @ motions).max(axis=0) / (largest * abs(motions).max(axis=0))

    got = residuals(points, component)
    if got.max() <= _DIGITS:
        return float(got.max())
    order = np.argsort(component, kind="stable")
    if not named and residuals(points[order], component[order]).max() <= _DIGITS:
        cause = "Rows stand by components, first all along x: put them in order, node by node."
    elif min(residuals(factor * points, component).max() for factor in (1e3, 1e-3)) <= _DIGITS:
        cause = "The places are in another unit of length than the matrices, by a factor of 1000."
    elif got[:3].max() <= _DIGITS:
        cause = (
            "Only turning strains it: the places belong to other nodes, or displacements are in "
            "local systems. Check node numbers, the axes and the order of rows."
        )
    else:
        cause = (
            "Either something holds the body (supports, springs to ground), or rows were left out "
            "instead of condensed (CalculiX 2.20 does so in `*SUBSTRUCTURE GENERATE`: write whole "
            "matrices by `*FREQUENCY, SOLVER=MATRIXSTORAGE`), or the order of rows is another."
        )
    motion = ("moving along x", "moving along y", "moving along z")
    motion += ("turning about x", "turning about y", "turning about z")
    raise_if = got.max() <= _DIGITS
    require(
        raise_if,
        "A free body must not resist rigid motions: {motion} gives forces of {got:.2g} of the "
        "largest entry, and up to {most:.0e} could be rounding. {cause}",
        motion=motion[int(np.argmax(got))],
        got=got.max(),
        most=_DIGITS,
        cause=cause,
    )
    return float(got.max())


def _motions(points: np.ndarray, component: np.ndarray) -> np.ndarray:
    """Rigid motions on rows, shape `[row, 6]`; amplitudes stay at rest."""
    rows = np.arange(len(points))
    moved = rigid_motions(np.nan_to_num(points)).reshape(-1, 3, 6)
    motions = moved[rows, np.clip(component, 1, 3) - 1]
    turned = np.eye(6)[np.clip(component, 1, 6) - 1]
    motions = np.where((component > 3)[:, None], turned, motions)
    return np.where((component > 0)[:, None], motions, 0.0)


def check_size(body: ReducedBody, units: str, mid_face: float) -> None:
    """Refuse a rim that is no cylinder about z, or of no gear's size.

    **Arguments:**

    - `body`: the body.
    - `units`: that the files are said to be in.
    - `mid_face`: by how much the body was moved along -z [m].

    **Raises:**

    - `BodyError` if it is so.
    """
    radii = np.hypot(body.rim_nodes[:, 0], body.rim_nodes[:, 1])
    mean = float(radii.mean())
    require(
        _RADII[0] <= mean <= _RADII[1],
        "The radius of the rim must lie between 1 mm and 10 m, got {got:.4g/mm} mm. The files are "
        "in other units than {units}, or the axis of the body is not z.",
        got=mean,
        units=units,
    )
    worst = int(np.argmax(abs(radii - mean)))
    require(
        abs(radii[worst] - mean) <= _ROUND * mean,
        "Rim nodes must lie on one cylinder about the z axis, of {mean:.6g/mm} mm in the mean, got "
        "{got:.6g/mm} mm at ({place}) mm. Turn and move the body so that z is its axis, and check "
        "which nodes have the role `rim`.",
        mean=mean,
        got=radii[worst],
        place=", ".join(f"{1e3 * each:.3f}" for each in body.rim_nodes[worst]),
    )
    low, high = body.rim_nodes[:, 2].min(), body.rim_nodes[:, 2].max()
    middle = (low + high) / 2
    require(
        abs(middle) <= _MIDDLE * (high - low) + 1e-9 * mean,
        "The middle of the toothed face must be at z = 0, got the rim from {low:.6g/mm} to "
        "{high:.6g/mm} mm. Move the body, or state that {mid_face} is {needed:.6g/mm} mm in the "
        "files, not {stated:.6g/mm} mm.",
        low=low,
        high=high,
        needed=mid_face + middle,
        stated=mid_face,
    )


def check_free(body: ReducedBody) -> None:
    """Refuse a stiffness that is indefinite or has other than six rigid motions.

    **Raises:**

    - `BodyError` if it is so.
    """
    diagonal = np.sqrt(np.abs(np.diag(body.stiffness)))
    scale = np.where(diagonal > 0, diagonal, 1.0)
    scaled = body.stiffness / scale[:, None] / scale
    rigid = scipy.linalg.orth(body.rigid_motions * scale[:, None])
    values = scipy.linalg.eigvalsh(scaled, overwrite_a=False, check_finite=False)
    # What rigid motions say above zero is rounding, and so is as much of any other motion.
    noise = 10 * np.abs(scaled @ rigid).max() + 1e-14 * len(values)
    require(
        values[0] > -noise,
        "The stiffness must not be negative for any motion, got {got:.2g} of its scaled diagonal, "
        "where up to {noise:.1g} could be rounding. Write more digits, and no stress stiffening.",
        got=values[0],
        noise=noise,
    )
    loose = int(np.sum(values < noise))
    require(
        loose == 6,
        "A free body must have six rigid motions, {name} has {loose}. More than six: parts that "
        "nothing holds together, or amplitudes without stiffness, or too few digits ({noise:.1g} "
        "could be rounding).",
        name=body.name,
        loose=loose,
        noise=noise,
    )


def check_mass(body: ReducedBody, stated: float | None, units: str) -> None:
    """Refuse a mass that cannot be, or is not that stated.

    **Arguments:**

    - `body`: the body.
    - `stated`: its mass [kg], or None.
    - `units`: that the files are said to be in.

    **Raises:**

    - `BodyError` if it is so.
    """
    motions = body.rigid_motions
    inertia = motions.T @ body.mass @ motions
    mass = float(np.trace(inertia[:3, :3])) / 3
    off = np.abs(inertia[:3, :3] - mass * np.eye(3)).max()
    require(
        mass > 0 and off <= 1e-3 * mass,
        "The mass must be the same along x, y and z, got {got} kg. Rows of the mass are in another "
        "order than those of the stiffness, or some are missing.",
        got=", ".join(f"{each:.6g}" for each in np.diag(inertia)[:3]),
    )
    _check_amount(body, mass, stated, units)
    scale = np.sqrt(np.abs(np.diag(body.mass)))
    scale = np.where(scale > 0, scale, 1.0)
    try:
        np.linalg.cholesky(body.mass / scale[:, None] / scale + _DIGITS * np.eye(body.dofs))
    except np.linalg.LinAlgError as error:
        raise BodyError(
            "The mass must not be negative for any motion, and is so for some. Write it with more "
            "digits, and check the numbering of its rows."
        ) from error


def _check_amount(body: ReducedBody, mass: float, stated: float | None, units: str) -> None:
    """Compare the mass with that stated, or with what gears weigh."""
    radius = float(np.hypot(body.rim_nodes[:, 0], body.rim_nodes[:, 1]).max())
    points = np.concatenate([body.rim_nodes, body.seat_points])
    volume = math.pi * radius**2 * max(float(np.ptp(points[:, 2])), 1e-2 * radius)
    if stated is None:
        require(
            _DENSITIES[0] <= mass / volume <= _DENSITIES[1],
            "The mass must be that of a gear, got {mass:.4g} kg in {volume:.4g/cm3} cm3. The files "
            "are in other units than {units}: with mm, N and MPa masses are in tonnes.",
            mass=mass,
            volume=volume,
            units=units,
        )
        return
    ratio = mass / stated
    thousands = round(math.log10(ratio) / 3)
    require(
        abs(ratio - 1) <= _MASS,
        "The mass must be the {stated:.4g} kg stated, to 5 %, got {mass:.4g} kg. {cause}",
        stated=stated,
        mass=mass,
        cause=f"A factor of 1000 between them: the files are in other units than {units}."
        if thousands and abs(ratio / 1000.0**thousands - 1) <= _MASS
        else "Are all parts in the model, and is the density right? Teeth count too.",
    )
